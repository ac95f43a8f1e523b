"""Lambda by a rule: ``lambda = "discrepancy"`` becomes a number before the synthesis.

The discrepancy principle, where the noise is known, and GCV minimise a score over lam.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from taction.netlist_gen.scene.inverse_problem import make_problem
from taction.netlist_gen.scene.scene import Scene, load_scene
from taction.system.errors import Complaint, InputError, SolverError
from taction.verification.reference.ideal_answer import is_biased
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
    scores = [score(exponent) for exponent in grid.tolist()]
    best = int(np.argmin(scores))
    ends = grid[max(best - 1, 0)], grid[min(best + 1, count - 1)]
    with np.errstate(invalid="ignore"):  # scores may be infinite
        refined = minimize_scalar(
            score, bounds=ends, method="bounded", options={"xatol": _PRECISION}
        )
    exponent, least = float(grid[best]), scores[best]
    if not least < refined.fun:
        exponent, least = float(refined.x), float(refined.fun)
    solution = solve(replace(problem, lam=float(10.0**exponent)))
    return LambdaChoice(solution, least, best in (0, count - 1))


def resolve_lambda(scene: Scene) -> Scene:
    """Return `scene` with a number for lambda; unchanged where it has one.

    InputError: the scene lacks the variance of the noise, which the rule ``discrepancy`` needs.
    SolverError: the rule finds no optimum: its score is best at an end of the range.
    """
    rule = scene.design.lam
    if not isinstance(rule, str):
        return scene
    inverse, variance = make_problem(scene), scene.problem.noise.variance
    if text := missing(rule, variance):
        raise InputError(scene.file, Complaint("design.lambda", repr(rule), text))
    kind = scene.design.amplifier, is_biased(scene), scene.design.ridge_share
    problem = Problem(inverse.matrix, inverse.strain, 1.0, *kind)
    choice = choose(problem, rule, variance=variance)
    if choice.at_edge:
        raise SolverError(
            f"lambda = {rule!r} finds no optimum from {DECADES[0]:g} to {DECADES[1]:g} decades of"
            f" the squared norm of T: its score is best at the end, {choice.solution.lam:.3g}."
            " Give a number, or another rule"
        )
    return scene.with_lambda(choice.solution.lam, rule)


def read_scene(scene: str | Path | Scene, engine: str | None = None) -> Scene:
    """Return a scene, read from its path if necessary, with lambda as a number.

    `engine` replaces the engine of the scene.

    InputError, SolverError: see `taction.netlist_gen.scene.scene.load_scene` and
      `resolve_lambda`.
    """
    resolved = resolve_lambda(scene if isinstance(scene, Scene) else load_scene(scene))
    return resolved if engine is None else resolved.with_engine(engine)
