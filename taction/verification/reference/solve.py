"""The reference solver: least squares for linear amplifiers and straight pieces, else Newton.

Newton's method, then refinement, minimises ``1/2 |T u - eps|^2 + mu sum(phi(u) + beta u)``,
``u = g(v)``, ``phi' = g^-1``. Steps in ``q = mu v + h g(v)`` neither overflow nor stall as mu goes
to 0, where the method becomes an active-set method; a homotopy in mu starts where one step nearly
suffices.

The refinement has a dual vector r beside v, both of more digits than double precision. The duality
gap ``1/2 |f1|^2 + mu sum(divergence of f2/mu)`` of ``f1 = eps - T u - r`` and
``f2 = T^T r - mu (v + beta)`` has no cancellation beyond their rounding, which counts as a part of
them, as the rounding of g does. The gap is at least mu times the Bregman divergence of u from the
minimiser, which bounds the error of u.
"""

from __future__ import annotations

import math
import time
from collections.abc import Callable, Iterable
from dataclasses import dataclass, replace

import numpy as np

from taction.system.array_types import EPS, Floats
from taction.system.errors import SolverError
from taction.verification.reference.least_squares import solve_least_squares
from taction.verification.reference.problem import (
    ENOUGH,
    LARGEST,
    RELATIVE_ERROR,
    SMALLEST_SCALE,
    Extended,
    Problem,
    ScaledProblem,
    Solution,
    norm,
)
from taction.verification.reference.regularisers import REGULARISERS

STAGE, CONVERGED = 1.0, 1e-10  # squared relative errors of u that end a stage, and the last one
MAX_STEPS, MAX_REFINEMENTS = 100, 60
OBJECTIVE_ROUNDING = 1e-14  # relative rounding error of the objective: the line search ignores it
SHORTEST_STEP = 1e-10
FACTOR = 0.03  # between two values of mu in the homotopy
FUNCTION_ERROR = 4.0
"""Relative error of g in units of its rounding."""
# Refinement ends if the gap shrinks by less than `STALLED` in so many steps in turn. A step that
# increases the gap can lead to where Newton's method converges; the best point is kept.
STALLED, PATIENCE = 0.5, 6


Solver = Callable[[Floats, Floats], Floats]
"""Return y (N,) for f1 (M,) and f2 (N,)."""
CHOLESKY_LIMIT = 1e-12  # of mu over ``|A|^2``: from here on normal equations are accurate enough


def factorise(A: Floats, mu: float) -> Solver:
    """Factorise A (M, N) by Cholesky where it is accurate enough, else by QR; mu is positive."""
    from scipy.linalg.lapack import dpotrf, dpotrs, dtrtrs

    one = np.eye(A.shape[1])
    if mu > CHOLESKY_LIMIT * float(np.sum(A * A)):
        L, failed = dpotrf(A.T @ A + mu * one, lower=1)
        if not failed:
            return lambda f1, f2: np.asarray(dpotrs(L, f1 @ A + f2, lower=1)[0])
    Q, R = np.linalg.qr(np.vstack([A, np.sqrt(mu) * one]))

    def solve(f1: Floats, f2: Floats) -> Floats:
        return np.asarray(dtrtrs(R, f1 @ Q[: len(A)] + dtrtrs(R, f2, trans=1)[0])[0])

    return solve


def _objective(s: ScaledProblem, v: Floats, mu: float) -> float:
    u = s.regulariser.g(v)
    residual = s.eps - s.T @ u
    return float(0.5 * residual @ residual + mu * np.sum(s.regulariser.energy(v) + s.beta * u))


def _divergence(s: ScaledProblem, v: Extended, size: Floats) -> float:
    """Bound ``sum Psi(v + d) - Psi(v) - g(v) d`` for ``|d| <= size``, free of cancellation."""
    return float(np.sum(0.5 * size * size * s.regulariser.largest_slope(v, size)))


