"""The way into the reference solver: one table entry a regulariser."""

from __future__ import annotations

from collections.abc import Callable, Iterable
from dataclasses import replace

from spice_models.array_types import Floats
from verification.reference.increasing_amplifiers import solve_maxent
from verification.reference.problem import Problem, Solution
from verification.reference.regularisers import REGULARISERS
from verification.reference.tikhonov import solve_strains, solve_tikhonov

SOLVERS: dict[str, Callable[[Problem], Solution]] = {
    name: solve_tikhonov if name == "linear" else solve_maxent for name in REGULARISERS
}


def solve(problem: Problem) -> Solution:
    """Solve a problem by the method of its regulariser.

    Parameters
    ----------
    problem : Problem
        What to solve.

    Returns
    -------
    Solution
        To be believed only if ``trusted``; otherwise ``reason`` says why not.

    Raises
    ------
    SolverError
        Nothing at all can be returned.
    """
    return SOLVERS[problem.regulariser](problem)


def solve_each(problem: Problem, strains: Iterable[Floats]) -> list[Solution]:
    """Solve a problem for several strains (M,) in the place of its own.

    A linear problem factorises T once for all of them; the equations of the other regularisers
    change with the solution.

    Raises
    ------
    SolverError
        As `solve`.
    """
    if problem.regulariser == "linear":
        return solve_strains(problem, strains)
    return [solve(replace(problem, eps=eps)) for eps in strains]
