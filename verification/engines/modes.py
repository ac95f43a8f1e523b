"""Modes of ``x' = A x + b``: eigenvalues with left and right vectors, and how far to trust them."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

Floats = NDArray[np.float64]
Complexes = NDArray[np.complex128]


@dataclass(frozen=True, slots=True, eq=False)
class Modes:
    """``A = right diag(poles) left`` with ``left right = 1``.

    Attributes
    ----------
    poles : ndarray (n,)
        Eigenvalues, 1/s, rightmost first.
    right, left : ndarray (n, n)
        Columns are modes; rows are their dual vectors.
    condition : ndarray (n,)
        ``|left_i| |right_i|`` after scaling of the states, at least 1: how much a perturbation
        of A moves the pole.
    spread : ndarray (n,)
        First-order bound on the error of each pole that rounding in A's elements causes, 1/s:
        ``eps sum_jk |left_ij| |A_jk| |right_ki|``.
    defect : float
        Largest element of ``left right - 1``; infinite where the modes are defective.
    """

    poles: Complexes
    right: Complexes
    left: Complexes
    condition: Floats
    spread: Floats
    defect: float

    def amplitudes(self, C: Floats, deviation: Floats) -> Complexes:
        """Share of each mode in each row of ``C x``, shape (len(C), n).

        ``C x(t) = sum_i amplitudes[:, i] exp(poles[i] t)`` for ``x(0) = deviation``.
        """
        return np.asarray((C @ self.right) * (self.left @ deviation))


def decompose(A: Floats) -> Modes:
    """Decompose A, shape (n, n), at the cost of one dense eigenproblem (about 25 n³ flops).

    Never raises for finite A: a defective matrix shows in `Modes.defect` and `Modes.condition`.
    """
    poles, right = np.linalg.eig(A)
    order = np.lexsort((-poles.imag, -poles.real))
    poles = poles[order].astype(np.complex128)
    right = right[:, order].astype(np.complex128)
    # Row scaling: states of small amplitude must not decide the pivots.
    scale = np.abs(right).max(axis=1, initial=0.0)
    scale = np.where(scale > 0.0, scale, 1.0)
    scaled = right / scale[:, None]
    try:
        inverse = np.linalg.inv(scaled).astype(np.complex128)
    except np.linalg.LinAlgError:
        inverse = np.full_like(right, np.inf)
    if not np.all(np.isfinite(inverse)):
        nothing = np.full(len(poles), np.inf)
        return Modes(poles, right, inverse, nothing, nothing, np.inf)
    inverse = inverse + inverse @ (np.eye(len(A)) - scaled @ inverse)
    condition = np.linalg.norm(inverse, axis=1) * np.linalg.norm(scaled, axis=0)
    left = inverse / scale[None, :]
    moved = np.einsum("ij,ji->i", np.abs(left), np.abs(A) @ np.abs(right))
    defect = float(np.abs(left @ right - np.eye(len(A))).max(initial=0.0))
    return Modes(poles, right, left, condition, np.finfo(float).eps * moved, defect)
