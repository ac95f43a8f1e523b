"""Modes of one matrix, (nearly) defective ones joined, with the errors that rounding causes."""

from __future__ import annotations

import functools
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from taction.system.array_types import EPS, Bools, Complexes, Floats, Ints
from taction.verification.engines.statespace.linearised.real_modes import (
    Joined,
    both,
    column_sizes,
    complex_columns,
    complex_rows,
    mode_groups,
    row_sizes,
)

UNITS = 32.0  # times rounding: error of an element, which several operations compute
LINKED = 0.25  # of the distance of two modes: with a larger coupling, rounding may join them


@dataclass(frozen=True, eq=False)
class Block:
    """Modes of ``A = right (diag(centres) + inner) left``, as real columns and rows.

    The arrays may have a leading axis: then they are a stack, the modes of several matrices with as
    many real modes. Joined modes have different sizes, so a stack with joined modes is one of one.

    Attributes
    ----------
    kept : ndarray (k,)
        Eigenvalues, 1/s: the `real` real ones, then that with Im > 0 of every pair; for joined
        modes, their common centre.
    right, left : ndarray (n, n)
        Columns and rows; the rows are not finite where the modes are defective.
    coupled : ndarray (k,)
        Coupling of each mode to modes too close to it, 1/s.
    size : ndarray (2, n, n)
        To what rounding is relative: sizes of the terms of A's elements, 1/s, and of the charges
        that a unit of ``x'`` moves, over those of the states.
    joined : tuple of Joined
        The modes that have no directions of their own.
    measured : ndarray (n, n), optional
        Bound on what is between each two of all modes, 1/s, where residuals of the equations tell
        it: in the place of the rounding of A's elements.
    """

    kept: Complexes
    real: int
    right: Floats
    left: Floats
    coupled: Floats
    size: Floats
    joined: tuple[Joined, ...] = ()
    measured: Floats | None = None

    @property
    def poles(self) -> Complexes:
        """Eigenvalues of all modes, 1/s, (n,)."""
        values = self.kept.copy()
        for block in self.joined:
            values[..., block.members] += np.linalg.eigvals(block.inner)
        return both(values, self.real)

    @property
    def alone(self) -> Bools:
        """Whether each of all modes is a block of its own, (n,)."""
        alone = np.ones(self.kept.shape, dtype=np.bool_)
        for block in self.joined:
            alone[..., block.members] = False
        return both(alone, self.real)

    @property
    def rates(self) -> Floats:
        """Rate of the envelope of each of all modes, 1/s, (n,)."""
        rates = self.kept.real.copy()
        for block in self.joined:
            rates[..., block.members] += block.scale(self.centre(block))
        return both(rates, self.real)

    def centre(self, block: Joined) -> complex:
        """Return the common centre of joined modes, 1/s."""
        return complex(self.kept[..., block.members[0]].item())

    def shares(self, C: Floats, deviation: Floats) -> BlockShares:
        """Return the shares of the modes in the rows ``C x`` (K, n) from ``x = deviation``, (n,).

        Those of a stack have leading axes.
        """
        moved = self.left @ deviation[..., None]
        dual = complex_rows(moved, self.real, self.kept.shape[-1])[..., 0]
        return BlockShares(self, complex_columns(C @ self.right, self.real), both(dual, self.real))

    def grown(self, X: Floats, *, transposed: bool = True) -> Floats:
        """Multiply the rows of X at joined modes by the growth within their blocks."""
        if not self.joined:
            return X
        grown, shift = X.copy(), self.kept.shape[-1] - self.real
        for block, G in zip(self.joined, self._growths, strict=True):
            factor = G.T if transposed else G
            for at in (block.members, block.members + shift)[: 1 + (block.members[0] >= self.real)]:
                grown[..., at, :] = factor @ X[..., at, :]
        return grown

    @functools.cached_property
    def _growths(self) -> list[Floats]:
        return [block.growth(self.centre(block)) for block in self.joined]

    @functools.cached_property
    def left_sizes(self) -> Floats:
        """Magnitudes of the dual vectors, (n, n)."""
        return row_sizes(self.left, self.real)

    @functools.cached_property
    def moving(self) -> Floats:
        """Magnitudes of the columns and of what A makes of them, (2, n, n).

        An error of charges is one of ``x'``, which a slow mode has little of.
        """
        right, centres = column_sizes(self.right, self.real), both(self.kept, self.real)
        speeds = np.abs(centres) + self.rates - centres.real
        return np.stack([right, right * speeds[..., None, :]], axis=-3)

    @functools.cached_property
    def rest(self) -> Floats:
        """``1 - left right``, (n, n)."""
        with np.errstate(invalid="ignore", over="ignore"):
            return np.asarray(np.eye(self.right.shape[-1]) - self.left @ self.right)

    @property
    def defect(self) -> Floats:
        """Largest element of ``left right - 1``, (); infinite where the modes are defective."""
        off = np.abs(self.rest).max(axis=(-2, -1), initial=0.0)
        return np.where(np.isfinite(off), off, np.inf)

    @property
    def is_refinable(self) -> Bools:
        """Whether Newton's steps converge, (): the rows are close to the inverse of the columns."""
        return np.asarray(self.defect * self.right.shape[-1] < 1.0)

    @functools.cached_property
    def rounding(self) -> Floats:
        """What the rounding of A's elements adds to ``left A right``, (n, n), 1/s.

        Roundings are independent, so their squares add up: ``eps`` is three standard deviations of
        an element's rounding.
        """
        if self.measured is not None:
            return self.measured
        with np.errstate(over="ignore", invalid="ignore"):
            squares = self.left_sizes**2 @ (self.size**2 @ self.moving**2).sum(axis=-3)
        return np.asarray(EPS * np.sqrt(np.where(np.isnan(squares), np.inf, squares)))

    @functools.cached_property
    def error(self) -> Floats:
        """Bound on the elements of ``left A right`` beside those of the modes, (n, n), 1/s."""
        E, own = self.rounding.copy(), np.abs(both(self.kept, self.real))
        diagonal(E)[...] += 2.0 * EPS * own + both(self.coupled, self.real)
        return E

    @functools.cached_property
    def couplings(self) -> tuple[tuple[Floats, Floats], ...]:
        """What `error` adds to modes, from the left and from the right, (n, n) each, by the time.

        The first pair grows with the time; the second is between modes that are far from one
        another, of which only its ratio to their distance counts.
        """
        E, centres = self.error.copy(), both(self.kept, self.real)
        diagonal(E)[...] *= 0.5  # it counts once
        gap = np.abs(centres[..., :, None] - centres[..., None, :])
        near = gap <= np.abs(centres.real)[..., None, :]
        if self.joined:
            near |= near.swapaxes(-1, -2)
        wide = np.where(near, 0.0, 2.0 / np.where(near, 1.0, gap))
        return (E * near, E * near.swapaxes(-1, -2)), (E * wide, E * wide.swapaxes(-1, -2))

    @functools.cached_property
    def missing(self) -> Floats:
        """Magnitudes of what the rows lack to the inverse of the columns, (n, n)."""
        return np.asarray(np.abs(both(complex_form(self.rest, self), self.real, axis=-2)))

    @functools.cached_property
    def pole_errors(self) -> Floats:
        """Bound on the error of each of all poles, 1/s, (n,).

        Every eigenvalue of ``D + E``, D diagonal, is within the spectral radius of ``|E|`` of an
        element of D: by Gershgorin's discs with the best scaling. Modes whose coupling by rounding
        is not small beside their distance are taken together, and couplings to others, of which
        only the product of both directions counts, are added.
        """
        count, finite = self.kept.shape[-1], np.isfinite(self.defect)
        with np.errstate(over="ignore", invalid="ignore", divide="ignore"):
            if self.measured is None:
                E = UNITS * EPS * (self.left_sizes @ (self.size @ self.moving).sum(axis=-3))
            else:
                E = self.measured.copy()
            diagonal(E)[...] += both(self.coupled, self.real)
            centres = both(self.kept, self.real)
            gap = np.abs(centres[..., :count, None] - centres[..., None, :])
            mutual = E[..., :count, :] * E.swapaxes(-1, -2)[..., :count, :]
            linked = mutual >= (LINKED * gap) ** 2
            diagonal(linked)[...] = False
            for block in self.joined:
                linked[(..., *block.places)] = True
            second = np.where(linked | (gap == 0.0), 0.0, 2.0 * mutual / gap).sum(axis=-1)
            errors = diagonal(E)[..., :count] + second
            # Of a pole at zero: products of two.
            errors += EPS**2 * np.abs(centres).max(axis=-1, initial=0.0, keepdims=True)
        for at in np.ndindex(finite.shape) if linked.any() else ():
            if finite[at]:
                self._add_groups(errors[at], linked[at], E[at], centres[at], second[at])
        errors[~finite] = np.inf
        return both(errors, self.real)

    def _add_groups(
        self, errors: Floats, linked: Bools, E: Floats, centres: Complexes, second: Floats
    ) -> None:
        """Write the errors, (k,), of linked modes of one matrix into `errors`."""
        count = len(errors)
        inner = np.zeros((count, count))
        for block in self.joined:
            inner[block.places] = np.abs(block.inner)
        for group in mode_groups(linked, self.real):
            at = np.concatenate([group, group[group >= self.real] + count - self.real])
            part, own = E[np.ix_(at, at)], inner[np.ix_(group, group)]
            moved = part.copy()
            moved[: len(group), : len(group)] += own
            if len(at) > len(group):  # and the conjugates
                pairs = np.flatnonzero(group >= self.real)
                places = np.arange(len(group), len(at))
                moved[np.ix_(places, places)] += own[np.ix_(pairs, pairs)]
            radius = spectral_radius(moved) + spectral_radius(own)
            apart = np.abs(centres[group, None] - centres[group]).max(initial=0.0)
            if np.any(linked[group][:, group[group >= self.real] + count - self.real]):
                apart = max(apart, 2.0 * float(np.abs(centres[group].imag).max()))
            errors[group] = radius + apart + second[group].max(initial=0.0)

    def columns(self) -> Complexes:
        """Return the eigenvectors, (n, n)."""
        return complex_columns(self.right, self.real)

    def rows(self) -> Complexes:
        """Return the dual vectors, (n, n)."""
        rows = complex_rows(self.left, self.real, self.kept.shape[-1])
        return both(rows, self.real, axis=-2)

    def taken(self, places: int | Ints) -> Block:
        """Return some matrices of a stack, or one without leading axis, with what is known."""
        measured = None if self.measured is None else self.measured[places]
        found = Block(
            self.kept[places],
            self.real,
            self.right[places],
            self.left[places],
            self.coupled[places],
            self.size[places],
            self.joined,
            measured,
        )
        known = self.__dict__
        found.__dict__.update((n, _part(known[n], places)) for n in KNOWN if n in known)
        return found

    def those(self, chosen: Bools) -> Block:
        """Return the chosen matrices of a stack, with what is known."""
        return self if chosen.all() else self.taken(np.flatnonzero(chosen))


