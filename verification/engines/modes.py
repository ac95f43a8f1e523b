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
        ``eps sum_jk |left_ij| |A_jk| |right_ki|``, and what couples it to poles too close to it.
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
    poles, right = poles.astype(np.complex128), right.astype(np.complex128)
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
    left = inverse / scale[None, :]
    return _refine(A, poles, right, left)


def _refine(A: Floats, poles: Complexes, right: Complexes, left: Complexes) -> Modes:
    """Take one Newton step on all modes at once.

    The eigensolver's error is ``eps |A|``, set by the fastest mode; that of ``left A right`` is
    set mode by mode, some orders of magnitude smaller for the slow ones. Modes that are too close
    to separate keep their vectors, and what couples them counts as error (`Modes.spread`).
    """
    n = len(A)
    left = left + (np.eye(n) - left @ right) @ left
    reduced = left @ (A @ right)
    real = poles.imag == 0.0
    poles = reduced.diagonal().copy()
    poles.imag[real] = 0.0
    gap = poles[None, :] - poles[:, None]
    np.fill_diagonal(reduced, 0.0)
    separable = np.abs(reduced) < 0.01 * np.abs(gap)
    turn = np.where(separable, reduced, 0.0) / np.where(separable, gap, 1.0)
    coupling = np.abs(np.where(separable, 0.0, reduced)).sum(axis=1)
    right, left = right + right @ turn, left - turn @ left
    left = left + (np.eye(n) - left @ right) @ left
    defect = float(np.abs(left @ right - np.eye(n)).max(initial=0.0))
    scale = np.abs(right).max(axis=1, initial=0.0)
    scale = np.where(scale > 0.0, scale, 1.0)
    condition = np.linalg.norm(left * scale, axis=1) * np.linalg.norm(right.T / scale, axis=1)
    moved = np.einsum("ij,ji->i", np.abs(left), np.abs(A) @ np.abs(right))
    spread = np.finfo(float).eps * moved + coupling
    order = np.lexsort((-poles.imag, -poles.real))
    return Modes(
        poles[order], right[:, order], left[order], condition[order], spread[order], defect
    )
