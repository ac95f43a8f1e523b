"""Modes of one matrix, (nearly) defective ones joined, with the errors that rounding causes."""

from __future__ import annotations

import functools
import math
from typing import Any

import numpy as np
from numpy.typing import NDArray

from taction.system.array_types import EPS, Bools, Complexes, Floats, Ints
from taction.system.frozen import frozen
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


@frozen(eq=False, slots=False)
class Block:
    """Modes of ``A = right (diag(centres) + inner) left``, as real columns and rows.

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
            values[block.members] += np.linalg.eigvals(block.inner)
        return both(values, self.real)

    @property
    def centres(self) -> Complexes:
        """Eigenvalues of all modes, for joined modes their common centre, 1/s, (n,)."""
        return both(self.kept, self.real)

    @property
    def alone(self) -> Bools:
        """Whether each of all modes is a block of its own, (n,)."""
        alone = np.ones(len(self.kept), dtype=np.bool_)
        for block in self.joined:
            alone[block.members] = False
        return both(alone, self.real)

    @property
    def rates(self) -> Floats:
        """Rate of the envelope of each of all modes, 1/s, (n,)."""
        rates = self.kept.real.copy()
        for block in self.joined:
            rates[block.members] += block.scale(self.centre(block))
        return both(rates, self.real)

    @property
    def mates(self) -> Ints:
        """Place of the complex conjugate of each of all modes, its own of a real one, (n,)."""
        own, count = np.arange(len(self.right)), len(self.kept)
        return np.concatenate([own[: self.real], own[count:], own[self.real : count]])

    def centre(self, block: Joined) -> complex:
        """Return the common centre of joined modes, 1/s."""
        return complex(self.kept[block.members[0]])

    def grown(self, X: Floats, *, transposed: bool = True) -> Floats:
        """Multiply the rows of X, (n, ...), at joined modes by the growth within their blocks."""
        if not self.joined:
            return X
        grown, shift = X.copy(), len(self.kept) - self.real
        for block, G in zip(self.joined, self._growths, strict=True):
            factor = G.T if transposed else G
            for at in (block.members, block.members + shift)[: 1 + (block.members[0] >= self.real)]:
                grown[at] = factor @ X[at]
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
        right = column_sizes(self.right, self.real)
        speeds = np.abs(self.centres) + self.rates - self.centres.real
        return np.stack([right, right * speeds])

    @functools.cached_property
    def rest(self) -> Floats:
        """``1 - left right``, (n, n)."""
        with np.errstate(invalid="ignore", over="ignore"):
            return np.asarray(np.eye(len(self.right)) - self.left @ self.right)

    @functools.cached_property
    def defect(self) -> float:
        """Largest element of ``left right - 1``; infinite where the modes are defective."""
        off = float(np.abs(self.rest).max(initial=0.0))
        return off if math.isfinite(off) else math.inf

    @property
    def is_refinable(self) -> bool:
        """Whether Newton's steps converge: the rows are close to the inverse of the columns."""
        return self.defect * len(self.right) < 1.0

    @functools.cached_property
    def rounding(self) -> Floats:
        """What the rounding of A's elements adds to ``left A right``, (n, n), 1/s.

        Roundings are independent, so their squares add up: ``eps`` is three standard deviations of
        an element's rounding.
        """
        if self.measured is not None:
            return self.measured
        with np.errstate(over="ignore", invalid="ignore"):
            squares = self.left_sizes**2 @ (self.size**2 @ self.moving**2).sum(axis=0)
        return np.asarray(EPS * np.sqrt(np.where(np.isnan(squares), np.inf, squares)))

    @functools.cached_property
    def couplings(self) -> tuple[tuple[Floats, Floats], ...]:
        """What errors of ``left A right`` add to modes, from left and right, (n, n), by the time.

        The first pair grows with the time; the second is between modes that are far from one
        another, of which only its ratio to their distance counts.
        """
        E, centres = self.rounding.copy(), self.centres
        diagonal(E)[...] += 2.0 * EPS * np.abs(centres) + both(self.coupled, self.real)
        diagonal(E)[...] *= 0.5  # it counts once
        gap = np.abs(centres[:, None] - centres)
        near = gap <= np.abs(centres.real)
        if self.joined:
            near |= near.T
        wide = np.where(near, 0.0, 2.0 / np.where(near, 1.0, gap))
        return (E * near, E * near.T), (E * wide, E * wide.T)

    @functools.cached_property
    def missing(self) -> Floats:
        """Magnitudes of what the rows lack to the inverse of the columns, (n, n)."""
        return np.asarray(np.abs(both(complex_form(self.rest, self.real), self.real, axis=-2)))

    @functools.cached_property
    def pole_errors(self) -> Floats:
        """Bound on the error of each of all poles, 1/s, (n,).

        Every eigenvalue of ``D + E``, D diagonal, is within the spectral radius of ``|E|`` of an
        element of D: by Gershgorin's discs with the best scaling. Modes whose coupling by rounding
        is not small beside their distance are taken together, and couplings to others, of which
        only the product of both directions counts, are added.
        """
        if self.defect == math.inf:
            return np.full(len(self.right), np.inf)
        count, centres = len(self.kept), self.centres
        with np.errstate(over="ignore", invalid="ignore", divide="ignore"):
            if self.measured is None:
                E = UNITS * EPS * (self.left_sizes @ (self.size @ self.moving).sum(axis=0))
            else:
                E = self.measured.copy()
            diagonal(E)[...] += both(self.coupled, self.real)
            gap = np.abs(self.kept[:, None] - centres)
            mutual = E[:count] * E.T[:count]
            linked = mutual >= (LINKED * gap) ** 2
            diagonal(linked)[...] = False
            for block in self.joined:
                linked[block.places] = True
            second = np.where(linked | (gap == 0.0), 0.0, 2.0 * mutual / gap).sum(axis=-1)
        # Of a pole at zero: products of two.
        errors = diagonal(E)[:count] + second + EPS**2 * np.abs(centres).max(initial=0.0)
        self._add_groups(errors, linked, E, second)
        return both(errors, self.real)

    def _add_groups(self, errors: Floats, linked: Bools, E: Floats, second: Floats) -> None:
        """Write the errors, (k,), of linked modes into `errors`."""
        count, centres = len(errors), self.centres
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
        return both(complex_rows(self.left, self.real), self.real, axis=-2)

    def seen(self, C: Floats) -> Complexes:
        """Return ``C right`` of all modes for rows C (K, n)."""
        return complex_columns(C @ self.right, self.real)

    def dual(self, deviation: Floats) -> Complexes:
        """Return ``left deviation`` of all modes, (n,)."""
        return both(complex_rows(self.left @ deviation[:, None], self.real)[:, 0], self.real)

    def share_bounds(self, seen: Complexes, dual: Complexes) -> tuple[Floats, Floats]:
        """Bound ``C right`` (K, n) and ``left x(0)`` (n,) at any time, over ``exp(rates t)``."""
        return self.grown(np.abs(seen).T).T, self.grown(np.abs(dual), transposed=False)

    def share_errors(self, seen: Complexes, dual: Complexes) -> Floats:
        """Return bounds a, b, (2, K, n), on the error of ``C x`` by mode i, to first order.

        The error is at most ``sum_i (a_i t + b_i) exp(rates_i t)``: a change D of A changes ``C x``
        by ``sum_ij (C right)_j (left D right)_ji (left deviation)_i`` times the divided difference
        of the exponentials, which is at most t, and at most 2 over the distance of the poles. What
        the rows lack to the inverse of the columns is an error of `dual`.
        """
        shape = (2, *seen.shape)
        if self.defect == math.inf:
            return np.full(shape, np.inf)
        sizes, starts = self.share_bounds(seen, dual)
        found = np.empty(shape)
        with np.errstate(invalid="ignore", over="ignore"):
            for bound, (left, right) in zip(found, self.couplings, strict=True):
                bound[...] = (sizes @ left) * starts + sizes * (right @ starts)
            found[1] += sizes * (self.missing @ starts)
        return found


def spectral_radius(X: Floats) -> float:
    """Return the largest magnitude of an eigenvalue of a finite matrix, (n, n)."""
    return float(np.abs(np.linalg.eigvals(X)).max(initial=0.0))


def complex_form(X: Floats, real: int) -> Complexes:
    """Return a matrix between real columns as one between modes, without conjugate rows, (k, n)."""
    return complex_columns(complex_rows(X, real), real)


def diagonal(X: NDArray[Any]) -> NDArray[Any]:
    """Return the diagonal of the first columns of a matrix as a view."""
    view: NDArray[Any] = np.einsum("ii->i", X[:, : len(X)])
    return view
