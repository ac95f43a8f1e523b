"""The first witness: it sees only the problem (T, eps, lam, regulariser)."""

from verification.reference.dynamics import IdealNetwork, ideal_linear, ideal_transient
from verification.reference.problem import Problem, Solution
from verification.reference.solve import solve, solve_each

__all__ = [
    "IdealNetwork",
    "Problem",
    "Solution",
    "ideal_linear",
    "ideal_transient",
    "solve",
    "solve_each",
]
