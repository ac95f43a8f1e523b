"""The first witness: it sees only the problem (T, eps, lam, regulariser)."""

from taction.verification.reference.dynamics import (
    IdealNetwork,
    ideal_linear,
    ideal_transient,
    lambda_times_resistance,
)
from taction.verification.reference.problem import Problem, Solution
from taction.verification.reference.solve import solve, solve_each

__all__ = [
    "IdealNetwork",
    "Problem",
    "Solution",
    "ideal_linear",
    "ideal_transient",
    "lambda_times_resistance",
    "solve",
    "solve_each",
]
