"""Newton's method for the regularisers of increasing amplifiers, with a duality-gap certificate.

Minimises ``1/2 |T u - eps|^2 + mu sum(phi(u) + beta u)``, ``phi' = g^-1``, after scaling by |T|.
The unknown is ``q = mu v + h g(v)`` with ``u = g(v)``; a homotopy in mu starts where one Newton
step nearly suffices. The last digits come from a refinement whose residuals have 106 bits, with the
dual vector r an unknown of its own, so that the gap is free of cancellation.
"""

from __future__ import annotations

import time
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from verification.reference.doubledouble import PRODUCT, UNIT, DoubleDouble, ExactMatrix
from verification.reference.problem import RELATIVE_ERROR, SMALLEST_SCALE, Problem, Solution
from verification.reference.regularisers import Regulariser
from verification.reference.scaled import Scaled
from verification.reference.stacked import Factor, factorise

Floats = NDArray[np.float64]

HOMOTOPY = 0.1
"""Factor between two values of mu."""
STAGE_TOLERANCE = 1.0
FINAL_TOLERANCE = 1e-10
MAX_STEPS = 100
NOISE = 1e-14
"""Relative rounding error of the objective, which the line search overlooks."""
MAX_REFINEMENTS = 12
ENOUGH = 1e-35
"""Square of the relative error of u at which refinement ends."""
FAST = 1e-6
"""A correction that shrinks the gap by less than this refreshes the factorisation."""


@dataclass(frozen=True, slots=True, eq=False)
class _Point:
    """A primal-dual pair in 106 bits with its gap and what is needed to improve it."""

    v: DoubleDouble
    r: DoubleDouble
    u: DoubleDouble
    f1: Floats
    f2: Floats
    gap: float


def _divergence(regulariser: Regulariser, v: Floats, size: Floats) -> float:
    """Bound ``sum Psi(v + d) - Psi(v) - g(v) d`` for ``|d| <= size``, free of cancellation."""
    with np.errstate(over="ignore", invalid="ignore"):
        return float(np.sum(0.5 * size * size * regulariser.steepest(v, size)))


def _newton(s: Scaled, mu: float, v: Floats, tolerance: float) -> tuple[Floats, int]:
    """Minimise at one mu from v; return v and the number of steps."""
    reg = s.regulariser
    objective, previous = s.objective(v, mu), float("inf")
    for step in range(MAX_STEPS):
        u, D = reg.g(v), np.sqrt(reg.slope(v))
        r = s.eps - s.T @ u
        y = factorise(s.T, s.gram, D, mu).solve(r, -mu * D * (v + s.beta))
        g = s.T @ (D * y)
        toward = (r - g) @ s.T - mu * (v + s.beta)
        gap = float(0.5 * g @ g) + mu * _divergence(reg, v, np.abs(toward) / mu)
        if gap <= tolerance * mu * float(np.sum(reg.ceiling(u))):
            return v, step
        noise = NOISE * (abs(objective) + float(np.sqrt((r @ r) * (s.eps @ s.eps))))
        if gap <= noise and gap > 0.5 * previous:
            return v, step
        previous = gap
        q, dq = mu * v + s.h * u, toward + s.h * D * y
        decrement = float(mu * y @ y + g @ g)
        length = 1.0
        while True:
            trial = reg.unfold(q + length * dq, mu, s.h)
            reached = s.objective(trial, mu)
            if reached <= objective - 1e-4 * length * decrement + noise:
                break
            length *= 0.5
            if length < 1e-10:
                return v, step
        v, objective = trial, reached
    return v, MAX_STEPS


def _homotopy(s: Scaled) -> tuple[Floats, int]:
    """Follow the minimiser from a large mu down to the one asked for."""
    mu = max(s.mu, float(np.trace(s.gram)))
    v: Floats = np.full(s.T.shape[1], -s.beta)
    steps = 0
    while mu > s.mu:
        v, taken = _newton(s, mu, v, STAGE_TOLERANCE)
        kept = mu * (v + s.beta) + s.h * s.regulariser.g(v)  # T^T r + h u: continuous as mu -> 0
        mu = max(HOMOTOPY * mu, s.mu)
        v = s.regulariser.unfold(kept - mu * s.beta, mu, s.h)
        steps += taken
    v, taken = _newton(s, mu, v, FINAL_TOLERANCE)
    return v, steps + taken


