"""Modes of ``x' = A x + b``: eigenvalues with left and right vectors, and their errors."""

from __future__ import annotations

import functools
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass, replace
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from taction.system.array_types import Bools, Complexes, Floats, Ints
from taction.verification.engines.statespace.equations.alike import of_one_kind
from taction.verification.engines.statespace.equations.mirror_symmetry import block_diagonal
from taction.verification.engines.statespace.linearised.block import (
    SHARING,
    Block,
    BlockShares,
    compute_together,
)
from taction.verification.engines.statespace.linearised.decomposition import decompose_blocks
from taction.verification.engines.statespace.linearised.real_modes import Joined, both


@dataclass(frozen=True, eq=False)
class Modes:
    """``A = right (diag(poles) + couplings within blocks) left`` with ``left right = 1``.

    `blocks` are the modes of the blocks along the diagonal of A; `poles` are the eigenvalues, 1/s,
    rightmost first.
    """

    blocks: tuple[Block, ...]
    poles: Complexes
    order: Ints

    @functools.cached_property
    def right(self) -> Complexes:
        """Basis vectors as columns, (n, n): eigenvectors where `alone`."""
        return block_diagonal([block.columns() for block in self.blocks])[:, self.order]

    @functools.cached_property
    def left(self) -> Complexes:
        """Dual vectors as rows, (n, n)."""
        return block_diagonal([block.rows() for block in self.blocks])[self.order]

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
        return _ordered((replace(block, kept=block.kept + moved, measured=measured),))

    @property
    def defect(self) -> float:
        """Largest element of ``left right - 1``; infinite where the modes are defective."""
        return max(float(block.defect) for block in self.blocks)

    @functools.cached_property
    def alone(self) -> Bools:
        """Whether each mode has a direction of its own, (n,)."""
        return np.concatenate([block.alone for block in self.blocks])[self.order]

    @functools.cached_property
    def mates(self) -> Ints:
        """Place of the complex conjugate of each mode, its own of a real one, (n,)."""
        places: list[Ints] = []
        for block in self.blocks:
            count = len(block.kept)
            own, first = np.arange(len(block.right)), sum(map(len, places))
            twins = np.concatenate([own[: block.real], own[count:], own[block.real : count]])
            places.append(first + twins)
        inverse = np.empty_like(self.order)
        inverse[self.order] = np.arange(len(inverse))
        return inverse[np.concatenate(places)[self.order]]

    @property
    def centres(self) -> Complexes:
        """Poles, and for joined modes their common centre, 1/s, (n,)."""
        parts = [both(block.kept, block.real) for block in self.blocks]
        return np.concatenate(parts)[self.order]

    @functools.cached_property
    def rates(self) -> Floats:
        """Rate of the envelope of each mode, 1/s, (n,)."""
        return np.concatenate([block.rates for block in self.blocks])[self.order]

    @functools.cached_property
    def pole_errors(self) -> Floats:
        """Bound on the rounding error of each pole, 1/s, (n,)."""
        return np.concatenate([block.pole_errors for block in self.blocks])[self.order]

    def shares(self, C: Floats, deviation: Floats) -> ModeShares:
        """Return the shares of the modes in the rows of ``C x`` for ``x(0) = deviation``."""
        ends = np.cumsum([len(block.right) for block in self.blocks])[:-1]
        rows, parts = np.split(C, ends, axis=1), np.split(deviation, ends)
        blocks = zip(self.blocks, rows, parts, strict=True)
        found = tuple(block.shares(some, part) for block, some, part in blocks)
        return ModeShares(found, self.order, deviation)


