"""Compute the modes of one matrix in real arithmetic: pairs stay exact conjugates.

A real mode stays real, and no rounding separates a pair. Real columns ``a, b`` represent the
vectors ``a - ib, a + ib`` of a conjugate pair, and real rows ``p, q`` their duals ``(p + iq) / 2,
(p - iq) / 2``. The real modes come first, then the first of every pair, then the second of every
pair, so that slices select them.
"""

from __future__ import annotations

import functools
import math
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from taction.system.array_types import EPS, Bools, Complexes, Floats, Ints


def both(kept: NDArray[Any], real: int) -> NDArray[Any]:
    """Append the conjugates of the pairs, along the first axis."""
    return np.concatenate([kept, kept[real:].conj()])


def complex_columns(X: NDArray[Any], real: int) -> Complexes:
    """Return complex columns for real ones."""
    V, count = X.astype(np.complex128), (X.shape[1] + real) // 2
    turned = 1j * X[:, count:]
    V[:, count:] = V[:, real:count] + turned
    V[:, real:count] -= turned
    return V


def column_sizes(X: Floats, real: int) -> Floats:
    """Return the magnitudes of the complex columns for real ones."""
    squares, count = X**2, (X.shape[1] + real) // 2
    squares[:, real:count] += squares[:, count:]
    squares[:, count:] = squares[:, real:count]
    return np.asarray(np.sqrt(squares))


def row_sizes(X: Floats, real: int) -> Floats:
    """Return the magnitudes of the complex rows for real ones."""
    sizes = column_sizes(X.T, real).T
    sizes[real:] *= 0.5
    return sizes


def complex_rows(X: Floats, real: int, count: int) -> Complexes:
    """Return complex rows for real ones, without their conjugates."""
    V = X[:count].astype(np.complex128)
    V.imag[real:] = X[count:]
    V[real:] *= 0.5
    return V


def unmodal(V: Complexes, real: int, count: int) -> Floats:
    """Invert `_columns` and `_rows`."""
    first, second = V[:, real:count], V[:, count:]
    Z = np.concatenate([V[:, :real], 0.5 * (first + second), 0.5j * (first - second)], axis=1)
    X = np.concatenate([Z.real, Z.imag[real:]])
    X[real:] *= 2.0
    return np.asarray(X)


def times_poles(X: Floats, kept: Complexes, real: int) -> Floats:
    """Multiply real columns by the poles of their modes."""
    count, pairs = len(kept), kept[real:]
    Y: Floats = X * both(kept.real, real)
    Y[:, real:count] += X[:, count:] * pairs.imag
    Y[:, count:] -= X[:, real:count] * pairs.imag
    return Y


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


STEPS = 6  # largest number of steps
ROUNDED = 4.0  # times the rounding of A: a smaller coupling is rounding
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
    noise, overlap : ndarray (n, n) or None
        Bounds on the elements of ``left A right - diag(poles)``, 1/s, and of ``1 - left right``,
        where the modes were refined to twice the precision (`polished_modes`).
    """

    kept: Complexes
    real: int
    right: Floats
    left: Floats
    coupled: Floats
    size: Floats
    noise: Floats | None = None
    overlap: Floats | None = None

    @property
    def poles(self) -> Complexes:
        """Eigenvalues of all modes, 1/s, (n,)."""
        return both(self.kept, self.real)

    def amplitudes(self, C: Floats, deviation: Floats) -> Complexes:
        """Return the share of each mode in each row of ``C x``, shape (len(C), n)."""
        dual = complex_rows(self.left @ deviation, self.real, len(self.kept))
        return np.asarray(complex_columns(C @ self.right, self.real) * both(dual, self.real))

    def terms(self, C: Floats, size: Floats) -> Floats:
        """Return the sizes of the sums in `amplitudes` for deviations of a `size`, (len(C), n)."""
        return np.asarray(
            np.abs(complex_columns(C @ self.right, self.real)) * (self._left_sizes @ size)
        )

    @functools.cached_property
    def _left_sizes(self) -> Floats:
        """Magnitudes of the dual vectors, (n, n)."""
        return row_sizes(self.left, self.real)

    @functools.cached_property
    def rest(self) -> Floats:
        """``1 - left right``, (n, n)."""
        with np.errstate(invalid="ignore", over="ignore"):
            return np.asarray(np.eye(len(self.right)) - self.left @ self.right)

    @property
    def defect(self) -> float:
        """Largest element of ``left right - 1``; infinite where the modes are defective."""
        off = np.abs(self.rest).max(initial=0.0)
        return float(off) if np.isfinite(off) else math.inf

    @property
    def is_refinable(self) -> bool:
        """Whether Newton's steps converge: the rows are close to the inverse of the columns."""
        return self.defect * len(self.right) < 1.0

    def rounding(self) -> Floats:
        """Return what the rounding of A's elements adds to ``left A right``, (n, n), 1/s.

        Roundings are independent, so their squares add up: ``eps`` is three standard deviations of
        an element's rounding.
        """
        if self.noise is not None:
            return self.noise
        right = column_sizes(self.right, self.real) ** 2
        return np.asarray(EPS * np.sqrt(self._left_sizes**2 @ (self.size**2 @ right)))

    def errors(self, C: Floats, deviation: Floats) -> tuple[Floats, Floats]:
        """Return bounds a, b (len(C), n) on the error of ``C x`` by mode i, to first order.

        The error is at most ``sum_i (a_i t + b_i) exp(Re p_i t)``: a change D of A changes ``C x``
        by ``sum_ij (C right)_j (left D right)_ji (left deviation)_i`` times the divided difference
        of the exponentials, which is at most t, and at most 2 over the distance of the poles.
        """
        if not math.isfinite(self.defect):
            unknown = np.full((len(C), len(self.right)), np.inf)
            return unknown, unknown
        E, poles = self.rounding(), self.poles
        E[np.diag_indices(len(E))] += 2.0 * EPS * np.abs(poles) + both(self.coupled, self.real)
        E[np.diag_indices(len(E))] *= 0.5  # it counts once
        gap = np.abs(poles[:, None] - poles)
        near = gap <= np.abs(poles.real)
        wide = np.where(near, 0.0, 2.0 / np.where(near, 1.0, gap))
        seen = np.abs(complex_columns(C @ self.right, self.real))
        dual = np.abs(
            both(complex_rows(self.left @ deviation, self.real, len(self.kept)), self.real)
        )
        lag, vague = (
            (seen @ (E * part)) * dual + seen * ((E * part.T) @ dual) for part in (near, wide)
        )
        if self.overlap is not None:
            vague += seen * (self.overlap @ dual)
        return lag, vague

    def columns(self) -> Complexes:
        """Return the eigenvectors, (n, n)."""
        return complex_columns(self.right, self.real)

    def rows(self) -> Complexes:
        """Return the dual vectors, (n, n)."""
        return both(complex_rows(self.left, self.real, len(self.kept)), self.real)


