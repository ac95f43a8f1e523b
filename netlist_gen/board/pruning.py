"""Pruning: the smallest entries of T have no resistors."""

from __future__ import annotations

import numpy as np

from taction.netlist_gen.board.circuit import Omission
from taction.system.array_types import Floats


def pruned(matrix: Floats, fraction: float) -> Floats:
    """Return T (M, N) with zeros for the entries below `fraction` of the largest ``|T|``.

    `fraction` is below 1, so the largest entry stays; 0 returns `matrix` itself.

    Examples
    --------
    >>> pruned(np.array([[1.0, -0.004], [0.1, 0.0]]), 0.01).tolist()
    [[1.0, 0.0], [0.1, 0.0]]
    """
    if fraction == 0.0:
        return matrix
    size = np.abs(matrix)
    return np.where(size < fraction * size.max(), 0.0, matrix)


def pruning_omission(matrix: Floats, fraction: float) -> Omission | None:
    """Return what `pruned` takes out of both resistor matrices; None if that is nothing."""
    out = matrix - pruned(matrix, fraction)
    count = int(np.count_nonzero(out))
    if not count:
        return None
    largest = np.abs(out).max() / np.abs(matrix).max()
    norm = np.linalg.norm(out) / np.linalg.norm(matrix)
    why = (
        f"{count} entries of T are below design.prune = {fraction:g} of the largest entry, the"
        f" largest of them at {largest:.3g}; their norm is {norm:.2g} of the norm of T"
    )
    return Omission(f"{2 * count} pruned matrix resistors", why)
