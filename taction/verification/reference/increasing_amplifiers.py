"""Solver for the regularisers of increasing amplifiers: Newton's method with refinement.

The refinement has residuals of 106 bits and the dual vector r as a separate unknown, so that the
duality gap ``1/2 |f1|^2 + mu sum(divergence of f2/mu)`` of ``f1 = eps - T u - r`` and
``f2 = T^T r - mu (v + beta)`` is free of cancellation.
"""

from __future__ import annotations

import time
from dataclasses import dataclass

import numpy as np

from taction.system.array_types import EPS, Floats
from taction.verification.reference.doubledouble import (
    FUNCTION_ERROR,
    PRODUCT_ERROR,
    DoubleDouble,
    ExactMatrix,
)
from taction.verification.reference.newton import (
    Iterate,
    NewtonResult,
    ScaledProblem,
    divergence,
    error_bound,
    homotopy,
    largest_ratio,
)
from taction.verification.reference.problem import RELATIVE_ERROR, SMALLEST_SCALE, Problem, Solution
from taction.verification.reference.stacked_least_squares import StackedFactor

NEWTON_ERROR = 1e-10
"""Square of the relative error of u at which Newton's method ends and refinement begins."""
REFINED_ERROR = 1e-35
"""Square of the relative error of u at which refinement ends."""
MEAN_SLOPE_STEPS = 4
SMALL_STEP = 0.1
_NODES = np.array([0.5 - 0.15**0.5, 0.5, 0.5 + 0.15**0.5])
_WEIGHTS = np.array([5.0, 8.0, 5.0]) / 18.0
MAX_REFINEMENTS = 60
STALLED = 0.5
PATIENCE = 8
"""Refinement ends if the gap shrinks by less than `STALLED` in so many steps in turn. A step that
increases the gap can lead to where Newton's method converges; the best point is kept."""
STEP_LENGTHS = (1.0, 0.25, 0.0625, 0.015625)
"""Shares of a correction that are tried."""
FACTORS = (0.01, 0.1, 0.03, 0.3)
"""Factors of the homotopy. With an ill-conditioned T the refinement of a few per cent of its starts
ends far from the solution, and rounding decides which: another path gives another start."""
FAST = 1e-6
"""If a correction shrinks the gap by less than this, T is factorised again."""


@dataclass(frozen=True, slots=True, eq=False)
class _RootPoint:
    """A primal-dual pair in 106 bits with its residuals and its gap."""

    v: DoubleDouble
    r: DoubleDouble
    u: DoubleDouble
    f1: Floats
    f2: Floats
    gap: float


def _point(s: ScaledProblem, exact: ExactMatrix, v: DoubleDouble, r: DoubleDouble) -> _RootPoint:
    """Evaluate the gap of a pair, with a bound on the rounding error of the evaluation."""
    u = s.regulariser.exact(v)
    if not (np.all(np.isfinite(u.hi)) and np.all(np.isfinite(r.hi))):
        return _RootPoint(v, r, u, s.eps, v.hi, float("inf"))
    f1 = (DoubleDouble.of(s.eps) - exact @ u - r).hi
    shifted = v + DoubleDouble.of(s.beta)
    f2 = (exact.transposed(r) - DoubleDouble.of(s.mu) * shifted).hi
    size, dual = float(np.linalg.norm(u.hi)), float(np.linalg.norm(r.hi))
    rounding1 = FUNCTION_ERROR * (s.norm * size + np.abs(s.eps) + dual)
    rounding2 = PRODUCT_ERROR * (s.norm * dual + s.mu * (1.0 + np.abs(shifted.hi)))
    misfit = np.linalg.norm(np.abs(f1) + rounding1)
    dv = (np.abs(f2) + rounding2) / s.mu
    gap = float(0.5 * misfit * misfit + s.mu * divergence(s.regulariser, v.hi, dv))
    return _RootPoint(v, r, u, f1, f2, gap if np.isfinite(gap) else np.inf)


def _steps_in_v(s: ScaledProblem, v: Floats, dq: Floats) -> tuple[Floats, Floats]:
    """Return the dv of a step in ``q = mu v + h g(v)``: linearised, and exact for small steps."""
    linear = dq / (s.mu + s.h * s.regulariser.slope(v))
    dv = linear
    for _ in range(MEAN_SLOPE_STEPS):  # ``g(v + dv) - g(v)`` is dv times the mean slope between
        between = v + np.multiply.outer(_NODES, dv)
        dv = dq / (s.mu + s.h * (_WEIGHTS @ s.regulariser.slope(between)))
    return linear, np.where(np.abs(linear) < SMALL_STEP, dv, linear)