def decompose_block(A: Floats, size: Floats) -> Block:
    """Decompose A; the rounding of its elements is relative to `size`.

    The eigensolver's error is ``eps |A|``, which the fastest mode determines. `_refine` reduces it
    to the rounding of each mode by itself, which is smaller by orders of magnitude for slow modes.
    `polished_modes` goes on to the modes of the matrix before rounding. Modes that are (nearly)
    defective stay as the eigensolver gives them: a step would lead away from them.
    """
    block, before = _basis(*np.linalg.eig(A), size), math.inf
    for _ in range(STEPS):
        if not block.is_refinable:
            break
        refined, turned = _refine(A, block)
        if not refined.is_refinable:
            break
        block = refined
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
    return np.asarray(inverse) if np.all(np.isfinite(inverse)) else np.full_like(X, np.inf)


def _refine(A: Floats, block: Block) -> tuple[Block, float]:
    """Take one Newton step on all modes at once; return how far it turns them, too.

    Modes too close for a step are separated by an eigenproblem of their own, after which another
    step must follow (infinite turn). A coupling that is left is an error (`Block.coupled`).
    """
    R, L, real, count = block.right, block.left, block.real, len(block.kept)
    one, rest = np.eye(len(A)), block.rest
    inner = L @ (A @ R) + times_poles(rest, block.kept, real)
    reduced = complex_columns(complex_rows(inner, real, count), real)
    kept = reduced.diagonal().copy()
    np.fill_diagonal(reduced, 0.0)
    turn, close = turns(reduced, kept, real)
    coupled = np.where(close, np.abs(reduced), 0.0)
    turning = unmodal(turn, real, count)
    R, L = R + R @ turning, L + (rest - turning) @ L
    L = L + (one - L @ R) @ L
    refined = Block(kept, real, R, L, coupled.sum(axis=1), block.size)
    if coupled.any() and (
        groups := mode_groups(coupled > ROUNDED * block.rounding()[:count], real)
    ):
        return separated(refined, inner, groups), math.inf
    # The next step would correct a pole by products of two couplings.
    second = np.abs((turn[:, :count] * reduced[:, :count].T).sum(axis=1))
    with np.errstate(divide="ignore", invalid="ignore"):
        off = np.sqrt(second / np.abs(kept))
    return refined, float(max(np.abs(turn).max(initial=0.0), off.max(initial=0.0)))


def separated(block: Block, inner: Floats, groups: list[Ints]) -> Block:
    """Separate the modes of each group; ``inner = left A right`` is block diagonal in groups."""
    real, n, count = block.real, len(inner), len(block.kept)
    alone = np.ones(count, dtype=np.bool_)
    poles, vectors = [both(block.kept, real)], [complex_columns(np.eye(n), real)]
    for group in groups:
        alone[group] = False
        places = np.concatenate([group, group[group >= real] + count - real])
        values, V = np.linalg.eig(inner[np.ix_(places, places)])
        wide = np.zeros((n, len(places)), dtype=np.complex128)
        wide[places] = V
        poles.append(values)
        vectors.append(wide)
    kept_alone = both(alone, real)
    poles[0], vectors[0] = poles[0][kept_alone], vectors[0][:, kept_alone]
    kept, turned, real = _real_columns(np.concatenate(poles), np.concatenate(vectors, axis=1))
    right, left = block.right @ turned, _inverse(turned) @ block.left
    return Block(kept, real, right, left, np.zeros(len(kept)), block.size)
