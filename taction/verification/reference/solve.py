"""The reference solver: a method for linear amplifiers, one for straight pieces, one for others.

Linear amplifiers: QR or SVD, refined with 106-bit residuals. The unknowns are u and the residual
``r = eps - T u`` together (Bjorck, BIT 7, 1967), so refinement contracts with the condition number
and not with its square. With ``f1 = eps - T u - r`` and ``f2 = T^T r - mu u``, the error of u is at
most ``|f1| / s + |f2| / s^2``, where s is the least singular value of the stacked matrix ``[T;
sqrt(mu) I]``.
"""

from __future__ import annotations

import time
from collections.abc import Iterable
from dataclasses import dataclass, replace
from functools import cache

import numpy as np

from taction.system.array_types import EPS, Floats
from taction.verification.reference.doubledouble import PRODUCT_ERROR, DoubleDouble, ExactMatrix
from taction.verification.reference.increasing_amplifiers import solve_maxent
from taction.verification.reference.newton import ScaledProblem
from taction.verification.reference.piecewise import solve_pieces
from taction.verification.reference.problem import RELATIVE_ERROR, SMALLEST_SCALE, Problem, Solution
from taction.verification.reference.regularisers import REGULARISERS
from taction.verification.reference.stacked_least_squares import SVD, StackedFactor, factorise

MAX_REFINEMENTS = 20
QR_CONDITION = 1e13
"""Above this the SVD is used: sqrt(mu) is a poor bound on the least singular value."""
SMALL = 300
"""Up to this many channels or sensors the cost of the SVD is negligible."""


@dataclass(frozen=True, slots=True, eq=False)
class _SolutionPoint:
    """u and r in 106 bits with their residuals."""

    u: DoubleDouble
    r: DoubleDouble
    f1: Floats
    f2: Floats
    residual: float  # ``|f1| s + |f2|`` plus `rounding`
    rounding: float  # bound on the rounding error of the evaluation


def _point(
    s: ScaledProblem,
    exact: ExactMatrix,
    least: float,
    u: DoubleDouble,
    r: DoubleDouble | None = None,
) -> _SolutionPoint:
    """Evaluate u and r; by default r makes f1 zero."""
    misfit = DoubleDouble.of(s.eps) - exact @ u
    r = misfit if r is None else r
    f1 = (misfit - r).hi
    f2 = (exact.transposed(r) - DoubleDouble.of(s.mu) * u).hi
    size, dual = float(np.linalg.norm(u.hi)), float(np.linalg.norm(r.hi))
    rounding1 = PRODUCT_ERROR * (s.norm * size + float(np.linalg.norm(s.eps)) + dual)
    rounding2 = PRODUCT_ERROR * (s.norm * dual + s.mu * size)
    rounding = rounding1 * least + rounding2
    residual = float(np.linalg.norm(f1)) * least + float(np.linalg.norm(f2))
    return _SolutionPoint(u, r, f1, f2, residual + rounding, rounding)


def _refine(
    s: ScaledProblem, exact: ExactMatrix, factor: StackedFactor, least: float
) -> tuple[_SolutionPoint, int]:
    """Solve and refine until the residual stops shrinking or is at its rounding error."""
    first = DoubleDouble.of(factor.solve(s.eps, np.zeros(s.T.shape[1])))
    best = _point(s, exact, least, first)
    for step in range(MAX_REFINEMENTS):
        if best.residual <= 2.0 * best.rounding:
            return best, step
        du = factor.solve(best.f1, best.f2)
        u = best.u + DoubleDouble.of(du)
        r = best.r + DoubleDouble.of(best.f1 - s.T @ du)
        trial, before = _point(s, exact, least, u, r), best.residual
        if trial.residual < before:
            best = trial
        if not trial.residual <= 0.5 * before:
            return best, step + 1
    return best, MAX_REFINEMENTS


def solve(problem: Problem) -> Solution:
    """Solve a problem by the method of its regulariser.

    For linear amplifiers ``lam`` may be 0; then T must have full column rank, which double
    precision can tell only for condition numbers up to about 1e13. Where T is rank-deficient and
    lam = 0, u is the shortest minimiser and not trusted.

    Returns
    -------
    Solution
        Accurate only if ``trusted``; otherwise ``reason`` says why not.

    Raises
    ------
    SolverError
        The solver can return no answer.
    """
    return solve_each(problem, (problem.eps,))[0]


def solve_each(problem: Problem, strains: Iterable[Floats]) -> list[Solution]:
    """Solve a problem with its strain replaced by each of `strains` (M,).

    A linear problem factorises T once; the equations of the other regularisers change with the
    solution.

    Raises
    ------
    SolverError
        As `solve`.
    """
    if REGULARISERS[problem.regulariser].pieces is not None:
        return [solve_pieces(replace(problem, eps=eps)) for eps in strains]
    if problem.regulariser != "linear":
        return [solve_maxent(replace(problem, eps=eps)) for eps in strains]
    start = time.perf_counter()
    base = ScaledProblem.of(problem)
    condition = float(np.sqrt(1.0 + base.norm**2 / base.mu)) if base.mu > 0.0 else float("inf")
    exact = ExactMatrix(base.T)
    stacked = cache(lambda: factorise(base.T, base.gram, np.ones(base.T.shape[1]), base.mu))
    svd = cache(lambda: SVD(base.T, base.mu))
    solutions = []
    for eps in strains:
        each, s = replace(problem, eps=eps), base.with_strain(eps)
        solution = None
        if min(s.T.shape) > SMALL and condition < QR_CONDITION:
            least = float(np.sqrt(s.mu))
            solution = _certified(each, s, exact, stacked(), least, condition, start)
        # The least singular value may be well above sqrt(mu).
        if solution is None or not solution.trusted:
            solution = _certified(each, s, exact, svd(), svd().least, svd().condition, start)
        solutions.append(solution)
        start = time.perf_counter()
    return solutions


def _certified(
    problem: Problem,
    s: ScaledProblem,
    exact: ExactMatrix,
    factor: StackedFactor,
    least: float,
    condition: float,
    start: float,
) -> Solution:
    """Solve with one factorisation, given its least singular value, and certify the solution."""
    point, steps = _refine(s, exact, factor, least)
    u = point.u.hi
    peak, dual = float(np.max(np.abs(u))), float(np.linalg.norm(s.eps))
    rounding = EPS / 2.0 * peak
    unit = s.norm * (s.norm * float(np.linalg.norm(u)) + dual)
    certificate = point.residual / unit if unit > 0.0 else 0.0
    floor = SMALLEST_SCALE * dual / s.norm if s.norm > 0.0 else 0.0
    allowed = RELATIVE_ERROR * max(peak, floor) - rounding
    bound = allowed * least * least / unit if unit > 0.0 else 0.0
    unique = least > 0.0
    trusted = unique and certificate <= bound
    residual = s.eps - s.T @ u
    return Solution(
        problem=problem,
        u=u,
        v=None,
        objective=float(residual @ residual + s.mu * (u @ u)) * s.scale**2,
        certificate_kind="relative residual",
        certificate=certificate,
        bound=bound,
        error_bound=certificate * unit / least / least + rounding if unique else float("inf"),
        trusted=trusted,
        condition=condition,
        iterations=steps,
        seconds=time.perf_counter() - start,
        reason=""
        if trusted
        else (
            f"double precision is not enough: the condition number is {condition!r} at "
            f"lambda = {problem.lam!r}; use a larger lambda or fewer channels"
        ),
    )
