"""Modes of ``x' = A x + b``: eigenvalues with left and right vectors, and their errors."""

from __future__ import annotations

import functools
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from taction.system.array_types import Complexes, Floats, Ints
from taction.verification.engines.statespace.equations.mirror_symmetry import Halves
from taction.verification.engines.statespace.linearised.exactness import Exactness
from taction.verification.engines.statespace.linearised.polished_modes import polished
from taction.verification.engines.statespace.linearised.real_modes import Block, decompose_block


@dataclass(frozen=True, eq=False)
class Modes:
    """``A = right diag(poles) left`` with ``left right = 1``.

    `blocks` are the modes of A, or with `halves` those of its even and odd part; `poles` are the
    eigenvalues, 1/s, rightmost first.
    """

    blocks: tuple[Block, ...]
    halves: Halves | None
    poles: Complexes
    _order: Ints

    @functools.cached_property
    def right(self) -> Complexes:
        """Eigenvectors as columns, (n, n)."""
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

    @property
    def scatter(self) -> float:
        """The largest `defect` of blocks whose `Block.errors` do not include it."""
        return max((b.defect for b in self.blocks if b.overlap is None), default=0.0)

    @property
    def defect(self) -> float:
        """Largest element of ``left right - 1``; infinite where the modes are defective."""
        return max(block.defect for block in self.blocks)

    def amplitudes(self, C: Floats, deviation: Floats) -> Complexes:
        """Return the share of each mode in each row of ``C x``, shape (len(C), n).

        ``C x(t) = sum_i amplitudes[:, i] exp(poles[i] t)`` for ``x(0) = deviation``.
        """
        parts = zip(self.blocks, *self._split(C, deviation), strict=True)
        shares = [block.amplitudes(rows, part) for block, rows, part in parts]
        return np.concatenate(shares, axis=1)[:, self._order]

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


def _decomposed(A: Floats, size: Floats, exactness: Exactness | None) -> Block:
    block = decompose_block(A, size)
    return block if exactness is None else polished(A, block, exactness)


def decompose(
    blocks: Sequence[Floats],
    halves: Halves | None = None,
    exactness: Sequence[Exactness | None] | None = None,
) -> Modes:
    """Decompose a matrix, shape (n, n), by one dense eigenproblem (about 25 n³ flops).

    With `halves`, `blocks` are the matrix's even and odd part, and two eigenproblems of half the
    size cost a quarter. `exactness` is that of each block. Never raises for finite matrices: a
    defective one shows in `Modes.defect`.
    """
    sizes = [np.abs(A) for A in blocks]
    if halves is not None:  # elements of both are a sum or difference of the same two
        even, odd = sizes
        paired = even[: halves.pairs, : halves.pairs]
        np.maximum(paired, odd, out=paired)
        sizes = [even, paired]
    known = (None,) * len(blocks) if exactness is None else exactness
    decomposed = tuple(map(_decomposed, blocks, sizes, known))
    poles = np.concatenate([block.poles for block in decomposed])
    order = np.lexsort((-poles.imag, -poles.real))
    return Modes(decomposed, halves, poles[order], order)
