"""Choice of lam: the discrepancy principle where the noise is known, else GCV.

Either rule minimises a score over lam.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from operator import itemgetter

import numpy as np

from taction.system.errors import Complaint, InputError
from taction.verification.reference.least_squares import SVD
from taction.verification.reference.problem import Problem, Solution
from taction.verification.reference.regularisers import REGULARISERS
from taction.verification.reference.solve import solve

TAU = 1.3
"""Discrepancy principle: ``|T u - eps|^2 = TAU M sigma^2``."""
DECADES = (-12.0, 2.0)
"""Range of lam over the square of the spectral norm of T, as powers of ten."""
PER_DECADE = 3
_PRECISION = 1e-5  # of the exponent of lam


def _residual(solution: Solution) -> float:
    """Return ``|T u - eps|^2``."""
    misfit = solution.problem.T @ solution.u - solution.problem.eps
    return float(misfit @ misfit)


def _discrepancy(solution: Solution, variance: float) -> float:
    target, residual = TAU * len(solution.problem.eps) * variance, _residual(solution)
    return abs(float(np.log(residual / target))) if residual > 0.0 else float("inf")


def fitted(solution: Solution) -> float:
    """Return the degrees of freedom: the trace of the derivative of ``T u`` with respect to eps."""
    problem, entry = solution.problem, REGULARISERS[solution.problem.regulariser]
    mu, v = entry.weight * problem.lam, solution.u if solution.v is None else solution.v
    square = SVD(problem.T * np.sqrt(entry.slope(v)), mu).sigma ** 2
    return float(np.sum(square / (square + mu)))


def _gcv(solution: Solution, _: float) -> float:
    free = len(solution.problem.eps) - fitted(solution)
    return _residual(solution) / free**2 if free > 0.0 else float("inf")


RULES: dict[str, Callable[[Solution, float], float]] = {"discrepancy": _discrepancy, "gcv": _gcv}
"""Scores by rule: functions of the solution for a lam, and of the noise's variance."""


def missing(rule: str, variance: float) -> str:
    """Return what a rule needs and does not have, or empty."""
    if rule not in RULES:
        return f"one of {', '.join(RULES)}"
    if rule == "discrepancy" and not variance > 0.0:
        return "the rule needs problem.noise.variance above zero"
    return ""


@dataclass(frozen=True, slots=True, eq=False)
class LambdaChoice:
    """A chosen lam, which is ``solution.lam``."""

    solution: Solution
    score: float  # at the chosen lam
    at_edge: bool  # the best score is at an end of the range: the rule finds no optimum


def choose(problem: Problem, rule: str = "discrepancy", *, variance: float = 0.0) -> LambdaChoice:
    """Choose the lam of least score on a grid of three values a decade, refined by Brent's method.

    `problem`: its lam is ignored.
    `variance`: of the noise in one entry of eps, for ``discrepancy``.
    InputError: an unknown rule, an input that the rule needs is missing, or T is zero.
    """
    if text := missing(rule, variance):
        raise InputError("choice of lambda", Complaint("rule", rule, text))
    if not np.any(problem.T):
        text = "for a matrix of zeros lambda has no effect"
        raise InputError("choice of lambda", Complaint("T", "0", text))

    def score(exponent: float) -> float:
        """Return the score of a power of ten."""
        solution = solve(replace(problem, lam=float(10.0**exponent)))
        return RULES[rule](solution, variance) if solution.trusted else float("inf")

    from scipy.optimize import minimize_scalar

    middle = 2.0 * float(np.log10(np.linalg.norm(problem.T, 2)))
    count = int((DECADES[1] - DECADES[0]) * PER_DECADE) + 1
    grid = middle + np.linspace(*DECADES, count)
    scores = np.array([score(float(exponent)) for exponent in grid])
    best = int(np.argmin(scores))
    at_edge = best in (0, count - 1)
    low, high = grid[max(best - 1, 0)], grid[min(best + 1, count - 1)]
    with np.errstate(invalid="ignore"):  # scores may be infinite
        refined = minimize_scalar(
            score, bounds=(low, high), method="bounded", options={"xatol": _PRECISION}
        )
    exponent, least = min(
        (float(refined.x), float(refined.fun)),
        (float(grid[best]), float(scores[best])),
        key=itemgetter(1),
    )
    solution = solve(replace(problem, lam=float(10.0**exponent)))
    return LambdaChoice(solution, least, at_edge)
