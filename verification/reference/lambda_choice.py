"""Choice of lam: discrepancy principle, GCV, L-curve, quasi-optimality, least squared error.

Every rule is a score to minimise over lam. The sensitivity of the answer is exact:
``(T^T T + mu / g') du = -(v + beta) dmu``, one singular value decomposition of ``T D``.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from operator import itemgetter

import numpy as np

from spice_models.array_types import Floats
from spice_models.errors import Complaint, InputError
from verification.reference.problem import Problem, Solution
from verification.reference.regularisers import REGULARISERS
from verification.reference.solve import solve
from verification.reference.stacked_least_squares import SVD

TAU = 1.3
"""Discrepancy principle: ``|T u - eps|^2 = TAU M sigma^2``."""
DECADES = (-12.0, 2.0)
"""Range of lam over the square of the spectral norm of T, as powers of ten."""
PER_DECADE = 3
_PRECISION = 1e-5  # of the exponent of lam


@dataclass(frozen=True, slots=True, eq=False)
class Knowledge:
    """What a rule may know besides the problem.

    Attributes
    ----------
    variance : float
        Of the noise in one entry of eps; 0: not known.
    truth : ndarray (N,) or None
        The u that made eps.
    tau : float
        Factor of the discrepancy principle.
    """

    variance: float = 0.0
    truth: Floats | None = None
    tau: float = TAU


@dataclass(frozen=True, slots=True, eq=False)
class Trial:
    """One lam with what the rules look at.

    Attributes
    ----------
    solution : Solution
        The answer for this lam.
    residual : float
        ``|T u - eps|^2``.
    penalty : float
        Omega above its least value.
    drift : ndarray (N,)
        ``lam du/dlam``.
    penalty_drift : float
        ``lam dOmega/dlam``.
    freedom : float
        Trace of the derivative of ``T u`` with respect to eps: fitted degrees of freedom.
    """

    solution: Solution
    residual: float
    penalty: float
    drift: Floats
    penalty_drift: float
    freedom: float

    @classmethod
    def of(cls, problem: Problem) -> Trial:
        """Solve and differentiate."""
        solution = solve(problem)
        entry = REGULARISERS[problem.regulariser]
        v = solution.u if solution.v is None else solution.v
        beta = float(problem.bias)
        mu = entry.weight * problem.lam
        D = np.sqrt(entry.slope(v))
        svd = SVD(problem.T * D, mu)
        drift = -mu * D * svd.solve(np.zeros(len(problem.eps)), D * (v + beta))
        miss = problem.T @ solution.u - problem.eps
        rest = np.full_like(v, -beta)
        floor = entry.energy(rest) + beta * entry.g(rest)
        penalty = 2.0 * entry.weight * np.sum(entry.energy(v) + beta * solution.u - floor)
        square = svd.sigma**2
        return cls(
            solution=solution,
            residual=float(miss @ miss),
            penalty=float(penalty),
            drift=drift,
            penalty_drift=float(2.0 * entry.weight * (v + beta) @ drift),
            freedom=float(np.sum(square / (square + mu))),
        )


def _discrepancy(trial: Trial, knows: Knowledge) -> float:
    target = knows.tau * len(trial.solution.problem.eps) * knows.variance
    return abs(float(np.log(trial.residual / target))) if trial.residual > 0.0 else float("inf")


def _gcv(trial: Trial, _: Knowledge) -> float:
    left = len(trial.solution.problem.eps) - trial.freedom
    return trial.residual / left**2 if left > 0.0 else float("inf")


def _l_curve(trial: Trial, _: Knowledge) -> float:
    """Return minus the curvature of (log residual, log penalty).

    Along the path ``d residual = -lam d penalty``, so one derivative is enough.
    """
    rho, eta, slope = trial.residual, trial.penalty, trial.penalty_drift
    lam = trial.solution.lam
    if not (rho > 0.0 and eta > 0.0 and slope < 0.0):
        return float("inf")
    dx, dy = -lam * slope / rho, slope / eta  # derivatives with respect to log lam
    turn = dx * dy * (dx - dy - 1.0)
    return -float(turn / (dx * dx + dy * dy) ** 1.5)


def _quasi_optimality(trial: Trial, _: Knowledge) -> float:
    return float(np.linalg.norm(trial.drift))


def _squared_error(trial: Trial, knows: Knowledge) -> float:
    return float(np.sum((trial.solution.u - np.asarray(knows.truth)) ** 2))


@dataclass(frozen=True, slots=True)
class Rule:
    """A rule of choice.

    Attributes
    ----------
    score : callable
        What to minimise, of a trial and what is known.
    needs_variance, needs_truth : bool
        What must be known.
    valley : bool
        The score also falls towards both ends of the range, where it means nothing: look for its
        lowest valley between them.
    """

    score: Callable[[Trial, Knowledge], float]
    needs_variance: bool = False
    needs_truth: bool = False
    valley: bool = False


RULES: dict[str, Rule] = {
    "discrepancy": Rule(_discrepancy, needs_variance=True),
    "gcv": Rule(_gcv),
    "l-curve": Rule(_l_curve, valley=True),
    "quasi-optimality": Rule(_quasi_optimality, valley=True),
    "mse": Rule(_squared_error, needs_truth=True),
}


@dataclass(frozen=True, slots=True, eq=False)
class Choice:
    """A chosen lam with what was looked at.

    Attributes
    ----------
    rule : str
        A key of `RULES`.
    solution : Solution
        For the chosen lam, which is ``solution.lam``.
    score : float
        The rule's score there.
    at_edge : bool
        The best value lies at an end of the range searched: the rule found no lam of its own.
    lams, scores : ndarray (P,)
        The grid.
    """

    rule: str
    solution: Solution
    score: float
    at_edge: bool
    lams: Floats
    scores: Floats


def choose(problem: Problem, rule: str = "discrepancy", knows: Knowledge | None = None) -> Choice:
    """Choose lam for a problem by a rule.

    Parameters
    ----------
    problem : Problem
        Its own lam is ignored.
    rule : str
        A key of `RULES`.
    knows : Knowledge, optional
        The variance of the noise for ``discrepancy``, the true u for ``mse``.

    Returns
    -------
    Choice
        The lam of least score on a grid of three values a decade, refined by Brent's method.

    Raises
    ------
    InputError
        An unknown rule, or the rule needs what is not known, or T is zero.
    """
    knows = Knowledge() if knows is None else knows
    complaints = _complaints(problem, rule, knows)
    if complaints:
        raise InputError("choice of lambda", *complaints)

    def score(exponent: float) -> float:
        trial = Trial.of(replace(problem, lam=float(10.0**exponent)))
        return RULES[rule].score(trial, knows) if trial.solution.trusted else float("inf")

    from scipy.optimize import minimize_scalar

    middle = 2.0 * float(np.log10(np.linalg.norm(problem.T, 2)))
    count = int((DECADES[1] - DECADES[0]) * PER_DECADE) + 1
    grid = middle + np.linspace(*DECADES, count)
    scores = np.array([score(float(exponent)) for exponent in grid])
    best = _lowest(scores, RULES[rule].valley)
    at_edge = best in (0, count - 1)
    low, high = grid[max(best - 1, 0)], grid[min(best + 1, count - 1)]
    with np.errstate(invalid="ignore"):  # scores may be infinite
        found = minimize_scalar(
            score, bounds=(low, high), method="bounded", options={"xatol": _PRECISION}
        )
    exponent, least = min(
        (float(found.x), float(found.fun)),
        (float(grid[best]), float(scores[best])),
        key=itemgetter(1),
    )
    solution = solve(replace(problem, lam=float(10.0**exponent)))
    return Choice(rule, solution, least, at_edge, 10.0**grid, scores)


def _lowest(scores: Floats, valley: bool) -> int:
    """Return where the least score is, within a valley if there is one and it is asked for."""
    inner = scores[1:-1]
    dips = 1 + np.flatnonzero((inner < scores[:-2]) & (inner <= scores[2:]))
    places = dips if valley and len(dips) else np.arange(len(scores))
    return int(places[np.argmin(scores[places])])


def _complaints(problem: Problem, rule: str, knows: Knowledge) -> list[Complaint]:
    if rule not in RULES:
        return [Complaint("rule", rule, f"one of {', '.join(RULES)}")]
    found = []
    if RULES[rule].needs_variance and not knows.variance > 0.0:
        accepted = f"{rule} needs one above 0"
        found.append(Complaint("noise variance", repr(knows.variance), accepted))
    if RULES[rule].needs_truth and knows.truth is None:
        found.append(Complaint("truth", "missing", f"{rule} needs the true u"))
    if not np.any(problem.T):
        found.append(Complaint("T", "0", "a matrix of zeros leaves nothing to choose"))
    return found
