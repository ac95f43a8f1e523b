"""Modes of ``x' = A x + b``: eigenvalues with left and right vectors, and their errors."""

from __future__ import annotations

import functools
from collections.abc import Callable, Iterator, Sequence
from dataclasses import replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from taction.system.array_types import Bools, Complexes, Floats, Ints
from taction.system.frozen import frozen
from taction.verification.engines.statespace.linearised.block import Block
from taction.verification.engines.statespace.linearised.decomposition import decompose_block
from taction.verification.engines.statespace.linearised.real_modes import Joined


def parted(X: Floats, sizes: Sequence[int]) -> list[Floats]:
    """Return the parts of the states along the last axis of X, given the number of each part."""
    ends = np.cumsum(sizes).tolist()
    return [X[..., end - size : end] for end, size in zip(ends, sizes, strict=True)]


def direct_sum(parts: Sequence[NDArray[Any]]) -> NDArray[Any]:
    """Return the block diagonal matrix of square parts."""
    if len(parts) == 1:
        return parts[0]
    whole, begin = np.zeros((sum(map(len, parts)),) * 2, dtype=parts[0].dtype), 0
    for part in parts:
        end = begin + len(part)
        whole[begin:end, begin:end] = part
        begin = end
    return whole


@frozen(eq=False, slots=False)
class Modes:
    """``A = right (diag(poles) + couplings within blocks) left`` with ``left right = 1``.

    `blocks` are the modes of each part of the states, on which A acts by itself; `poles` are the
    eigenvalues, 1/s, rightmost first.
    """

    blocks: tuple[Block, ...]

    @functools.cached_property
    def _all_poles(self) -> Complexes:
        return np.concatenate([block.poles for block in self.blocks])

    @functools.cached_property
    def order(self) -> Ints:
        """Places of the modes of the blocks, rightmost first, (n,)."""
        return np.lexsort((-self._all_poles.imag, -self._all_poles.real))

    @functools.cached_property
    def poles(self) -> Complexes:
        """Eigenvalues, 1/s, (n,)."""
        return self._all_poles[self.order]

    @functools.cached_property
    def right(self) -> Complexes:
        """Basis vectors as columns, (n, n): eigenvectors where `alone`."""
        return direct_sum([block.columns() for block in self.blocks])[:, self.order]

    @functools.cached_property
    def left(self) -> Complexes:
        """Dual vectors as rows, (n, n)."""
        return direct_sum([block.rows() for block in self.blocks])[self.order]

    def corrected(self, shifts: Complexes, between: Floats) -> Modes:
        """Return the modes of one block with poles moved by `shifts` (n,), 1/s.

        Then `between` (n, n), 1/s, are bounds on what is left between each two of them.
        """
        (block,) = self.blocks
        measured, moved = np.empty_like(between), np.empty_like(shifts)
        measured[np.ix_(self.order, self.order)] = between
        moved[self.order] = shifts
        moved = moved[: len(block.kept)]
        moved[: block.real].imag = 0.0
        return Modes((replace(block, kept=block.kept + moved, measured=measured),))

    @property
    def defect(self) -> float:
        """Largest element of ``left right - 1``; infinite where the modes are defective."""
        return max(block.defect for block in self.blocks)

    def _of_each(self, of: Callable[[Block], NDArray[Any]]) -> NDArray[Any]:
        """Return what blocks say of their modes, in the order of the modes."""
        return np.concatenate([of(block) for block in self.blocks])[self.order]

    @functools.cached_property
    def alone(self) -> Bools:
        """Whether each mode has a direction of its own, (n,)."""
        return self._of_each(lambda block: block.alone)

    @functools.cached_property
    def mates(self) -> Ints:
        """Place of the complex conjugate of each mode, its own of a real one, (n,)."""
        begins = np.cumsum([0, *(len(block.right) for block in self.blocks)]).tolist()
        pairs = zip(self.blocks, begins, strict=False)
        places = np.concatenate([begin + block.mates for block, begin in pairs])
        return np.asarray(np.argsort(self.order)[places[self.order]])

    @property
    def centres(self) -> Complexes:
        """Poles, and for joined modes their common centre, 1/s, (n,)."""
        return self._of_each(lambda block: block.centres)

    @functools.cached_property
    def rates(self) -> Floats:
        """Rate of the envelope of each mode, 1/s, (n,)."""
        return self._of_each(lambda block: block.rates)

    @functools.cached_property
    def pole_errors(self) -> Floats:
        """Bound on the rounding error of each pole, 1/s, (n,)."""
        return self._of_each(lambda block: block.pole_errors)

    def shares(self, C: Floats, deviation: Floats) -> ModeShares:
        """Return the shares of the modes in the rows of ``C x`` for ``x(0) = deviation``."""
        sizes = [len(block.right) for block in self.blocks]
        starts = parted(deviation, sizes)
        pairs = zip(self.blocks, parted(C, sizes), starts, strict=True)
        seen = tuple(block.seen(rows) for block, rows, _ in pairs)
        dual = tuple(map(Block.dual, self.blocks, starts))
        # The states of a further part are differences of what those of the first are sums of.
        size = np.abs(starts[0])
        for start in starts[1:]:
            np.maximum(size[: len(start)], np.abs(start), out=size[: len(start)])
        return ModeShares(self, seen, dual, size)