def _corrected(
    s: ScaledProblem, exact: ExactMatrix, p: _RootPoint, D: Floats, factor: StackedFactor
) -> _RootPoint:
    """Take one Newton step for v and r together, shortened until the gap falls.

    Where the gap does not fall, the step with the least gap is taken.
    """
    y = factor.solve(p.f1, D * p.f2)
    dr = p.f1 - s.product(D * y)
    # Newton's method is nearly linear in q but not in v: for an ill-conditioned T only the exact
    # step converges. Far from the solution the linearised step is sometimes better.
    dq, trials = p.f2 + s.transposed(dr) + s.h * D * y, []
    for length in STEP_LENGTHS:
        linear, exact_step = _steps_in_v(s, p.v.hi, length * dq)
        for dv in (exact_step, linear):
            v, r = p.v + DoubleDouble.of(dv), p.r + DoubleDouble.of(length * dr)
            trials.append(_point(s, exact, v, r))
            if trials[-1].gap < p.gap:
                return trials[-1]
    return min(trials, key=lambda trial: trial.gap)


def _first_point(s: ScaledProblem, exact: ExactMatrix, result: NewtonResult) -> _RootPoint:
    """Return the start of the refinement: one step further if Newton's method converged."""
    if result.next_step is not None:
        q = s.mu * result.primal.v + s.h * result.primal.u + result.next_step
        with np.errstate(all="ignore"):
            v = s.regulariser.v_from_q(q, s.mu, s.h)
            point = _point(s, exact, DoubleDouble.of(v), DoubleDouble.of(result.dual))
        if np.isfinite(point.gap):
            return point
    wide = DoubleDouble.of(result.primal.v)
    r = DoubleDouble.of(s.eps) - exact @ s.regulariser.exact(wide)
    return _point(s, exact, wide, r)


def _refine(s: ScaledProblem, result: NewtonResult) -> tuple[_RootPoint, int]:
    """Improve until the gap stops shrinking or the error is far below double precision."""
    exact = ExactMatrix(s.T)
    best = point = _first_point(s, exact, result)
    outdated, idle = True, 0  # the factorisation; steps without progress
    for step in range(MAX_REFINEMENTS):
        peak = float(np.max(np.abs(best.u.hi)))
        slope_bound = float(np.max(s.regulariser.slope_bound(best.u.hi)))
        if best.gap * slope_bound <= REFINED_ERROR * s.mu * peak * peak or idle == PATIENCE:
            return best, step
        fresh = outdated
        if fresh:
            D = np.sqrt(s.regulariser.slope(point.v.hi))
            factor = s.factor(D, s.mu)
        with np.errstate(all="ignore"):
            point = _corrected(s, exact, point, D, factor)
        if not np.isfinite(point.gap):
            return best, step + 1
        shrunk = point.gap / best.gap
        outdated = shrunk > FAST  # the curvature has changed
        idle = idle + 1 if fresh and shrunk > STALLED else 0
        best = point if shrunk < 1.0 else best
    return best, MAX_REFINEMENTS


def _best(s: ScaledProblem) -> tuple[_RootPoint, int]:
    """Return the point of the least gap of the paths that were needed, and all iterations."""
    points, iterations = list[_RootPoint](), 0
    for factor in FACTORS:
        result = homotopy(
            s, lambda u: NEWTON_ERROR * float(np.sum(s.regulariser.slope_bound(u))), factor
        )
        point, refinements = _refine(s, result)
        points.append(point)
        iterations += result.steps + refinements
        if point.gap <= _largest_gap(s, point):
            break
    return min(points, key=lambda point: point.gap), iterations


def _slope_bound(s: ScaledProblem, point: _RootPoint) -> float:
    return float(np.max(s.regulariser.slope_bound(point.u.hi)))


def _rounding(point: _RootPoint) -> float:
    """Return the rounding error of u as doubles."""
    return EPS / 2.0 * float(np.max(np.abs(point.u.hi)))


def _largest_gap(s: ScaledProblem, point: _RootPoint) -> float:
    """Return the largest gap with which u is trusted."""
    peak = float(np.max(np.abs(point.u.hi)))
    allowed = RELATIVE_ERROR * max(peak, SMALLEST_SCALE) - _rounding(point)
    return s.mu * largest_ratio(allowed, _slope_bound(s, point))


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
    s = ScaledProblem.of(problem)
    reg = s.regulariser
    point, iterations = _best(s)
    u, slope_bound = point.u.hi, _slope_bound(s, point)
    error = error_bound(point.gap / s.mu, slope_bound) + _rounding(point)
    unscale = 2.0 * s.scale * s.scale
    certificate, bound = unscale * point.gap, unscale * _largest_gap(s, point)
    trusted = bool(certificate <= bound)
    D2 = reg.slope(point.v.hi)
    return Solution(
        problem=problem,
        u=u,
        v=point.v.hi,
        objective=unscale * Iterate.at(s, point.v.hi, s.mu).objective,
        certificate_kind="duality gap",
        certificate=certificate,
        bound=bound,
        error_bound=error,
        trusted=trusted,
        condition=float(np.sqrt(1.0 + s.gram.diagonal() @ D2 / s.mu)),
        iterations=iterations,
        seconds=time.perf_counter() - start,
        reason=""
        if trusted
        else (
            f"the duality gap {certificate!r} is above {bound!r}: double precision is not enough; "
            "use a larger lambda or a better conditioned matrix"
        ),
    )