KNOWN = ("left_sizes", "moving", "rest", "rounding", "error", "couplings", "missing", "pole_errors")
"""Cached parts of a block that a stack computes for all its matrices."""
SHARING = ("left_sizes", "couplings", "missing")
"""Those that the errors of shares need."""


def _part(value: Any, places: int | Ints) -> Any:
    if isinstance(value, tuple):
        return tuple(_part(each, places) for each in value)
    return value[places]


def stack_blocks(blocks: Sequence[Block]) -> Block:
    """Return blocks of one size and as many real modes, none joined or measured, as a stack."""
    first = blocks[0]
    parts = ([getattr(b, n) for b in blocks] for n in ("kept", "right", "left", "coupled", "size"))
    kept, right, left, coupled, size = map(np.stack, parts)
    stack = Block(kept, first.real, right, left, coupled, size)
    for name in ("left_sizes", "moving", "rest"):
        if all(name in block.__dict__ for block in blocks):
            stack.__dict__[name] = np.stack([block.__dict__[name] for block in blocks])
    return stack


def compute_together(blocks: Sequence[Block], names: Sequence[str]) -> None:
    """Compute some of the parts `KNOWN` of blocks; stacks of equal sizes take one call each.

    The results have the same digits as those that a block computes alone.
    """
    groups: dict[tuple[int, int], list[Block]] = {}
    for block in blocks:
        known = all(name in vars(block) for name in names)
        if not (known or block.joined) and block.measured is None:
            groups.setdefault((block.right.shape[-1], block.real), []).append(block)
    for group in groups.values():
        if len(group) > 1:
            stack = stack_blocks(group)
            for name in names:
                getattr(stack, name)
            for place, block in enumerate(group):
                block.__dict__.update(
                    (n, _part(value, place)) for n, value in stack.__dict__.items() if n in KNOWN
                )


