"""The poles of a board as eigenvalues of ``K⁻¹ M``, which determine the slow ones best.

The error of an eigenvalue is the rounding of the largest eigenvalue. So the eigenvalues of the
state matrix are precise for fast poles, and those of its inverse, 1/p, for slow poles.
"""

from __future__ import annotations

import numpy as np

from taction.system.array_types import Complexes
from taction.verification.engines.statespace.linearised.board import LinearBoard
from taction.verification.engines.statespace.linearised.state_space import linear_matrices

NONE = 1e-13  # of the largest 1/p: smaller values are the rounding of 0


def slow_poles(board: LinearBoard) -> Complexes:
    """Return the poles that are not too fast for the inverse, 1/s, in no order.

    Raises
    ------
    numpy.linalg.LinAlgError
        The board has no equilibrium, or a pole at zero.

    Notes
    -----
    Costs one dense factorisation of all unknowns and one eigenproblem (n = 91: 4 ms).
    """
    matrices = linear_matrices(board.descriptor, board.operating_point)
    scale = np.abs(matrices.stiffness).max(axis=1, keepdims=True)
    charged = np.flatnonzero(matrices.mass.any(axis=0))
    K, M = matrices.stiffness / scale, matrices.mass[:, charged] / scale
    times = np.linalg.solve(K, M)
    times += np.linalg.solve(K, M - K @ times)
    inverse = np.linalg.eigvals(times[charged]).astype(np.complex128)
    large = inverse[np.abs(inverse) > NONE * np.abs(inverse).max(initial=0.0)]
    return np.asarray(1.0 / large)
