"""The reference solver: least squares for linear amplifiers and straight pieces, else Newton."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import replace

from taction.system.array_types import Floats
from taction.system.errors import SolverError
from taction.verification.reference.least_squares import solve_least_squares
from taction.verification.reference.problem import Problem, Solution
from taction.verification.reference.regularisers import REGULARISERS
from taction.verification.reference.smooth import solve_smooth


def solve(problem: Problem) -> Solution:
    """Solve a problem by the method of its regulariser.

    For linear amplifiers ``lam`` may be 0; then T must have full column rank, which double
    precision can tell only for condition numbers up to about 1e13. Where T is rank-deficient and
    lam = 0, u is the shortest minimiser and not trusted.

    SolverError: the solver can return no answer.
    """
    return solve_each(problem, (problem.eps,))[0]


def solve_each(problem: Problem, strains: Iterable[Floats]) -> list[Solution]:
    """Solve a problem with its strain replaced by each of `strains` (M,).

    SolverError: as `solve`.
    """
    if problem.regulariser == "linear" or REGULARISERS[problem.regulariser].pieces is not None:
        return solve_least_squares(problem, strains)
    return [solve_smooth(replace(problem, eps=eps)) for eps in strains]


def solve_square(problem: Problem) -> Solution:
    """Solve ``T u = eps``; lambda of `problem` is 0, and T is square.

    SolverError: T is not square, or its singular values cannot be computed.
    """
    rows, columns = problem.T.shape
    if rows != columns:
        raise SolverError(f"T is {rows} by {columns}; a square matrix is needed")
    return solve(problem)
