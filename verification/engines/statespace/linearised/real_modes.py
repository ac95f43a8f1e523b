"""Compute the modes of one matrix in real arithmetic, where matrix products cost a quarter.

Real columns ``a, b`` represent the vectors ``a - ib, a + ib`` of a conjugate pair, and real rows
``p, q`` their duals ``(p + iq) / 2, (p - iq) / 2``. The real modes come first, then the first of
every pair, then the second of every pair, so that slices select them.
"""

from __future__ import annotations

import functools
import math
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from spice_models.array_types import Complexes, Floats

EPS = float(np.finfo(np.float64).eps)
SEPARABLE = 1e-2  # modes can be separated if their coupling is below this part of their distance


@dataclass(frozen=True, eq=False)
class Block:
    """Modes of ``A = right diag(poles) left``, as real columns and rows.

    Attributes
    ----------
    kept : ndarray (k,)
        Eigenvalues, 1/s: the `real` real ones, then that with Im > 0 of every pair.
    right, left : ndarray (n, n)
        Columns and rows; the rows are not finite where the modes are defective.
    coupled : ndarray (k,)
        Coupling of each mode to modes too close to it, 1/s.
    size : ndarray (n, n)
        Size of A's elements to which their rounding is relative, 1/s.
    """

    kept: Complexes
    real: int
    right: Floats
    left: Floats
    coupled: Floats
    size: Floats

    @property
    def poles(self) -> Complexes:
        """Eigenvalues of all modes, 1/s, (n,)."""
        return _both(self.kept, self.real)

    def amplitudes(self, C: Floats, deviation: Floats) -> Complexes:
        """Return the share of each mode in each row of ``C x``, shape (len(C), n)."""
        dual = _rows(self.left @ deviation, self.real, len(self.kept))
        return np.asarray(_columns(C @ self.right, self.real) * _both(dual, self.real))

    def terms(self, C: Floats, size: Floats) -> Floats:
        """Return the sizes of the sums in `amplitudes` for deviations of a `size`, (len(C), n)."""
        return np.asarray(np.abs(_columns(C @ self.right, self.real)) * (self._left_sizes @ size))

    @functools.cached_property
    def _left_sizes(self) -> Floats:
        """Magnitudes of the dual vectors, (n, n)."""
        sizes = _sizes(self.left.T, self.real).T
        sizes[self.real :] *= 0.5
        return sizes

    @functools.cached_property
    def defect(self) -> float:
        """Largest element of ``left right - 1``; infinite where the modes are defective."""
        with np.errstate(invalid="ignore"):
            off = np.abs(self.left @ self.right - np.eye(len(self.right))).max(initial=0.0)
        return float(off) if np.isfinite(off) else math.inf

    def spread(self) -> Floats:
        """Return `modes.Modes.spread` of this block, (n,), 1/s."""
        if not math.isfinite(self.defect):
            return np.full(len(self.right), np.inf)
        right = _sizes(self.right, self.real)
        terms = (self._left_sizes * (self.size @ right).T).sum(axis=1)
        return np.asarray(EPS * terms + _both(self.coupled, self.real))

    def columns(self) -> Complexes:
        """Return the eigenvectors, (n, n)."""
        return _columns(self.right, self.real)

    def rows(self) -> Complexes:
        """Return the dual vectors, (n, n)."""
        return _both(_rows(self.left, self.real, len(self.kept)), self.real)


