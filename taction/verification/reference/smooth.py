"""Solver for the regularisers of increasing amplifiers: Newton's method, then refinement.

Minimises ``1/2 |T u - eps|^2 + mu sum(phi(u) + beta u)``, ``u = g(v)``, ``phi' = g^-1``. Newton's
method in ``q = mu v + h g(v)`` neither overflows nor stalls as mu goes to 0, where it becomes an
active-set method; a homotopy in mu starts where one step nearly suffices.

The refinement has a dual vector r beside v, both of twice the digits of double precision. The
duality gap ``1/2 |f1|^2 + mu sum(divergence of f2/mu)`` of ``f1 = eps - T u - r`` and
``f2 = T^T r - mu (v + beta)`` is then free of cancellation. So is v, and ``u = g(v) + g'(v) dv``
for its last digits dv. What double precision adds to g counts as a shift of v, or as a part of f1
where g is so flat that v would move far. The gap is at least mu times the Bregman divergence of u
from the minimiser, which bounds the error of u.
"""

from __future__ import annotations

import math
import time
from dataclasses import dataclass

import numpy as np

from taction.system.array_types import EPS, Floats
from taction.verification.reference.problem import (
    ENOUGH,
    LARGEST,
    RELATIVE_ERROR,
    SMALLEST_SCALE,
    Problem,
    ScaledProblem,
    Solution,
)
from taction.verification.reference.stacked_least_squares import (
    PRODUCT_ERROR,
    Pair,
    exact_sums,
    factorise,
    products,
)

STAGE, CONVERGED = 1.0, 1e-10  # squared relative errors of u that end a stage, and the last one
MAX_STEPS, MAX_REFINEMENTS = 100, 60
OBJECTIVE_ROUNDING = 1e-14  # relative rounding error of the objective: the line search ignores it
SHORTEST_STEP = 1e-10
FACTOR = 0.03  # between two values of mu in the homotopy
FUNCTION_ERROR = 4.0 * EPS
"""Relative error of g in double precision."""
LARGEST_SHIFT = 1e-3  # of v that stands for the error of g: its slope falls by at most 1.25 over it
NEAR = 1e-8  # largest `lo` of v at which a step leaves `hi` as it is
# Refinement ends if the gap shrinks by less than `STALLED` in so many steps in turn. A step that
# increases the gap can lead to where Newton's method converges; the best point is kept.
STALLED, PATIENCE = 0.5, 6


def _objective(s: ScaledProblem, v: Floats, mu: float) -> float:
    u = s.regulariser.g(v)
    residual = s.eps - s.T @ u
    return float(0.5 * residual @ residual + mu * np.sum(s.regulariser.energy(v) + s.beta * u))