def _newton(s: ScaledProblem, mu: float, v: Floats, share: float) -> tuple[Floats, Floats, int]:
    """Minimise at `mu` from v until the square of the relative error is `share`, or rounding.

    Return v, the dual vector r (M,) and the number of steps.
    """
    reg, before, size = s.regulariser, np.inf, float(np.linalg.norm(s.eps))
    objective = _objective(s, v, mu)
    for step in range(MAX_STEPS):
        u, D = reg.g(v), np.sqrt(reg.slope(v))
        residual = s.eps - s.T @ u
        y = factorise(s.T * D, mu)(residual, -mu * D * (v + s.beta))
        bend = s.T @ (D * y)
        force = (residual - bend) @ s.T - mu * (v + s.beta)  # mu times the step in v
        dq = force + s.h * D * y
        gap = 0.5 * float(bend @ bend) + mu * _divergence(s, v, np.abs(force) / mu)
        if gap <= mu * share * float(np.sum(reg.slope_bound(u))):
            return reg.v_from_q(mu * v + s.h * u + dq, mu, s.h), residual - bend, step
        rounding = OBJECTIVE_ROUNDING * (abs(objective) + size * float(np.linalg.norm(residual)))
        if gap <= rounding and gap > 0.5 * before:
            return v, residual, step
        before, q, length = gap, mu * v + s.h * u, 1.0
        fall = 1e-4 * float(mu * y @ y + bend @ bend)
        while True:
            trial = reg.v_from_q(q + length * dq, mu, s.h)
            reached = _objective(s, trial, mu)
            if reached <= objective - length * fall + rounding:
                break
            length *= 0.5
            if length < SHORTEST_STEP:
                return v, residual, step
        v, objective = trial, reached
    return v, s.eps - s.T @ reg.g(v), MAX_STEPS


def _homotopy(s: ScaledProblem) -> tuple[Floats, Floats, int]:
    """Follow the minimiser from a large mu down to ``s.mu``; return what `_newton` does."""
    mu, steps = max(s.mu, s.norm**2), 0
    v = np.full(len(s.h), -s.beta)
    while mu > s.mu:
        v, _, taken = _newton(s, mu, v, STAGE)
        steps += taken
        smooth = mu * (v + s.beta) + s.h * s.regulariser.g(v)  # continuous as mu goes to 0
        mu = max(FACTOR * mu, s.mu)
        v = s.regulariser.v_from_q(smooth - mu * s.beta, mu, s.h)
    v, r, taken = _newton(s, mu, v, CONVERGED)
    return v, r, steps + taken


@dataclass(frozen=True, slots=True, eq=False)
class _DualPair:
    """A primal-dual pair with its residuals, its gap, and the bound on the error of u."""

    v: Extended
    r: Extended
    u: Floats
    f1: Floats
    f2: Floats
    gap: float
    error: float

    @classmethod
    def at(cls, s: ScaledProblem, v: Extended, r: Extended) -> _DualPair:
        """Evaluate the gap of a pair, with bounds on the rounding of its residuals.

        The error d of u follows from ``d^2 / 2`` over the largest slope between u and the
        minimiser, which is at most the slope bound at u plus d.
        """
        g = s.regulariser.g(v)
        u, off = g.astype(np.float64), FUNCTION_ERROR * float(np.finfo(g.dtype).eps)
        if not np.max(np.abs(np.concatenate([u, r, v]))) < LARGEST:
            return cls(v, r, u, s.eps, u, np.inf, np.inf)
        f1, f2, off1, off2 = s.residuals(g, r, s.mu * v, np.full(len(u), s.mu * s.beta))
        misfit = norm(f1) * (1.0 + 4.0 * EPS) + off1 + off * s.norm * norm(u)
        force = (np.abs(f2) * (1.0 + 4.0 * EPS) + off2) / s.mu
        gap = 0.5 * misfit * misfit + s.mu * _divergence(s, v, force)
        if not np.isfinite(gap):
            return cls(v, r, u, f1, f2, np.inf, np.inf)
        ratio = gap / s.mu + float(np.finfo(float).tiny)  # the squares of tiny outputs underflow
        largest = float(np.max(s.regulariser.slope_bound(u)))
        error = ratio + math.sqrt(ratio) * math.sqrt(ratio + 2.0 * largest)
        return cls(v, r, u, f1, f2, gap, error + (off + EPS) * float(np.max(np.abs(u))))

    @property
    def peak(self) -> float:
        """What errors of u are compared with."""
        return max(float(np.max(np.abs(self.u))), SMALLEST_SCALE)

    def corrected(self, s: ScaledProblem) -> _DualPair:
        """Take one Newton step for v and r together."""
        slope = s.regulariser.slope(self.v.astype(np.float64))
        D = np.sqrt(slope)
        y = factorise(s.T * D, s.mu)(self.f1, D * self.f2)
        dr = self.f1 - s.T @ (D * y)
        # From ``q = mu v + h g(v)``.
        dv = (self.f2 + dr @ s.T + s.h * D * y) / (s.mu + s.h * slope)
        return _DualPair.at(s, self.v + dv, self.r + dr)


