"""Which entries of a matrix a fresh scene leaves out: those that do not move its solution.

A kernel that decays, a Gaussian for example, has entries over many decades. Resistors cannot be
bought over more than six, and few entries below a thousandth of the largest move the solution.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from taction.netlist_gen.board.part_warnings import LEAST_OHMS, MOST_OHMS
from taction.netlist_gen.topologies.frame.planes import pruned
from taction.system.array_types import Floats
from taction.verification.reference import Problem, solve
from taction.verification.reference.changed_matrix import change_bound

FRACTIONS = (1e-3, 3e-4, 1e-4, 3e-5, 1e-5)  # of the largest entry, the most pruning first
NECESSARY = LEAST_OHMS / MOST_OHMS  # smaller entries have no resistor that can be bought
UNSEEN = 2e-4  # of the largest output: a fifth of the least limit of a fresh scene


@dataclass(frozen=True, slots=True)
class Pruning:
    """A fraction for ``design.prune``, and what it changes.

    Attributes
    ----------
    fraction : float
        Of the largest entry; 0 where every entry stays.
    entries : int
        Number of entries that are left out.
    change, bound : float
        Change of the solution and its proven bound, shares of the largest output.
    """

    fraction: float = 0.0
    entries: int = 0
    change: float = 0.0
    bound: float = 0.0

    @property
    def note(self) -> str:
        """What is left out, in words; empty where nothing is."""
        if not self.entries:
            return ""
        return (
            f"design.prune = {self.fraction:g} leaves out {self.entries} of the entries of T: the"
            f" solution changes by {100 * self.change:.2g} % of the largest output (proven:"
            f" at most {100 * self.bound:.2g} %)"
        )


def pruning_for(T: Floats, eps: Floats, lam: float) -> Pruning:
    """Return the most pruning that no limit of a fresh scene sees.

    Parameters
    ----------
    T : ndarray (M, N)
    eps : ndarray (M,)
    lam : float

    Returns
    -------
    Pruning
        Without entries where the entries that are not zero differ by less than the factor 1000.
        Where every fraction changes the solution by more than `UNSEEN`, the smallest that gives
        resistors that can be bought, if there must be one.

    Raises
    ------
    SolverError
        The problem cannot be solved.

    Examples
    --------
    >>> T = np.array([[1.0, 1e-9], [0.5, 1.0]])
    >>> found = pruning_for(T, np.array([1.0, 1.0]), 0.1)
    >>> found.fraction, found.entries, found.change <= found.bound < 1e-8
    (0.001, 1, True)
    """
    before = solve(Problem(T, eps, lam))
    largest = float(np.abs(before.u).max(initial=0.0)) or 1.0
    for fraction in (*FRACTIONS, NECESSARY):
        kept = pruned(T, fraction)
        entries = int(np.count_nonzero(kept != T))
        if not entries:
            continue
        after = solve(Problem(kept, eps, lam))
        change = float(np.abs(after.u - before.u).max()) / largest
        if change <= UNSEEN or fraction == NECESSARY:
            bound = change_bound(before, kept) / largest
            return Pruning(fraction, entries, change, bound)
    return Pruning()