@dataclass(frozen=True, eq=False)
class ModeShares:
    """The shares of the modes in the rows (K,) of ``C x``, the rightmost mode first.

    Attributes
    ----------
    parts : tuple of BlockShares
        Those of each block.
    order : ndarray (n,)
        Places of the modes of the blocks, rightmost first.
    deviation : ndarray (n,)
        The states at t = 0.
    """

    parts: tuple[BlockShares, ...]
    order: Ints
    deviation: Floats

    def _ordered(self, found: Iterable[NDArray[Any]]) -> NDArray[Any]:
        return np.concatenate(list(found), axis=1)[:, self.order]

    @property
    def amplitudes(self) -> Complexes:
        """Share of each mode in each row at t = 0, (K, n).

        ``C x(t) = sum_i amplitudes[:, i] exp(poles[i] t)`` where every mode is alone.
        """
        return self._ordered(part.values for part in self.parts)

    @property
    def heights(self) -> Floats:
        """Height of each mode's envelope in each row, (K, n)."""
        return self._ordered(np.abs(part.seen) * part.bounds[1] for part in self.parts)

    @property
    def terms(self) -> Floats:
        """Sizes of the sums in `amplitudes`: ``|C right| |left| |deviation|``, (K, n)."""
        size = np.abs(self.deviation)
        sizes = np.split(size, np.cumsum([len(part.dual) for part in self.parts])[:-1])
        for each in sizes[1:]:  # of the odd part of a board: a difference of what the even one adds
            np.maximum(each, sizes[0][: len(each)], out=each)
        pairs = zip(self.parts, sizes, strict=True)
        return self._ordered(part.terms(each) for part, each in pairs)

    @property
    def errors(self) -> tuple[Floats, Floats]:
        """Bounds on the error of each mode's part of a row, (K, n); see `BlockShares.errors`."""
        lag, vague = map(self._ordered, zip(*(part.errors for part in self.parts), strict=True))
        return lag, vague

    def joined(self) -> Iterator[tuple[complex, Joined, Complexes, Complexes]]:
        """Yield the centre of joined modes, the modes, ``C right`` and ``left deviation``.

        One of each conjugate pair, with twice its share.
        """
        for part in self.parts:
            for each in part.block.joined:
                at, twice = each.members, 1.0 + (each.members[0] >= part.block.real)
                yield part.block.centre(each), each, twice * part.seen[:, at], part.dual[at]


class Decomposable(NamedTuple):
    """The blocks of a matrix to decompose, (n, n) each, 1/s.

    `sizes` are those of `Block`, by default of the elements themselves.
    """

    matrices: Sequence[Floats]
    sizes: Sequence[Floats] | None = None

    @property
    def rounded(self) -> list[Floats]:
        """The sizes to which the rounding of the elements of each part is relative, (2, n, n)."""
        if self.sizes is None:
            return [np.stack([np.abs(A), 0.0 * A]) for A in self.matrices]
        return list(self.sizes)


def decompose_together(wanted: Sequence[Decomposable]) -> list[Modes]:
    """Decompose matrices, one dense eigenproblem (about 25 n³ flops) each.

    Blocks of one size are decomposed as a stack; each has the same digits beside others as alone.

    Raises
    ------
    LinAlgError
        A matrix is not finite.

    Examples
    --------
    >>> matrices = np.diag([-2.0, -1.0]), -3.0 * np.eye(1)
    >>> one, other = decompose_together([Decomposable([each]) for each in matrices])
    >>> one.poles.real.tolist(), other.poles.real.tolist()
    ([-1.0, -2.0], [-3.0])
    """
    sizes = [each.rounded for each in wanted]
    lengths = {
        (place, part): len(matrix)
        for place, each in enumerate(wanted)
        for part, matrix in enumerate(each.matrices)
    }
    found: dict[tuple[int, int], Block] = {}
    for same in of_one_kind(lengths):
        A, size = (
            of[0][None] if len(same) == 1 else np.stack(of)
            for of in (
                [wanted[place].matrices[part] for place, part in same],
                [sizes[place][part] for place, part in same],
            )
        )
        found.update(zip(same, decompose_blocks(A, size), strict=True))
    modes = list[Modes]()
    for place, each in enumerate(wanted):
        blocks = tuple(found[place, part] for part in range(len(each.matrices)))
        modes.append(_ordered(blocks))
    return modes


def _ordered(blocks: tuple[Block, ...]) -> Modes:
    poles = np.concatenate([block.poles for block in blocks])
    order = np.lexsort((-poles.imag, -poles.real))
    return Modes(blocks, poles[order], order)


def find_pole_errors(several: Sequence[Modes]) -> None:
    """Compute the errors of the poles of several matrices, those of one size as a stack."""
    compute_together([block for modes in several for block in modes.blocks], ["pole_errors"])


def find_share_errors(several: Sequence[Modes]) -> None:
    """Compute what the errors of their shares need, of matrices of one size as a stack."""
    compute_together([block for modes in several for block in modes.blocks], SHARING)


def decompose(matrices: Sequence[Floats], sizes: Sequence[Floats] | None = None) -> Modes:
    """Decompose one matrix, given its blocks, (n, n) each; see `decompose_together`."""
    (modes,) = decompose_together([Decomposable(matrices, sizes)])
    return modes
