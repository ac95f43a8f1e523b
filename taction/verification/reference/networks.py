"""Ideal networks of topologies that solve otherwise than by the gradient flow of eq (9)."""

from __future__ import annotations

from taction.system.errors import SolverError
from taction.verification.reference.dynamics import AtOnce
from taction.verification.reference.problem import Problem, Solution
from taction.verification.reference.solve import solve


def solve_square(problem: Problem) -> Solution:
    """Solve ``T u = eps``; lambda of `problem` is 0, and T is square.

    SolverError: T is not square, or its singular values cannot be computed.

    Examples
    --------
    >>> found = solve_square(Problem([[2.0, 1.0], [1.0, 3.0]], [3.0, 4.0], 0.0))
    >>> found.u.tolist(), found.trusted
    ([1.0, 1.0], True)
    """
    rows, columns = problem.T.shape
    if rows != columns:
        raise SolverError(f"T is {rows} by {columns}; a square matrix is needed")
    return solve(problem)


AT_ONCE = {
    "inv": AtOnce(solve_square),
    "pinv": AtOnce(solve),
    "ridge": AtOnce(solve, regularised=True),
}
"""Networks without capacitors by the names of their topologies; they see only the problem."""