def _refine(s: ScaledProblem, v: Floats, r: Floats) -> tuple[_DualPair, int]:
    """Improve until the error is small, or the gap stops shrinking."""
    best = point = _DualPair.at(s, v.astype(np.longdouble), r.astype(np.longdouble))
    idle = 0  # steps without progress
    for step in range(MAX_REFINEMENTS):
        patience = 1 if best.error <= RELATIVE_ERROR * best.peak else PATIENCE
        if best.error <= ENOUGH * best.peak or idle >= patience:
            return best, step
        point = point.corrected(s)
        if not np.isfinite(point.gap):
            return best, step + 1
        idle = idle + 1 if point.gap > STALLED * best.gap else 0
        best = point if point.gap < best.gap else best
    return best, MAX_REFINEMENTS


def solve_smooth(problem: Problem) -> Solution:
    """Solve for a regulariser of an increasing amplifier; ``lam`` is positive.

    The certificate is the duality gap in the units of the objective.
    """
    start = time.perf_counter()
    s = ScaledProblem.of(problem)
    with np.errstate(all="ignore"):  # a step that overflows has no finite gap
        v, r, steps = _homotopy(s)
        point, refinements = _refine(s, v, r)
    v, slope = point.v.astype(np.float64), float(np.max(s.regulariser.slope_bound(point.u)))
    most = RELATIVE_ERROR * point.peak
    allowed = most - FUNCTION_ERROR * EPS * float(np.max(np.abs(point.u)))
    unscale = 2.0 * s.scale * s.scale
    certificate = unscale * point.gap
    bound = unscale * s.mu * allowed * allowed / (2.0 * (slope + allowed))
    trusted = bool(point.error <= most)
    reason = (
        f"the duality gap {certificate:.3g} is above {bound:.3g}: double precision is not"
        " enough; use a larger lambda or a better conditioned matrix"
    )
    return Solution(
        problem=problem,
        u=point.u,
        v=v,
        objective=unscale * _objective(s, v, s.mu),
        certificate_kind="duality gap",
        certificate=certificate,
        bound=bound,
        error_bound=point.error,
        trusted=trusted,
        condition=float(np.sqrt(1.0 + s.h @ s.regulariser.slope(v) / s.mu)),
        iterations=steps + refinements,
        seconds=time.perf_counter() - start,
        reason="" if trusted else reason,
    )


def solve(problem: Problem) -> Solution:
    """Solve a problem by the method of its regulariser.

    For linear amplifiers ``lam`` may be 0; then T must have full column rank, which double
    precision can tell only for condition numbers up to about 1e13. Where T is rank-deficient and
    lam = 0, u is the shortest minimiser and not trusted.

    SolverError: the solver can return no answer.
    """
    return solve_each(problem, (problem.eps,))[0]


def solve_each(problem: Problem, strains: Iterable[Floats]) -> list[Solution]:
    """Solve a problem with its strain replaced by each of `strains` (M,).

    SolverError: as `solve`.
    """
    if problem.regulariser == "linear" or REGULARISERS[problem.regulariser].pieces is not None:
        return solve_least_squares(problem, strains)
    return [solve_smooth(replace(problem, eps=eps)) for eps in strains]


def solve_square(problem: Problem) -> Solution:
    """Solve ``T u = eps``; lambda of `problem` is 0, and T is square.

    SolverError: T is not square, or its singular values cannot be computed.
    """
    rows, columns = problem.T.shape
    if rows != columns:
        raise SolverError(f"T is {rows} by {columns}; a square matrix is needed")
    return solve(problem)
