"""The regularisers of increasing amplifiers: Newton's method, refined, with a duality gap.

The last digits come from a refinement whose residuals have 106 bits, with the dual vector r an
unknown of its own, so that the gap ``1/2 |f1|^2 + mu sum(divergence of f2/mu)`` of
``f1 = eps - T u - r`` and ``f2 = T^T r - mu (v + beta)`` is free of cancellation.
"""

from __future__ import annotations

import time
from dataclasses import dataclass

import numpy as np

from spice_models.array_types import Floats
from verification.reference.doubledouble import PRODUCT, UNIT, DoubleDouble, ExactMatrix
from verification.reference.newton import (
    Iterate,
    Pair,
    divergence,
    error_bound,
    homotopy,
    largest_ratio,
)
from verification.reference.problem import RELATIVE_ERROR, SMALLEST_SCALE, Problem, Solution
from verification.reference.scaled_problem import Scaled
from verification.reference.stacked_least_squares import Factor

CLOSE = 1e-10
"""Square of the relative error of u at which refinement takes over."""
MEAN_SLOPES = 4
SMALL_RISE = 0.1
_NODES = np.array([0.5 - 0.15**0.5, 0.5, 0.5 + 0.15**0.5])
_WEIGHTS = np.array([5.0, 8.0, 5.0]) / 18.0
MAX_REFINEMENTS = 20
STALLED = 0.5
"""A correction with a fresh factorisation that shrinks the gap by less than this is the last."""
SHORTENED = (1.0, 0.25, 0.0625, 0.015625)
"""Shares of a correction that are tried."""
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


def _point(s: Scaled, exact: ExactMatrix, v: DoubleDouble, r: DoubleDouble) -> _Point:
    """Evaluate the gap of a pair, rounding errors of the evaluation included."""
    u = s.regulariser.exact(v)
    if not (np.all(np.isfinite(u.hi)) and np.all(np.isfinite(r.hi))):
        return _Point(v, r, u, s.eps, v.hi, float("inf"))
    f1 = (DoubleDouble.of(s.eps) - exact @ u - r).hi
    shifted = v + DoubleDouble.of(s.beta)
    f2 = (exact.transposed(r) - DoubleDouble.of(s.mu) * shifted).hi
    size, dual = float(np.linalg.norm(u.hi)), float(np.linalg.norm(r.hi))
    slack1 = UNIT * (s.norm * size + np.abs(s.eps) + dual)
    slack2 = PRODUCT * (s.norm * dual + s.mu * (1.0 + np.abs(shifted.hi)))
    miss = np.linalg.norm(np.abs(f1) + slack1)
    dv = (np.abs(f2) + slack2) / s.mu
    gap = float(0.5 * miss * miss + s.mu * divergence(s.regulariser, v.hi, dv))
    return _Point(v, r, u, f1, f2, gap if np.isfinite(gap) else np.inf)


def _rises(s: Scaled, v: Floats, dq: Floats) -> tuple[Floats, Floats]:
    """Return the dv of a step in ``q = mu v + h g(v)``: linearised, and without cancellation.

    Newton's method is nearly linear in q and not in v, and where T is ill-conditioned that decides
    between convergence and none. ``g(v + dv) - g(v)`` is dv times the mean slope between. Far from
    the solution the linearised step is sometimes the better one.
    """
    straight = dq / (s.mu + s.h * s.regulariser.slope(v))
    dv = straight
    for _ in range(MEAN_SLOPES):
        between = v + np.multiply.outer(_NODES, dv)
        dv = dq / (s.mu + s.h * (_WEIGHTS @ s.regulariser.slope(between)))
    return straight, np.where(np.abs(straight) < SMALL_RISE, dv, straight)


def _corrected(
    s: Scaled, exact: ExactMatrix, p: _Point, D: Floats, factor: Factor
) -> _Point | None:
    """Take one Newton step for v and r together, shortened until the gap falls; None if never."""
    y = factor.solve(p.f1, D * p.f2)
    dr = p.f1 - s.product(D * y)
    straight, curved = _rises(s, p.v.hi, p.f2 + s.transposed(dr) + s.h * D * y)
    for dv, length in ((curved, 1.0), *((straight, share) for share in SHORTENED)):
        v, r = p.v + DoubleDouble.of(length * dv), p.r + DoubleDouble.of(length * dr)
        trial = _point(s, exact, v, r)
        if trial.gap < p.gap:
            return trial
    return None


def _first(s: Scaled, exact: ExactMatrix, near: Pair) -> _Point:
    """Return where to start: one step further if Newton's method converged."""
    if near.ahead is not None:
        q = s.mu * near.primal.v + s.h * near.primal.u + near.ahead
        with np.errstate(all="ignore"):
            v = s.regulariser.unfold(q, s.mu, s.h)
            further = _point(s, exact, DoubleDouble.of(v), DoubleDouble.of(near.dual))
        if np.isfinite(further.gap):
            return further
    wide = DoubleDouble.of(near.primal.v)
    r = DoubleDouble.of(s.eps) - exact @ s.regulariser.exact(wide)
    return _point(s, exact, wide, r)


def _refine(s: Scaled, near: Pair) -> tuple[_Point, int]:
    """Improve until the gap stops shrinking or is beyond what doubles can show."""
    exact = ExactMatrix(s.T)
    best = _first(s, exact, near)
    wanted = False
    for step in range(MAX_REFINEMENTS):
        peak = float(np.max(np.abs(best.u.hi)))
        ceiling = float(np.max(s.regulariser.ceiling(best.u.hi)))
        if best.gap * ceiling <= ENOUGH * s.mu * peak * peak:
            return best, step
        fresh = step == 0 or wanted
        if fresh:
            D = np.sqrt(s.regulariser.slope(best.v.hi))
            factor = s.factor(D, s.mu)
        with np.errstate(all="ignore"):
            trial = _corrected(s, exact, best, D, factor)
        shrunk = trial.gap / best.gap if trial is not None else 1.0
        if fresh and shrunk > STALLED:
            return trial or best, step + 1
        wanted = shrunk > FAST  # the curvature has changed
        best = trial or best
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
    near = homotopy(s, lambda u: CLOSE * float(np.sum(s.regulariser.ceiling(u))))
    point, refinements = _refine(s, near)
    reg, u = s.regulariser, point.u.hi
    ceiling, peak = float(np.max(reg.ceiling(u))), float(np.max(np.abs(u)))
    rounding = float(np.finfo(float).eps) / 2.0 * peak
    error = error_bound(point.gap / s.mu, ceiling) + rounding
    allowed = RELATIVE_ERROR * max(peak, SMALLEST_SCALE) - rounding
    in_units = 2.0 * s.scale * s.scale
    bound = in_units * s.mu * largest_ratio(allowed, ceiling)
    certificate = in_units * point.gap
    trusted = bool(certificate <= bound)
    D2 = reg.slope(point.v.hi)
    return Solution(
        problem=problem,
        u=u,
        v=point.v.hi,
        objective=in_units * Iterate.at(s, point.v.hi, s.mu).objective,
        certificate_kind="duality gap",
        certificate=certificate,
        bound=bound,
        error_bound=error,
        trusted=trusted,
        condition=float(np.sqrt(1.0 + s.gram.diagonal() @ D2 / s.mu)),
        iterations=near.steps + refinements,
        seconds=time.perf_counter() - start,
        reason="" if trusted else _reason(certificate, bound),
    )


def _reason(gap: float, bound: float) -> str:
    return (
        f"the duality gap {gap!r} is above {bound!r}: double precision cannot state the answer; "
        "use a larger lambda or a better conditioned matrix"
    )