def _point(s: Scaled, exact: ExactMatrix, v: DoubleDouble, r: DoubleDouble) -> _Point:
    """Evaluate the gap of a pair, rounding errors of the evaluation included."""
    u = s.regulariser.exact(v)
    f1 = (DoubleDouble.of(s.eps) - exact @ u - r).hi
    shifted = v + DoubleDouble.of(s.beta)
    f2 = (exact.transposed(r) - DoubleDouble.of(s.mu) * shifted).hi
    size, dual = float(np.linalg.norm(u.hi)), float(np.linalg.norm(r.hi))
    slack1 = UNIT * (s.norm * size + np.abs(s.eps) + dual)
    slack2 = PRODUCT * (s.norm * dual + s.mu * (1.0 + np.abs(shifted.hi)))
    miss = np.linalg.norm(np.abs(f1) + slack1)
    dv = (np.abs(f2) + slack2) / s.mu
    gap = float(0.5 * miss * miss + s.mu * _divergence(s.regulariser, v.hi, dv))
    return _Point(v, r, u, f1, f2, gap if np.isfinite(gap) else np.inf)


def _corrected(s: Scaled, exact: ExactMatrix, p: _Point, D: Floats, factor: Factor) -> _Point:
    """Take one Newton step for v and r together."""
    y = factor.solve(p.f1, D * p.f2)
    dr = p.f1 - s.T @ (D * y)
    dv = (p.f2 + dr @ s.T + s.h * D * y) / (s.mu + s.h * D * D)
    return _point(s, exact, p.v + DoubleDouble.of(dv), p.r + DoubleDouble.of(dr))


def _refine(s: Scaled, v: Floats) -> tuple[_Point, int]:
    """Improve until the gap stops shrinking or is beyond what doubles can show."""
    exact, wide = ExactMatrix(s.T), DoubleDouble.of(v)
    D = np.sqrt(s.regulariser.slope(v))
    factor = factorise(s.T, s.gram, D, s.mu)
    r = DoubleDouble.of(s.eps) - exact @ s.regulariser.exact(wide)
    best = _point(s, exact, wide, r)
    for step in range(MAX_REFINEMENTS):
        peak = float(np.max(np.abs(best.u.hi)))
        ceiling = float(np.max(s.regulariser.ceiling(best.u.hi)))
        if best.gap * ceiling <= ENOUGH * s.mu * peak * peak:
            return best, step
        with np.errstate(all="ignore"):
            trial = _corrected(s, exact, best, D, factor)
        if not trial.gap < best.gap:
            return best, step
        slow = trial.gap > FAST * best.gap
        best = trial
        if slow:  # the curvature has changed since it was factorised
            D = np.sqrt(s.regulariser.slope(best.v.hi))
            factor = factorise(s.T, s.gram, D, s.mu)
    return best, MAX_REFINEMENTS


def solve_maxent(problem: Problem) -> Solution:
    """Solve for a regulariser of an increasing amplifier.

    Parameters
    ----------
    problem : Problem
        ``lam`` positive.

    Returns
    -------
    Solution
        Certificate: duality gap in the units of the objective. The gap bounds
        ``mu`` times the Bregman divergence of u from the minimiser, hence ``error_bound``.
    """
    start = time.perf_counter()
    s = Scaled.of(problem)
    v, steps = _homotopy(s)
    point, refinements = _refine(s, v)
    reg, u = s.regulariser, point.u.hi
    ceiling, peak = float(np.max(reg.ceiling(u))), float(np.max(np.abs(u)))
    ratio = point.gap / s.mu
    rounding = float(np.finfo(float).eps) / 2.0 * peak
    error = ratio + float(np.sqrt(ratio * ratio + 2.0 * ratio * ceiling)) + rounding
    allowed = RELATIVE_ERROR * max(peak, SMALLEST_SCALE) - rounding
    in_units = 2.0 * s.scale * s.scale
    bound = in_units * s.mu * allowed * allowed / (2.0 * (ceiling + allowed))
    certificate = in_units * point.gap
    trusted = bool(certificate <= bound)
    D2 = reg.slope(point.v.hi)
    return Solution(
        problem=problem,
        u=u,
        v=point.v.hi,
        objective=in_units * s.objective(point.v.hi, s.mu),
        certificate_kind="duality gap",
        certificate=certificate,
        bound=bound,
        error_bound=error,
        trusted=trusted,
        condition=float(np.sqrt(1.0 + s.gram.diagonal() @ D2 / s.mu)),
        iterations=steps + refinements,
        seconds=time.perf_counter() - start,
        reason="" if trusted else _reason(certificate, bound),
    )


def _reason(gap: float, bound: float) -> str:
    return (
        f"the duality gap {gap!r} is above {bound!r}: double precision cannot state the answer; "
        "use a larger lambda or a better conditioned matrix"
    )