@frozen(eq=False, slots=False)
class ModeShares:
    """The shares of the modes in the rows (K,) of ``C x``, the rightmost mode first.

    Attributes
    ----------
    seen, dual : tuple of ndarray (K, n), and of ndarray (n,)
        ``C right`` and ``left x(0)`` of each block.
    size : ndarray
        Size of the states at t = 0.
    """

    modes: Modes
    seen: tuple[Complexes, ...]
    dual: tuple[Complexes, ...]
    size: Floats

    def _of_each(self, of: Callable[[Block, Complexes, Complexes], NDArray[Any]]) -> NDArray[Any]:
        """Return what blocks say of their modes, (..., n), in the order of the modes."""
        found = map(of, self.modes.blocks, self.seen, self.dual)
        return np.concatenate(list(found), axis=-1)[..., self.modes.order]

    @property
    def amplitudes(self) -> Complexes:
        """Share of each mode in each row at t = 0, (K, n).

        ``C x(t) = sum_i amplitudes[:, i] exp(poles[i] t)`` where every mode is alone.
        """
        return self._of_each(lambda block, seen, dual: seen * dual)

    @property
    def heights(self) -> Floats:
        """Height of each mode's envelope in each row, (K, n)."""
        return self._of_each(
            lambda block, seen, dual: np.abs(seen) * block.share_bounds(seen, dual)[1]
        )

    @property
    def terms(self) -> Floats:
        """Sizes of the sums in `amplitudes`: ``|C right| |left| |deviation|``, (K, n)."""

        def of(block: Block, seen: Complexes, dual: Complexes) -> Floats:
            spread = block.left_sizes @ self.size[: len(dual)]
            return block.share_bounds(seen, dual)[0] * spread

        return self._of_each(of)

    @property
    def errors(self) -> Floats:
        """Bounds on the error of each mode's part of a row, (2, K, n); see `Block.share_errors`."""
        return self._of_each(Block.share_errors)

    def joined(self) -> Iterator[tuple[complex, Joined, Complexes, Complexes]]:
        """Yield the centre of joined modes, the modes, ``C right`` and ``left deviation``.

        One of each conjugate pair, with twice its share.
        """
        for block, seen, dual in zip(self.modes.blocks, self.seen, self.dual, strict=True):
            for each in block.joined:
                at, twice = each.members, 1.0 + (each.members[0] >= block.real)
                yield block.centre(each), each, twice * seen[:, at], dual[at]


def decompose(matrices: Sequence[Floats], sizes: Sequence[Floats] | None = None) -> Modes:
    """Decompose the parts of a block diagonal matrix, a dense eigenproblem (25 n³ flops) each.

    `sizes` are those of `Block`, by default of the elements themselves.

    Raises
    ------
    LinAlgError
        A matrix is not finite.

    Examples
    --------
    >>> decompose([np.diag([-2.0, -1.0]), -3.0 * np.eye(1)]).poles.real.tolist()
    [-1.0, -2.0, -3.0]
    """
    sizes = [np.stack([np.abs(A), 0.0 * A]) for A in matrices] if sizes is None else sizes
    return Modes(tuple(map(decompose_block, matrices, sizes)))
