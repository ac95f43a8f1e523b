"""Modes of ``x' = A x + b``: eigenvalues with left and right vectors, and their errors."""

from __future__ import annotations

import functools
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from taction.system.array_types import EPS, Bools, Complexes, Floats, Ints
from taction.verification.engines.statespace.equations.mirror_symmetry import Halves
from taction.verification.engines.statespace.linearised.exactness import Exactness, accurate_sum
from taction.verification.engines.statespace.linearised.real_modes import (
    Block,
    both,
    column_sizes,
    complex_columns,
    complex_rows,
    decompose_block,
    mode_groups,
    row_sizes,
    separated,
    times_poles,
    turns,
    unmodal,
)

SPARE = 4.0  # times eps: rounding of a residual that was computed to twice the precision
ROUNDS = 3  # largest number of steps


def polished(A: Floats, block: Block, exactness: Exactness) -> Block:
    """Return the modes of the matrix before rounding, by Newton steps with accurate residuals.

    What remains is the rounding of the elements from which A was computed, and of the result.
    Modes that a step cannot separate are separated by an eigenproblem of their own first. The block
    is returned as it is where its rows are too far from the inverse of its columns for a step, as
    for defective modes: a step would lead away from the modes.
    """
    refined = block
    for _ in range(ROUNDS):
        if not block.is_refinable:
            return refined
        refined, inner, close = _step(A, block, exactness)
        if not close.any() or not (groups := mode_groups(close, block.real)):
            return refined
        block = separated(block, inner, groups)
    return refined


def _step(A: Floats, block: Block, exactness: Exactness) -> tuple[Block, Floats, Bools]:
    """Return the modes after a step, ``left A right``, and which modes are too close for a step."""
    R, L, real, count = block.right, block.left, block.real, len(block.kept)
    one = np.eye(len(A))
    diagonal = times_poles(one, block.kept, real)
    residual = accurate_sum([exactness.tail @ R], [(A, R), (-R, diagonal)])
    rest = accurate_sum([one], [(-L, R)])
    error = L @ residual
    error += rest @ error
    reduced = complex_columns(complex_rows(error, real, count), real)
    kept = block.kept + reduced.diagonal()
    np.fill_diagonal(reduced, 0.0)
    turn, close = turns(reduced, kept, real)
    coupled = np.where(close, np.abs(reduced), 0.0)
    turning = unmodal(turn, real, count)
    R, L = R + R @ turning, L + (rest - turning) @ L
    L = L + accurate_sum([one], [(-L, R)]) @ L
    overlap = both(complex_rows(accurate_sum([one], [(-L, R)]), real, count), real)
    refined = Block(kept, real, R, L, coupled.sum(axis=1), block.size)
    noise = _dependence(refined, exactness)
    noise += SPARE * EPS * (row_sizes(L, real) @ column_sizes(np.abs(residual), real))
    refined = replace(refined, noise=noise, overlap=np.abs(complex_columns(overlap, real)))
    return refined, diagonal + error, coupled > 0.0


def _dependence(block: Block, exactness: Exactness) -> Floats:
    """Return what the rounding of the board's elements adds to ``left A right``, (n, n), 1/s."""
    left, right = row_sizes(block.left @ exactness.left, block.real), exactness.right @ block.right
    moved = left**2 @ (exactness.stiffness**2 @ column_sizes(right, block.real) ** 2)
    speed = (column_sizes(block.right, block.real) * np.abs(block.poles)) ** 2
    moved += left[:, : len(speed)] ** 2 @ (exactness.mass**2 @ speed)
    return np.asarray(EPS * np.sqrt(moved))


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
