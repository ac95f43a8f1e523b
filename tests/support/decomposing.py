"""The modes of matrices, for tests of what is done with modes."""

from __future__ import annotations

import numpy as np

from taction.verification.engines.statespace.linearised.modes import Modes, find_modes
from taction.verification.engines.statespace.linearised.reduction import (
    Pencil,
    Reduced,
    reduce_pencil,
)


def decompose(*matrices: np.ndarray) -> Modes:
    """Return the modes of ``x' = A x``, given the blocks along the diagonal of A, 1/s."""
    size, begin, blocks = sum(map(len, matrices)), 0, list[Reduced]()
    for A in matrices:
        one, places = np.eye(len(A)), np.arange(begin, begin := begin + len(A))
        basis = np.eye(size)[:, places]
        parts = one, A, np.zeros((len(A), 1)), one, np.abs(A), basis, basis.T
        blocks.append(reduce_pencil(Pencil(*parts), []))
    return find_modes(blocks)
