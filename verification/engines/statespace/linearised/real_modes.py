"""Modes of one matrix in real arithmetic, where products of matrices cost a quarter.

Of a conjugate pair, real columns ``a, b`` stand for the vectors ``a - ib, a + ib``, and real
rows ``p, q`` for their duals ``(p + iq) / 2, (p - iq) / 2``. The real modes come first, then the
first of every pair, then the second ones: so all that follows is slices.
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
SEPARABLE = 1e-2  # modes coupled by less than this part of their distance can be told apart


@dataclass(frozen=True, eq=False)
class Block:
    """Modes of ``A = right diag(poles) left``, as real columns and rows.

    Attributes
    ----------
    kept : ndarray (k,)
        Eigenvalues, 1/s: the real ones, then of every pair that with the positive imaginary part.
    real : int
        How many of them are real.
    right, left : ndarray (n, n)
        Columns and rows; the rows are not finite where the modes are defective.
    coupled : ndarray (k,)
        What couples each mode to modes too close to it, 1/s.
    size : ndarray (n, n)
        What the rounding of A's elements is relative to, 1/s.
    """

    kept: Complexes
    real: int
    right: Floats
    left: Floats
    coupled: Floats
    size: Floats

    @property
    def poles(self) -> Complexes:
        """Of all modes, (n,)."""
        return _both(self.kept, self.real)

    def amplitudes(self, C: Floats, deviation: Floats) -> Complexes:
        """Share of each mode in each row of ``C x``, shape (len(C), n)."""
        dual = _rows(self.left @ deviation, self.real, len(self.kept))
        return np.asarray(_columns(C @ self.right, self.real) * _both(dual, self.real))

    def terms(self, C: Floats, size: Floats) -> Floats:
        """Sizes of what adds up to `amplitudes` of deviations of a `size`, (len(C), n)."""
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
        """First-order bound on the error of each pole, (n,), 1/s (see `modes.Modes`)."""
        if not math.isfinite(self.defect):
            return np.full(len(self.right), np.inf)
        right = _sizes(self.right, self.real)
        terms = (self._left_sizes * (self.size @ right).T).sum(axis=1)
        return np.asarray(EPS * terms + _both(self.coupled, self.real))

    def columns(self) -> Complexes:
        """Eigenvectors, (n, n)."""
        return _columns(self.right, self.real)

    def rows(self) -> Complexes:
        """Their dual vectors, (n, n)."""
        return _both(_rows(self.left, self.real, len(self.kept)), self.real)


def decompose_block(A: Floats, size: Floats) -> Block:
    """Decompose A; `size` is what the rounding of its elements is relative to."""
    poles, vectors = np.linalg.eig(A)
    flat, first = np.flatnonzero(poles.imag == 0.0), np.flatnonzero(poles.imag > 0.0)
    kept = np.concatenate([poles[flat], poles[first]]).astype(np.complex128)
    turning = vectors[:, first]
    R = np.concatenate([vectors[:, flat].real, turning.real, -turning.imag], axis=1)
    # Row scaling: states of small amplitude must not decide the pivots.
    scale = np.abs(R).max(axis=1, initial=0.0)
    scale[scale == 0.0] = 1.0
    try:
        inverse = np.linalg.inv(R / scale[:, None])
    except np.linalg.LinAlgError:
        inverse = np.full_like(R, np.inf)
    if not np.all(np.isfinite(inverse)):
        return Block(kept, len(flat), R, np.full_like(R, np.inf), np.full(len(kept), np.inf), size)
    return _refine(A, Block(kept, len(flat), R, inverse / scale, np.zeros(len(kept)), size))


def _refine(A: Floats, block: Block) -> Block:
    """Take one Newton step on all modes at once.

    The eigensolver's error is ``eps |A|``, set by the fastest mode; that of ``left A right`` is
    set mode by mode, some orders of magnitude smaller for the slow ones. Modes that are too close
    to separate keep their vectors, and what couples them counts as error (`Block.coupled`).
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
    """Add the conjugates of what belongs to pairs, along the first axis."""
    return np.concatenate([kept, kept[real:].conj()])


def _columns(X: NDArray[Any], real: int) -> Complexes:
    """Complex columns for real ones."""
    V, count = X.astype(np.complex128), (X.shape[1] + real) // 2
    turned = 1j * X[:, count:]
    V[:, count:] = V[:, real:count] + turned
    V[:, real:count] -= turned
    return V


def _sizes(X: Floats, real: int) -> Floats:
    """Magnitudes of the complex columns for real ones."""
    squares, count = X**2, (X.shape[1] + real) // 2
    squares[:, real:count] += squares[:, count:]
    squares[:, count:] = squares[:, real:count]
    return np.asarray(np.sqrt(squares))


def _rows(X: Floats, real: int, count: int) -> Complexes:
    """Complex rows for real ones, without the conjugate ones."""
    V = X[:count].astype(np.complex128)
    V.imag[real:] = X[count:]
    V[real:] *= 0.5
    return V


def _unmodal(V: Complexes, real: int, count: int) -> Floats:
    """Undo `_columns` and `_rows`."""
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