@dataclass(frozen=True, eq=False)
class BlockShares:
    """The shares of a block's modes in rows of ``C x``: ``seen * dual``.

    Attributes
    ----------
    seen : ndarray (K, n)
        ``C right``.
    dual : ndarray (n,)
        ``left x(0)``.
    """

    block: Block
    seen: Complexes
    dual: Complexes

    @property
    def values(self) -> Complexes:
        """The shares at t = 0, (K, n)."""
        return np.asarray(self.seen * self.dual[..., None, :])

    @functools.cached_property
    def bounds(self) -> tuple[Floats, Floats]:
        """Bounds on both factors at any time, over ``exp(rates t)``."""
        grown = self.block.grown
        seen = grown(np.abs(self.seen).swapaxes(-1, -2)).swapaxes(-1, -2)
        return seen, grown(np.abs(self.dual)[..., None], transposed=False)[..., 0]

    def terms(self, size: Floats) -> Floats:
        """Return the sizes of the sums in the shares of deviations of a `size`, (K, n)."""
        spread = (self.block.left_sizes @ size[..., None])[..., None, :, 0]
        return np.asarray(self.bounds[0] * spread)

    @functools.cached_property
    def errors(self) -> tuple[Floats, Floats]:
        """Bounds a, b (K, n) on the error of ``C x`` by mode i, to first order.

        The error is at most ``sum_i (a_i t + b_i) exp(rates_i t)``: a change D of A changes ``C x``
        by ``sum_ij (C right)_j (left D right)_ji (left deviation)_i`` times the divided difference
        of the exponentials, which is at most t, and at most 2 over the distance of the poles. What
        the rows lack to the inverse of the columns is an error of `dual`.
        """
        finite = np.isfinite(self.block.defect)[..., None, None]
        seen, dual = self.bounds
        with np.errstate(invalid="ignore", over="ignore"):
            lag, vague = (
                (seen @ left) * dual[..., None, :]
                + seen * (right @ dual[..., None])[..., None, :, 0]
                for left, right in self.block.couplings
            )
            vague = vague + seen * (self.block.missing @ dual[..., None])[..., None, :, 0]
        return np.where(finite, lag, np.inf), np.where(finite, vague, np.inf)


def spectral_radius(X: Floats) -> float:
    """Return the largest magnitude of an eigenvalue of a finite matrix, (n, n)."""
    return float(np.abs(np.linalg.eigvals(X)).max(initial=0.0))


def complex_form(X: Floats, block: Block) -> Complexes:
    """Return a matrix between real columns as one between modes, without conjugate rows, (k, n)."""
    return complex_columns(complex_rows(X, block.real, block.kept.shape[-1]), block.real)


def diagonal(X: NDArray[Any]) -> NDArray[Any]:
    """Return the diagonal of the first columns of a matrix, or of each of a stack, as a view."""
    view: NDArray[Any] = np.einsum("...ii->...i", X[..., : X.shape[-2]])
    return view