def decompose_block(A: Floats, size: Floats) -> Block:
    """Decompose A; the rounding of its elements is relative to `size`."""
    poles, vectors = np.linalg.eig(A)
    real, first = np.flatnonzero(poles.imag == 0.0), np.flatnonzero(poles.imag > 0.0)
    kept = np.concatenate([poles[real], poles[first]]).astype(np.complex128)
    ringing = vectors[:, first]
    R = np.concatenate([vectors[:, real].real, ringing.real, -ringing.imag], axis=1)
    # Row scaling makes the pivots independent of the states' amplitudes.
    scale = np.abs(R).max(axis=1, initial=0.0)
    scale[scale == 0.0] = 1.0
    try:
        inverse = np.linalg.inv(R / scale[:, None])
    except np.linalg.LinAlgError:
        inverse = np.full_like(R, np.inf)
    if not np.all(np.isfinite(inverse)):
        return Block(kept, len(real), R, np.full_like(R, np.inf), np.full(len(kept), np.inf), size)
    return _refine(A, Block(kept, len(real), R, inverse / scale, np.zeros(len(kept)), size))


def _refine(A: Floats, block: Block) -> Block:
    """Take one Newton step on all modes at once.

    The eigensolver's error is ``eps |A|``, which the fastest mode determines. The error of
    ``left A right`` is separate for each mode, and smaller by orders of magnitude for slow modes.
    Modes too close to separate keep their vectors; their coupling is an error (`Block.coupled`).
    """
    R, L, real, count = block.right, block.left, block.real, len(block.kept)
    one = np.eye(len(A))
    rest = one - L @ R
    reduced = _rows(L @ (A @ R) + _times_poles(rest, block.kept, real), real, count)
    reduced = _columns(reduced, real)
    kept = reduced.diagonal().copy()
    np.fill_diagonal(reduced, 0.0)
    gap = _both(kept, real) - kept[:, None]
    with np.errstate(divide="ignore", invalid="ignore", over="ignore"):
        turn = reduced / gap
        close = np.nonzero(~(turn.real**2 + turn.imag**2 < SEPARABLE**2))  # and each to itself
    coupled = np.zeros(count)
    np.add.at(coupled, close[0], np.abs(reduced[close]))
    turn[close] = 0.0
    turning = _unmodal(turn, real, count)
    R, L = R + R @ turning, L + (rest - turning) @ L
    L = L + (one - L @ R) @ L
    return Block(kept, real, R, L, coupled, block.size)


def _both(kept: NDArray[Any], real: int) -> NDArray[Any]:
    """Append the conjugates of the pairs, along the first axis."""
    return np.concatenate([kept, kept[real:].conj()])


def _columns(X: NDArray[Any], real: int) -> Complexes:
    """Return complex columns for real ones."""
    V, count = X.astype(np.complex128), (X.shape[1] + real) // 2
    turned = 1j * X[:, count:]
    V[:, count:] = V[:, real:count] + turned
    V[:, real:count] -= turned
    return V


def _sizes(X: Floats, real: int) -> Floats:
    """Return the magnitudes of the complex columns for real ones."""
    squares, count = X**2, (X.shape[1] + real) // 2
    squares[:, real:count] += squares[:, count:]
    squares[:, count:] = squares[:, real:count]
    return np.asarray(np.sqrt(squares))


def _rows(X: Floats, real: int, count: int) -> Complexes:
    """Return complex rows for real ones, without their conjugates."""
    V = X[:count].astype(np.complex128)
    V.imag[real:] = X[count:]
    V[real:] *= 0.5
    return V


def _unmodal(V: Complexes, real: int, count: int) -> Floats:
    """Invert `_columns` and `_rows`."""
    first, second = V[:, real:count], V[:, count:]
    Z = np.concatenate([V[:, :real], 0.5 * (first + second), 0.5j * (first - second)], axis=1)
    X = np.concatenate([Z.real, Z.imag[real:]])
    X[real:] *= 2.0
    return np.asarray(X)


def _times_poles(X: Floats, kept: Complexes, real: int) -> Floats:
    """Multiply real columns by the poles of their modes."""
    count, pairs = len(kept), kept[real:]
    Y: Floats = X * _both(kept.real, real)
    Y[:, real:count] += X[:, count:] * pairs.imag
    Y[:, count:] -= X[:, real:count] * pairs.imag
    return Y