def _divergence(s: ScaledProblem, v: Floats, size: Floats) -> float:
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

    v: Pair
    r: Pair
    u: Floats
    f1: Floats
    f2: Floats
    gap: float
    error: float

    @classmethod
    def at(cls, s: ScaledProblem, v: Pair, r: Pair) -> _DualPair:
        """Evaluate the gap of a pair, with bounds on the rounding of its residuals.

        The error d of u follows from ``d^2 / 2`` over the largest slope between u and the
        minimiser, which is at most the slope bound at u plus d.
        """
        u, slope = s.regulariser.g(v.hi), s.regulariser.slope(v.hi)
        if not np.max(np.abs(np.concatenate([u, r.hi, v.hi]))) < LARGEST:
            return cls(v, r, u, s.eps, v.hi, np.inf, np.inf)
        f1 = -exact_sums(s.T, Pair(u, slope * v.lo), -s.eps, r.hi, r.lo)
        terms = *products(-s.mu, v.hi), -s.mu * v.lo, np.full(len(u), -s.mu * s.beta)
        f2 = exact_sums(s.T.T, r, *terms)
        off = FUNCTION_ERROR * np.abs(u) + slope * v.lo**2  # |g''| <= 2 g'
        shift = np.divide(1.25 * off, slope, out=np.full(len(u), np.inf), where=slope > 0.0)
        steep = (shift <= LARGEST_SHIFT) & (slope * s.h >= s.mu)
        misfit = float(np.linalg.norm(np.abs(f1) + np.abs(s.T) @ np.where(steep, 0.0, off)))
        misfit = (1.0 + 4.0 * EPS) * misfit + PRODUCT_ERROR * s.norm * float(np.linalg.norm(u))
        rounding = PRODUCT_ERROR * (s.norm * float(np.linalg.norm(r.hi)) + s.mu * np.abs(v.hi))
        dv = (np.abs(f2) * (1.0 + 4.0 * EPS) + rounding) / s.mu + np.where(steep, shift, 0.0)
        gap = 0.5 * misfit * misfit + s.mu * _divergence(s, v.hi, dv)
        if not np.isfinite(gap):
            return cls(v, r, u, f1, f2, np.inf, np.inf)
        u = u + slope * v.lo
        ratio = gap / s.mu + float(np.finfo(float).tiny)  # the squares of tiny outputs underflow
        largest = float(np.max(s.regulariser.slope_bound(u)))
        error = ratio + math.sqrt(ratio) * math.sqrt(ratio + 2.0 * largest)
        return cls(v, r, u, f1, f2, gap, error + FUNCTION_ERROR * float(np.max(np.abs(u))))

    @property
    def peak(self) -> float:
        """What errors of u are compared with."""
        return max(float(np.max(np.abs(self.u))), SMALLEST_SCALE)


def _corrected(s: ScaledProblem, p: _DualPair) -> _DualPair:
    """Take one Newton step for v and r together.

    A small step leaves the `hi` of v, and so the rounding of ``g(hi)``.
    """
    slope = s.regulariser.slope(p.v.hi)
    D = np.sqrt(slope)
    y = factorise(s.T * D, s.mu)(p.f1, D * p.f2)
    dr = p.f1 - s.T @ (D * y)
    dv = (p.f2 + dr @ s.T + s.h * D * y) / (s.mu + s.h * slope)  # from ``q = mu v + h g(v)``
    lo, far = p.v.lo + dv, p.v + dv
    near = np.abs(lo) <= NEAR
    v = Pair(np.where(near, p.v.hi, far.hi), np.where(near, lo, far.lo))
    return _DualPair.at(s, v, p.r + dr)


def _refine(s: ScaledProblem, v: Floats, r: Floats) -> tuple[_DualPair, int]:
    """Improve until the error is small, or the gap stops shrinking."""
    best = point = _DualPair.at(s, Pair.of(v), Pair.of(r))
    idle = 0  # steps without progress
    for step in range(MAX_REFINEMENTS):
        patience = 1 if best.error <= RELATIVE_ERROR * best.peak else PATIENCE
        if best.error <= ENOUGH * best.peak or idle >= patience:
            return best, step
        point = _corrected(s, point)
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
    slope = float(np.max(s.regulariser.slope_bound(point.u)))
    most = RELATIVE_ERROR * point.peak
    allowed = most - FUNCTION_ERROR * float(np.max(np.abs(point.u)))
    unscale = 2.0 * s.scale * s.scale
    certificate = unscale * point.gap
    bound = unscale * s.mu * allowed * allowed / (2.0 * (slope + allowed))
    trusted = bool(point.error <= most)
    slopes = s.regulariser.slope(point.v.hi)
    reason = (
        f"the duality gap {certificate:.3g} is above {bound:.3g}: double precision is not"
        " enough; use a larger lambda or a better conditioned matrix"
    )
    return Solution(
        problem=problem,
        u=point.u,
        v=point.v.hi + point.v.lo,
        objective=unscale * _objective(s, point.v.hi, s.mu),
        certificate_kind="duality gap",
        certificate=certificate,
        bound=bound,
        error_bound=point.error,
        trusted=trusted,
        condition=float(np.sqrt(1.0 + s.h @ slopes / s.mu)),
        iterations=steps + refinements,
        seconds=time.perf_counter() - start,
        reason="" if trusted else reason,
    )
