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

from spice_models.array_types import Bools, Complexes, Floats, Ints

EPS = float(np.finfo(np.float64).eps)
SEPARABLE = 1e-2  # a step separates modes whose coupling is below this part of their distance
STEPS = 6  # largest number of steps
ROUNDED = 4 * EPS  # of its terms: a smaller coupling is rounding
CONVERGED = 1e-6  # largest turn of a step: the next one would be its square
STALLED = 0.1  # of the last turn: a larger one is rounding


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

    def coupling_terms(self) -> Floats:
        """Return the sizes of the sums in ``left A right`` for the kept rows, (k, n), 1/s."""
        right = _sizes(self.right, self.real)
        return np.asarray(self._left_sizes[: len(self.kept)] @ (self.size @ right))

    def spread(self) -> Floats:
        """Return `modes.Modes.spread` of this block, (n,), 1/s."""
        if not math.isfinite(self.defect):
            return np.full(len(self.right), np.inf)
        right = _sizes(self.right, self.real)
        terms = (self._left_sizes * (self.size @ right).T).sum(axis=1)
        rounding = EPS * (terms + 2.0 * np.abs(self.poles))
        return np.asarray(rounding + _both(self.coupled, self.real))

    def columns(self) -> Complexes:
        """Return the eigenvectors, (n, n)."""
        return _columns(self.right, self.real)

    def rows(self) -> Complexes:
        """Return the dual vectors, (n, n)."""
        return _both(_rows(self.left, self.real, len(self.kept)), self.real)


def decompose_block(A: Floats, size: Floats) -> Block:
    """Decompose A; the rounding of its elements is relative to `size`.

    The eigensolver's error is ``eps |A|``, which the fastest mode determines. `_refine` reduces it
    to the rounding of each mode by itself, which is smaller by orders of magnitude for slow modes.
    """
    block, before = _basis(*np.linalg.eig(A), size), math.inf
    for _ in range(STEPS):
        if not np.all(np.isfinite(block.left)):
            break
        block, turned = _refine(A, block)
        if turned < CONVERGED or turned > STALLED * before:
            break
        before = turned
    return block


def _basis(poles: Complexes, vectors: Complexes, size: Floats) -> Block:
    """Return eigenvectors as a block; its rows are infinite where the modes are defective."""
    kept, R, count = _real_columns(poles, vectors)
    # Row scaling makes the pivots independent of the states' amplitudes.
    scale = np.abs(R).max(axis=1, initial=0.0)
    scale[scale == 0.0] = 1.0
    inverse = _inverse(R / scale[:, None])
    return Block(kept, count, R, inverse / scale, np.zeros(len(kept)), size)


def _real_columns(poles: Complexes, vectors: Complexes) -> tuple[Complexes, Floats, int]:
    """Return the kept poles, the real columns of their vectors, and the number of real poles."""
    real, first = np.flatnonzero(poles.imag == 0.0), np.flatnonzero(poles.imag > 0.0)
    kept = np.concatenate([poles[real], poles[first]]).astype(np.complex128)
    ringing = vectors[:, first]
    columns = np.concatenate([vectors[:, real].real, ringing.real, -ringing.imag], axis=1)
    return kept, columns, len(real)


def _inverse(X: Floats) -> Floats:
    """Return the inverse; infinite elements for a singular matrix."""
    try:
        inverse = np.asarray(np.linalg.inv(X), dtype=np.float64)
    except np.linalg.LinAlgError:
        return np.full_like(X, np.inf)
    return inverse if np.all(np.isfinite(inverse)) else np.full_like(X, np.inf)


def _refine(A: Floats, block: Block) -> tuple[Block, float]:
    """Take one Newton step on all modes at once; return how far it turns them, too.

    Modes too close for a step are separated by an eigenproblem of their own, after which another
    step must follow (infinite turn). A coupling that is left is an error (`Block.coupled`).
    """
    R, L, real, count = block.right, block.left, block.real, len(block.kept)
    one = np.eye(len(A))
    rest = one - L @ R
    inner = L @ (A @ R) + _times_poles(rest, block.kept, real)
    reduced = _columns(_rows(inner, real, count), real)
    kept = reduced.diagonal().copy()
    np.fill_diagonal(reduced, 0.0)
    gap = _both(kept, real) - kept[:, None]
    with np.errstate(divide="ignore", invalid="ignore", over="ignore"):
        turn = reduced / gap
        close = ~(turn.real**2 + turn.imag**2 < SEPARABLE**2)  # and each to itself
    coupled = np.where(close, np.abs(reduced), 0.0)
    turn[close] = 0.0
    turning = _unmodal(turn, real, count)
    R, L = R + R @ turning, L + (rest - turning) @ L
    L = L + (one - L @ R) @ L
    refined = Block(kept, real, R, L, coupled.sum(axis=1), block.size)
    if coupled.any() and (groups := _groups(coupled > ROUNDED * block.coupling_terms(), real)):
        return _separated(refined, inner, groups), math.inf
    # The next step would correct a pole by products of two couplings.
    second = np.abs((turn[:, :count] * reduced[:, :count].T).sum(axis=1))
    with np.errstate(divide="ignore", invalid="ignore"):
        off = np.sqrt(second / np.abs(kept))
    return refined, float(max(np.abs(turn).max(initial=0.0), off.max(initial=0.0)))


def _groups(linked: Bools, real: int) -> list[Ints]:
    """Return the connected groups of more than one mode, by links to all modes, (k, n)."""
    count = len(linked)
    reach = linked[:, :count] | np.eye(count, dtype=np.bool_)
    reach[:, real:] |= linked[:, count:]
    reach |= reach.T
    while not np.array_equal(wider := reach @ reach, reach):
        reach = wider
    rows = np.unique(reach, axis=0)
    return [np.flatnonzero(row) for row in rows if row.sum() > 1]


def _separated(block: Block, inner: Floats, groups: list[Ints]) -> Block:
    """Separate the modes of each group; ``inner = left A right`` is block diagonal in groups."""
    real, n, count = block.real, len(inner), len(block.kept)
    alone = np.ones(count, dtype=np.bool_)
    poles, vectors = [_both(block.kept, real)], [_columns(np.eye(n), real)]
    for group in groups:
        alone[group] = False
        places = np.concatenate([group, group[group >= real] + count - real])
        values, V = np.linalg.eig(inner[np.ix_(places, places)])
        wide = np.zeros((n, len(places)), dtype=np.complex128)
        wide[places] = V
        poles.append(values)
        vectors.append(wide)
    both = _both(alone, real)
    poles[0], vectors[0] = poles[0][both], vectors[0][:, both]
    kept, turned, real = _real_columns(np.concatenate(poles), np.concatenate(vectors, axis=1))
    right, left = block.right @ turned, _inverse(turned) @ block.left
    return Block(kept, real, right, left, np.zeros(len(kept)), block.size)


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
