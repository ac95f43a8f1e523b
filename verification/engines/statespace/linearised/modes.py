"""Modes of ``x' = A x + b``: eigenvalues with left and right vectors, and how far to trust them."""

from __future__ import annotations

import functools
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from spice_models.array_types import Complexes, Floats, Ints
from verification.engines.statespace.equations.mirror_symmetry import Halves
from verification.engines.statespace.linearised.real_modes import Block, decompose_block


@dataclass(frozen=True, eq=False)
class Modes:
    """``A = right diag(poles) left`` with ``left right = 1``.

    Attributes
    ----------
    blocks : tuple of Block
        Modes of A, or of what it is on even and on odd vectors (`Halves`).
    halves : Halves or None
        How the two belong together.
    poles : ndarray (n,)
        Eigenvalues, 1/s, rightmost first.
    """

    blocks: tuple[Block, ...]
    halves: Halves | None
    poles: Complexes
    _order: Ints

    @functools.cached_property
    def right(self) -> Complexes:
        """Columns are modes, (n, n)."""
        parts = [block.columns() for block in self.blocks]
        whole = parts[0] if self.halves is None else self.halves.join(*parts)
        return whole[:, self._order]

    @functools.cached_property
    def left(self) -> Complexes:
        """Rows are their dual vectors, (n, n)."""
        parts = [block.rows().T for block in self.blocks]
        if self.halves is not None:
            even, odd = parts
            parts = [self.halves.join(even * self.halves.share[:, None], 0.5 * odd)]
        return parts[0].T[self._order]

    @property
    def condition(self) -> Floats:
        """``|left_i| |right_i|`` after scaling of the states, at least 1, (n,).

        How much a perturbation of A moves the pole.
        """
        left, right = np.abs(self.left), np.abs(self.right)
        scale = right.max(axis=1, initial=0.0)
        scale[scale == 0.0] = 1.0
        sizes = np.linalg.norm(left * scale, axis=1), np.linalg.norm(right.T / scale, axis=1)
        return np.asarray(sizes[0] * sizes[1])

    @functools.cached_property
    def spread(self) -> Floats:
        """First-order bound on the error of each pole by rounding in A's elements, (n,), 1/s.

        ``eps sum_jk |left_ij| |A_jk| |right_ki|``, and what couples it to poles too close to it.
        """
        return np.concatenate([block.spread() for block in self.blocks])[self._order]

    @property
    def defect(self) -> float:
        """Largest element of ``left right - 1``; infinite where the modes are defective."""
        return max(block.defect for block in self.blocks)

    def amplitudes(self, C: Floats, deviation: Floats) -> Complexes:
        """Share of each mode in each row of ``C x``, shape (len(C), n).

        ``C x(t) = sum_i amplitudes[:, i] exp(poles[i] t)`` for ``x(0) = deviation``.
        """
        parts = zip(self.blocks, *self._split(C, deviation), strict=True)
        shares = [block.amplitudes(rows, part) for block, rows, part in parts]
        return np.concatenate(shares, axis=1)[:, self._order]

    def terms(self, C: Floats, deviation: Floats) -> Floats:
        """Sizes of what adds up to `amplitudes`: ``|C right| |left| |deviation|``."""
        rows, (size, *_) = self._split(C, np.abs(deviation))  # of an odd part the terms add too
        parts = zip(self.blocks, rows, strict=True)
        found = [block.terms(C, size[: len(block.right)]) for block, C in parts]
        return np.concatenate(found, axis=1)[:, self._order]

    def _split(self, C: Floats, x: Floats) -> tuple[Sequence[Floats], Sequence[Floats]]:
        """Return rows and a vector as the blocks take them."""
        if self.halves is None:
            return (C,), (x,)
        return self.halves.split_rows(C), self.halves.split_vectors(x)


def decompose(blocks: Sequence[Floats], halves: Halves | None = None) -> Modes:
    """Decompose a matrix, shape (n, n), by one dense eigenproblem (about 25 n³ flops).

    Never raises for finite matrices: a defective one shows in `Modes.defect`.

    Parameters
    ----------
    blocks : sequence of ndarray
        The matrix; or what it is on even and on odd vectors, if an exchange commutes with it:
        two eigenproblems of half the size then do, at a quarter of the cost.
    halves : Halves, optional
        Of that exchange.
    """
    sizes = [np.abs(A) for A in blocks]
    if halves is not None:  # each element of both is a sum or difference of the same two
        even, odd = sizes
        own = even[: halves.pairs, : halves.pairs]
        np.maximum(own, odd, out=own)
        sizes = [even, own]
    found = tuple(map(decompose_block, blocks, sizes))
    poles = np.concatenate([block.poles for block in found])
    order = np.lexsort((-poles.imag, -poles.real))
    return Modes(found, halves, poles[order], order)
