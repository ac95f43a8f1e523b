"""Choice of lam: discrepancy principle, GCV, L-curve, quasi-optimality, least squared error.

Every rule minimises a score over lam. The sensitivity of the solution is exact:
``(T^T T + mu / g') du = -(v + beta) dmu``, one singular value decomposition of ``T D``.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from operator import itemgetter

import numpy as np

from taction.system.array_types import Floats
from taction.system.errors import Complaint, InputError
from taction.verification.reference.problem import Problem, Solution
from taction.verification.reference.regularisers import REGULARISERS
from taction.verification.reference.solve import solve
from taction.verification.reference.stacked_least_squares import SVD

TAU = 1.3
"""Discrepancy principle: ``|T u - eps|^2 = TAU M sigma^2``."""
DECADES = (-12.0, 2.0)
"""Range of lam over the square of the spectral norm of T, as powers of ten."""
PER_DECADE = 3
_PRECISION = 1e-5  # of the exponent of lam


@dataclass(frozen=True, slots=True, eq=False)
class LambdaTrial:
    """The solution for one lam, with the quantities that the scores use."""

    solution: Solution
    residual: float  # ``|T u - eps|^2``
    penalty: float  # Omega above its least value
    sensitivity: Floats  # ``lam du/dlam`` (N,)
    penalty_sensitivity: float  # ``lam dOmega/dlam``
    fitted: float  # degrees of freedom: trace of the derivative of ``T u`` with respect to eps

    @classmethod
    def of(cls, problem: Problem) -> LambdaTrial:
        """Solve and differentiate."""
        solution = solve(problem)
        entry = REGULARISERS[problem.regulariser]
        v = solution.u if solution.v is None else solution.v
        beta = float(problem.bias)
        mu = entry.weight * problem.lam
        D = np.sqrt(entry.slope(v))
        svd = SVD(problem.T * D, mu)
        sensitivity = -mu * D * svd.solve(np.zeros(len(problem.eps)), D * (v + beta))
        misfit = problem.T @ solution.u - problem.eps
        rest = np.full_like(v, -beta)
        floor = entry.energy(rest) + beta * entry.g(rest)
        penalty = 2.0 * entry.weight * np.sum(entry.energy(v) + beta * solution.u - floor)
        square = svd.sigma**2
        return cls(
            solution=solution,
            residual=float(misfit @ misfit),
            penalty=float(penalty),
            sensitivity=sensitivity,
            penalty_sensitivity=float(2.0 * entry.weight * (v + beta) @ sensitivity),
            fitted=float(np.sum(square / (square + mu))),
        )


def _discrepancy(trial: LambdaTrial, variance: float, _: Floats) -> float:
    target = TAU * len(trial.solution.problem.eps) * variance
    return abs(float(np.log(trial.residual / target))) if trial.residual > 0.0 else float("inf")


def _gcv(trial: LambdaTrial, variance: float, truth: Floats) -> float:
    free = len(trial.solution.problem.eps) - trial.fitted
    return trial.residual / free**2 if free > 0.0 else float("inf")


def _l_curve(trial: LambdaTrial, variance: float, truth: Floats) -> float:
    """Return minus the curvature of (log residual, log penalty)."""
    rho, eta, slope = trial.residual, trial.penalty, trial.penalty_sensitivity
    lam = trial.solution.lam
    if not (rho > 0.0 and eta > 0.0 and slope < 0.0):
        return float("inf")
    # Derivatives with respect to log lam; ``d residual = -lam d penalty``.
    dx, dy = -lam * slope / rho, slope / eta
    turn = dx * dy * (dx - dy - 1.0)
    return -float(turn / (dx * dx + dy * dy) ** 1.5)


RULES: dict[str, Callable[[LambdaTrial, float, Floats], float]] = {
    "discrepancy": _discrepancy,
    "gcv": _gcv,
    "l-curve": _l_curve,
    "quasi-optimality": lambda trial, *_: float(np.linalg.norm(trial.sensitivity)),
    "mse": lambda trial, _, truth: float(np.sum((trial.solution.u - truth) ** 2)),
}
"""Scores by rule: functions of a trial, of the noise's variance and of the true u."""
# Their score also falls towards both ends of the range, where it has no meaning: the lowest local
# minimum between the ends counts.
LOCAL_MINIMUM = {"l-curve", "quasi-optimality"}


def missing(rule: str, variance: float, truth: Floats | None) -> str:
    """Return what a rule needs and does not have, or empty."""
    if rule not in RULES:
        return f"one of {', '.join(RULES)}"
    if rule == "discrepancy" and not variance > 0.0:
        return "the rule needs problem.noise.variance above zero"
    if rule == "mse" and truth is None:
        return "the rule needs the true stress: problem.stress"
    return ""


@dataclass(frozen=True, slots=True, eq=False)
class LambdaChoice:
    """A chosen lam, which is ``solution.lam``."""

    solution: Solution
    score: float  # at the chosen lam
    at_edge: bool  # the best score is at an end of the range: the rule finds no optimum


def choose(
    problem: Problem,
    rule: str = "discrepancy",
    *,
    variance: float = 0.0,
    truth: Floats | None = None,
) -> LambdaChoice:
    """Choose the lam of least score on a grid of three values a decade, refined by Brent's method.

    `problem`: its lam is ignored.
    `variance`: of the noise in one entry of eps, for ``discrepancy``.
    `truth` (N,): the u that belongs to eps, for ``mse``.
    InputError: an unknown rule, an input that the rule needs is missing, or T is zero.
    """
    if text := missing(rule, variance, truth):
        raise InputError("choice of lambda", Complaint("rule", rule, text))
    if not np.any(problem.T):
        text = "for a matrix of zeros lambda has no effect"
        raise InputError("choice of lambda", Complaint("T", "0", text))
    known = np.zeros(0) if truth is None else np.asarray(truth)

    def score(exponent: float) -> float:
        trial = LambdaTrial.of(replace(problem, lam=float(10.0**exponent)))
        return RULES[rule](trial, variance, known) if trial.solution.trusted else float("inf")

    from scipy.optimize import minimize_scalar

    middle = 2.0 * float(np.log10(np.linalg.norm(problem.T, 2)))
    count = int((DECADES[1] - DECADES[0]) * PER_DECADE) + 1
    grid = middle + np.linspace(*DECADES, count)
    scores = np.array([score(float(exponent)) for exponent in grid])
    best = _lowest(scores, rule in LOCAL_MINIMUM)
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


def _lowest(scores: Floats, local_minimum: bool) -> int:
    """Return the index of the least score; of the lowest inner minimum if one is requested."""
    inner = scores[1:-1]
    minima = 1 + np.flatnonzero((inner < scores[:-2]) & (inner <= scores[2:]))
    candidates = minima if local_minimum and len(minima) else np.arange(len(scores))
    return int(candidates[np.argmin(scores[candidates])])
