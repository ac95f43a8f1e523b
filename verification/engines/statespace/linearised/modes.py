"""Modes of ``x' = A x + b``: eigenvalues with left and right vectors, and their errors."""

from __future__ import annotations

import functools
from collections.abc import Iterator, Sequence
from dataclasses import replace

import numpy as np

from taction.system.array_types import Bools, Complexes, Floats, Ints
from taction.system.data_classes import dataclass
from taction.verification.engines.statespace.equations.mirror_symmetry import Halves
from taction.verification.engines.statespace.linearised.block import Block
from taction.verification.engines.statespace.linearised.decomposition import decompose_block
from taction.verification.engines.statespace.linearised.real_modes import Joined, both


@dataclass(frozen=True, eq=False)
class Modes:
    """``A = right (diag(poles) + couplings within blocks) left`` with ``left right = 1``.

    `blocks` are the modes of A, or with `halves` those of its even and odd part; `poles` are the
    eigenvalues, 1/s, rightmost first.
    """

    blocks: tuple[Block, ...]
    halves: Halves | None
    poles: Complexes
    _order: Ints

    @functools.cached_property
    def right(self) -> Complexes:
        """Basis vectors as columns, (n, n): eigenvectors where `alone`."""
        parts = [block.columns() for block in self.blocks]
        whole = parts[0] if self.halves is None else self.halves.join(*parts)
        return whole[:, self._order]

    @functools.cached_property
    def left(self) -> Complexes:
        """Dual vectors as rows, (n, n)."""
        parts = [block.rows().T for block in self.blocks]
        if self.halves is not None:
            even, odd = parts
            parts = [self.halves.join(even * self.halves.share[:, None], 0.5 * odd)]
        return parts[0].T[self._order]

    def checked(self, between: Floats) -> Modes:
        """Return the modes of one block with bounds between each two of them, (n, n), 1/s."""
        (block,) = self.blocks
        measured = np.empty_like(between)
        measured[np.ix_(self._order, self._order)] = between
        return replace(self, blocks=(replace(block, measured=measured),))

    @property
    def defect(self) -> float:
        """Largest element of ``left right - 1``; infinite where the modes are defective."""
        return max(block.defect for block in self.blocks)

    @functools.cached_property
    def alone(self) -> Bools:
        """Whether each mode has a direction of its own, (n,)."""
        return np.concatenate([block.alone for block in self.blocks])[self._order]

    @functools.cached_property
    def mates(self) -> Ints:
        """Place of the complex conjugate of each mode, its own of a real one, (n,)."""
        places: list[Ints] = []
        for block in self.blocks:
            count = len(block.kept)
            own, first = np.arange(len(block.right)), sum(map(len, places))
            twins = np.concatenate([own[: block.real], own[count:], own[block.real : count]])
            places.append(first + twins)
        inverse = np.empty_like(self._order)
        inverse[self._order] = np.arange(len(inverse))
        return inverse[np.concatenate(places)[self._order]]

    @property
    def centres(self) -> Complexes:
        """Poles, and for joined modes their common centre, 1/s, (n,)."""
        parts = [both(block.kept, block.real) for block in self.blocks]
        return np.concatenate(parts)[self._order]

    @functools.cached_property
    def rates(self) -> Floats:
        """Rate of the envelope of each mode, 1/s, (n,)."""
        return np.concatenate([block.rates for block in self.blocks])[self._order]

    @functools.cached_property
    def pole_errors(self) -> Floats:
        """Bound on the rounding error of each pole, 1/s, (n,)."""
        return np.concatenate([block.pole_errors for block in self.blocks])[self._order]

    def amplitudes(self, C: Floats, deviation: Floats) -> Complexes:
        """Return the share of each mode in each row of ``C x`` at t = 0, shape (len(C), n).

        ``C x(t) = sum_i amplitudes[:, i] exp(poles[i] t)`` for ``x(0) = deviation`` where every
        mode is alone.
        """
        parts = zip(self.blocks, *self._split(C, deviation), strict=True)
        factors = (block.shares(rows, part) for block, rows, part in parts)
        return np.concatenate([seen * dual for seen, dual in factors], axis=1)[:, self._order]

    def heights(self, C: Floats, deviation: Floats) -> Floats:
        """Return the height of each mode's envelope in each row of ``C x``, (len(C), n)."""
        parts = zip(self.blocks, *self._split(C, deviation), strict=True)
        found = []
        for block, rows, part in parts:
            seen, _ = block.shares(rows, part)
            found.append(np.abs(seen) * block.envelopes(rows, part)[1])
        return np.concatenate(found, axis=1)[:, self._order]

    def joined(
        self, C: Floats, deviation: Floats
    ) -> Iterator[tuple[complex, Joined, Complexes, Complexes]]:
        """Yield the centre of joined modes, the modes, ``C right`` and ``left deviation``.

        One of each conjugate pair, with twice its share.
        """
        for block, rows, part in zip(self.blocks, *self._split(C, deviation), strict=True):
            seen, dual = block.shares(rows, part)
            for each in block.joined:
                at, twice = each.members, 1.0 + (each.members[0] >= block.real)
                yield complex(block.kept[at[0]]), each, twice * seen[:, at], dual[at]

    def terms(self, C: Floats, deviation: Floats) -> Floats:
        """Return the sizes of the sums in `amplitudes`: ``|C right| |left| |deviation|``."""
        rows, (size, *_) = self._split(C, np.abs(deviation))  # the terms of an odd part add up too
        parts = zip(self.blocks, rows, strict=True)
        terms = [block.terms(C, size[: len(block.right)]) for block, C in parts]
        return np.concatenate(terms, axis=1)[:, self._order]

    def errors(self, C: Floats, deviation: Floats) -> tuple[Floats, Floats]:
        """Return bounds on the error of each mode's part of ``C x``; see `Block.errors`."""
        parts = zip(self.blocks, *self._split(C, deviation), strict=True)
        pairs = zip(*(block.errors(rows, part) for block, rows, part in parts), strict=True)
        lag, vague = (np.concatenate(pair, axis=1)[:, self._order] for pair in pairs)
        return lag, vague

    def _split(self, C: Floats, x: Floats) -> tuple[Sequence[Floats], Sequence[Floats]]:
        """Return the rows and the vector for each block."""
        if self.halves is None:
            return (C,), (x,)
        return self.halves.split_rows(C), self.halves.split_vectors(x)


def decompose(
    matrices: Sequence[Floats],
    halves: Halves | None = None,
    sizes: Sequence[Floats] | None = None,
) -> Modes:
    """Decompose a matrix, shape (n, n), by one dense eigenproblem (about 25 n³ flops).

    With `halves`, `matrices` are its even and odd part, and two eigenproblems of half the size cost
    a quarter. `sizes` are those of the elements to which their rounding is relative, by default
    their own. Never raises for finite matrices.
    """
    sizes = [np.abs(A) for A in matrices] if sizes is None else list(sizes)
    if halves is not None:  # elements of both are a sum or difference of the same two
        even, odd = sizes
        even = even.copy()
        paired = even[: halves.pairs, : halves.pairs]
        np.maximum(paired, odd, out=paired)
        sizes = [even, paired]
    decomposed = tuple(map(decompose_block, matrices, sizes))
    poles = np.concatenate([block.poles for block in decomposed])
    order = np.lexsort((-poles.imag, -poles.real))
    return Modes(decomposed, halves, poles[order], order)
