"""The way into the reference solver: one table entry a regulariser."""

from __future__ import annotations

from collections.abc import Callable

from verification.reference.increasing_amplifiers import solve_maxent
from verification.reference.problem import Problem, Solution
from verification.reference.regularisers import REGULARISERS
from verification.reference.tikhonov import solve_tikhonov

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
