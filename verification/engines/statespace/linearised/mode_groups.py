"""Which modes a Newton step turns, and which are too close to one another for a step."""

from __future__ import annotations

import numpy as np

from taction.system.array_types import Bools, Complexes, Ints
from taction.verification.engines.statespace.linearised.real_columns import both

SEPARABLE = 1e-2  # a step separates modes whose coupling is below this part of their distance


def turns(reduced: Complexes, kept: Complexes, real: int) -> tuple[Complexes, Bools]:
    """Return the turns (k, n) of a Newton step, and which modes are too close for a step."""
    gap = both(kept, real) - kept[:, None]
    with np.errstate(divide="ignore", invalid="ignore", over="ignore"):
        turn = reduced / gap
        close = ~(turn.real**2 + turn.imag**2 < SEPARABLE**2)  # and each to itself
    turn[close] = 0.0
    return turn, close


def mode_groups(linked: Bools, real: int) -> list[Ints]:
    """Return the connected groups of more than one mode, by links to all modes, (k, n)."""
    count = len(linked)
    reach = linked[:, :count] | np.eye(count, dtype=np.bool_)
    reach[:, real:] |= linked[:, count:]
    reach |= reach.T
    while not np.array_equal(wider := reach @ reach, reach):
        reach = wider
    rows = np.unique(reach, axis=0)
    return [np.flatnonzero(row) for row in rows if row.sum() > 1]
