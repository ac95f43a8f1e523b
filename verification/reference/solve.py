"""The reference solver: one method for linear amplifiers, one for all others."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import replace

from taction.system.array_types import Floats
from taction.verification.reference.increasing_amplifiers import solve_maxent
from taction.verification.reference.problem import Problem, Solution
from taction.verification.reference.tikhonov import solve_strains, solve_tikhonov


def solve(problem: Problem) -> Solution:
    """Solve a problem by the method of its regulariser.

    Returns
    -------
    Solution
        Accurate only if ``trusted``; otherwise ``reason`` says why not.

    Raises
    ------
    SolverError
        The solver can return no answer.
    """
    return (solve_tikhonov if problem.regulariser == "linear" else solve_maxent)(problem)


def solve_each(problem: Problem, strains: Iterable[Floats]) -> list[Solution]:
    """Solve a problem with its strain replaced by each of `strains` (M,).

    A linear problem factorises T once; the equations of the other regularisers change with the
    solution.

    Raises
    ------
    SolverError
        As `solve`.
    """
    if problem.regulariser == "linear":
        return solve_strains(problem, strains)
    return [solve(replace(problem, eps=eps)) for eps in strains]
