"""What pruning does to the steady state: the measured change beside a proven bound."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from taction.netlist_gen.topologies.frame.planes import pruned
from taction.system.array_types import Floats
from taction.verification.reference import IdealNetwork, Solution, solve
from taction.verification.reference.changed_matrix import change_bound


@dataclass(frozen=True, slots=True, eq=False)
class PruningEffect:
    """The steady state without the small entries of T.

    Attributes
    ----------
    entries : int
        Number of entries of T that the board leaves out.
    target : ndarray (N,)
        The optimum with the pruned T, V.
    change : float
        Largest deviation of `target` from the optimum with the whole T, V.
    bound : float
        Proven bound on that deviation, V; infinite if there is none.
    """

    entries: int
    target: Floats
    change: float
    bound: float


def pruning_effect(
    network: IdealNetwork, fraction: float, solution: Solution
) -> PruningEffect | None:
    """Compare the solutions of the pruned and of the whole T; None if no entry is left out.

    Parameters
    ----------
    network : IdealNetwork
        With the whole T.
    fraction : float
        ``design.prune``.
    solution : Solution
        The solution of `network`.

    Raises
    ------
    SolverError
        The problem with the pruned T cannot be solved.
    """
    kept = pruned(network.T, fraction)
    entries = int(np.count_nonzero(kept != network.T))
    if not entries:
        return None
    after = solve(replace(network, T=kept).problem)
    change = float(np.max(np.abs(after.u - solution.u)))
    bound = change_bound(solution, kept)
    return PruningEffect(entries, after.u * network.U0, change * network.U0, bound * network.U0)
