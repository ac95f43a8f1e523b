"""Modes of a board: its poles, with right and left vectors, and bounds on what is wrong with them.

The equations ``M z' = K z + b`` have n poles. For any n right vectors V, left vectors W and a
matrix T, take the residual R and the correction F::

    R = M V T - K V,    F = (W M V)^-1 W R.

Theorem: if the columns of V satisfy the equations that have no charge, ``z = V y`` turns the
equations into ``y' = (T - F) y + (W M V)^-1 W b``. So the poles of the board are those of
``T - F``, and its step response is ``V exp((T - F) t) y(0)``, however V, W and T were found.

T is diagonal, with a triangular part for each group of nearly parallel modes. The diagonal of F
corrects the poles; the rest of F, and the rounding E of all these products (relative to the sizes
of the terms in M and K as they were stamped, `reduction.ROUNDED`), are couplings between modes:

- a pole errs by its own coupling, and by products of two over its distance to other poles
  (`pole_errors`: Gershgorin's discs);
- the response errs by ``V_j E_ji y_i`` times the divided difference of the two exponentials, which
  is at most the time t times the slower one, and at most the sum of both over the distance of the
  poles (`ModeShares.errors`, to first order for modes that are near one another).

Source: G. W. Stewart and J.-G. Sun, Matrix Perturbation Theory, 1990, chapters IV to VI (residual
bounds, Gershgorin for pencils).
"""

from __future__ import annotations

import functools
from dataclasses import dataclass

import numpy as np

from taction.system.array_types import Complexes, Floats, Ints
from taction.verification.engines.statespace.linearised.block_modes import (
    CERTAIN,
    BlockModes,
    balanced_sums,
    components,
    find_block_modes,
    newton_step,
)
from taction.verification.engines.statespace.linearised.reduction import (
    ROUNDED,
    Reduced,
)

LINKED = 16.0  # the square of a distance, over it: a larger coupling in both directions links
TIGHT = 0.9  # row sum of the couplings over distances, from which their series may not end
IRREDUCIBLE = 1e-18  # keeps the sizes of couplings irreducible


@np.errstate(over="ignore", invalid="ignore", divide="ignore")
def pole_errors(modes: BlockModes) -> Floats:
    """Bound the distance of every pole to its true pole, 1/s, (n,); infinite where unknown."""
    errors = _errors(modes)
    if modes.other is not None and len(errors):
        s, other = modes.poles, modes.other.poles
        there = np.abs(s[:, None] - other) + _errors(modes.other)
        errors = np.minimum(errors, there.min(axis=1))
    return errors


def _errors(modes: BlockModes) -> Floats:
    """Bound the errors of the poles of one set of vectors.

    What couples poles are E and, within groups, the triangular part of T. Poles whose couplings may
    exchange them form components. Beside a component, all others add a second order
    ``E (D - E)^-1 E``, D half the distance of a pole.
    """
    s, n = modes.poles, len(modes.T)
    unknown = np.full(n, np.inf)
    if not (n and modes.is_known):
        return unknown
    E = modes.coupling + np.abs(modes.T - np.diag(np.diag(modes.T)))
    gap, own = np.abs(s[:, None] - s), np.diag(E)
    linked = (gap**2 / LINKED < E * E.T) | (gap < 4.0 * (own[:, None] + own))
    for _ in range(n):
        label = components(linked)
        half = np.where(label[:, None] != label, gap / 2.0, np.inf)
        nearest = half.min(axis=1, initial=np.inf)
        with np.errstate(divide="ignore", invalid="ignore", over="ignore"):
            H = np.nan_to_num(E / nearest[:, None], nan=np.inf, posinf=1e300)
        tight = ~(balanced_sums(H, s) < TIGHT)
        if not tight.any():
            beyond = (E + E @ np.linalg.solve(np.eye(n) - H, H)) / half
            errors = _within(E + E @ beyond, label, s)
            tight = errors >= nearest
            if not tight.any():
                return errors
        more = linked | (tight[:, None] & (half <= 1.01 * nearest[:, None]))
        more |= more.T
        if np.array_equal(more, linked | linked.T):
            break
        linked = more
    return unknown


def _within(E: Floats, label: Ints, s: Complexes) -> Floats:
    """Bound the errors of the poles s within each component, with couplings E.

    Every true pole is nearer than the spectral radius of all sizes to one member, and discs that
    overlap are one set.
    """
    errors = np.diag(E).copy()
    numbers, counts = np.unique(label, return_counts=True)
    for number in numbers[counts > 1].tolist():
        own = np.flatnonzero(label == number)
        sizes, gap = E[np.ix_(own, own)], np.abs(s[own][:, None] - s[own])
        weak = IRREDUCIBLE * np.sqrt(np.outer(sizes.max(axis=1), sizes.max(axis=1)))
        disc = 1.01 * float(np.abs(np.linalg.eigvals(sizes + weak)).max())
        joined = components(gap <= 2.0 * disc)
        errors[own] = np.where(joined[:, None] == joined, gap + disc, 0.0).max(axis=1)
    return errors


@dataclass(frozen=True, eq=False)
class Modes(BlockModes):
    """``A = right (diag(poles) + couplings within groups) left`` with ``left right = 1``.

    `poles` are the eigenvalues, 1/s, rightmost first.
    """

    @classmethod
    def of(cls, found: BlockModes) -> Modes:
        """Return modes in the order of their poles."""
        order = np.lexsort((-found.poles.imag, -found.poles.real))
        place = np.append(np.argsort(order), -1)  # -1 stays -1
        both = np.ix_(order, order)
        return cls(
            reduced=found.reduced,
            T=found.T[both],
            group=found.group[order],
            mates=place[found.mates[order]],
            X=found.X[:, order],
            V=found.V[:, order],
            W=found.W[order],
            F=found.F[both],
            E=found.E[both],
            mixed=found.mixed[both],
            hidden=found.hidden[:, order],
            other=found.other,
        )

    @functools.cached_property
    def refined(self) -> Modes:
        """The same one Newton step later: vectors in which A is diagonal but for rounding."""
        basis = self.alone.all() and np.isfinite(self.defect)
        return Modes.of(newton_step(self)) if basis else self

    @property
    def right(self) -> Complexes:
        """Basis vectors as columns, (n, n): eigenvectors where `alone`."""
        return self.X

    @functools.cached_property
    def defect(self) -> float:
        """Largest element of ``left right - 1``; infinite where the vectors are no basis."""
        if not self.is_known:
            return np.inf
        off = np.abs(self.left @ self.X - np.eye(len(self.X))).max(initial=0.0)
        return float(off) if np.isfinite(off) else np.inf

    @property
    def centres(self) -> Complexes:
        """Poles, and for those of a group its centre, 1/s, (n,)."""
        found = self.poles.copy()
        for group in self.groups:
            found[group.members] = group.centre
        return found

    @functools.cached_property
    def rates(self) -> Floats:
        """Rate of the envelope of each mode, 1/s, (n,)."""
        found = self.poles.real.copy()
        for group in self.groups:
            found[group.members] = group.centre.real + group.scale
        return found

    @functools.cached_property
    def pole_errors(self) -> Floats:
        """Bound on the error of each pole, 1/s, (n,)."""
        return pole_errors(self)

    @functools.cached_property
    def mixing(self) -> tuple[Floats, Floats] | None:
        """Bounds on how couplings exchange modes: the rates of near ones, 1/s, and shares, (n, n).

        None where they are not known.
        """
        s, E, rates = self.poles, self.coupling, self.rates
        strong = ~(self.alone[:, None] & self.alone)
        gap = np.abs(np.where(strong, rates[:, None] - rates, s[:, None] - s))
        near = gap <= np.minimum(np.abs(rates)[:, None], np.abs(rates))
        apart = np.where(near, 0.0, E / np.where(near, 1.0, gap))
        if not (self.is_known and np.all(balanced_sums(apart, s) < CERTAIN)):
            return None
        more = np.linalg.inv(np.eye(len(s)) - 4.0 * apart)  # of higher orders
        close = np.where(near, E, 0.0)
        np.fill_diagonal(close, 0.5 * np.diag(E))  # it counts once
        return np.asarray(more @ close @ more), np.asarray(more @ apart)

    def shares(self, C: Floats, deviation: Floats, doubt: Floats | None = None) -> ModeShares:
        """Return the shares of the modes in the rows of ``C x`` (K, n) for a start.

        `deviation` (size,) are all unknowns at the start, less those at rest, V; `doubt` (K, n) is
        a bound on what the rows miss of each mode, by default nothing.
        """
        pencil = self.reduced.pencil
        with np.errstate(invalid="ignore", over="ignore"):
            dual = self.W @ (pencil.charges @ deviation)
            sizes = np.abs(self.W) @ (pencil.charge_sizes @ np.abs(deviation))
            unsure = ROUNDED * sizes + 2.0 * self.mixed @ np.abs(dual)
            terms = (np.abs(C) @ np.abs(self.right)) * sizes
        missed = np.zeros(C.shape) if doubt is None else doubt
        return ModeShares(self, C @ self.right, missed, dual, unsure, terms)

    @functools.cached_property
    def unseen(self) -> Floats:
        """Bound on the error of each mode in each of all unknowns, (size, n)."""
        return np.asarray(np.abs(self.reduced.pencil.basis) @ self.hidden)


@dataclass(frozen=True, slots=True, eq=False)
class ModeShares:
    """The shares of the modes in the rows (K,) of ``C x``, ``seen * dual``."""

    modes: Modes
    # `seen`, `doubt`: (K, n): ``C right``, and a bound on its error.
    seen: Complexes
    doubt: Floats
    # `dual`, `unsure`: (n,): ``W M`` times the deviation at the start, and a bound on its error.
    dual: Complexes
    unsure: Floats
    terms: Floats  # (K, n): sizes of the sums in the shares

    @property
    def amplitudes(self) -> Complexes:
        """Share of each mode in each row at t = 0, (K, n).

        ``C x(t) = sum_i amplitudes[:, i] exp(poles[i] t)`` where every mode is alone.
        """
        return self.seen * self.dual

    def _grown(self, sizes: Floats, *, transposed: bool) -> Floats:
        """Bound factors (..., n) of the shares at any time, over ``exp(rates t)``."""
        found = sizes.copy()
        for group in self.modes.groups:
            factor = group.growth if transposed else group.growth.T
            found[..., group.members] = sizes[..., group.members] @ factor
        return found

    @property
    def heights(self) -> Floats:
        """Height of each mode's envelope in each row, (K, n)."""
        return np.asarray(np.abs(self.seen) * self._grown(np.abs(self.dual), transposed=False))

    @property
    def errors(self) -> tuple[Floats, Floats]:
        """Bounds a, b (K, n) on the error of each mode's part of a row.

        The error is at most ``sum_i (a_i t + b_i) exp(rates_i t)``: couplings of modes that are
        near one another grow with the time, others are divided by their distance.
        """
        parts = self.modes.mixing
        if parts is None:
            unknown = np.full(self.seen.shape, np.inf)
            return unknown, unknown
        seen = self._grown(np.abs(self.seen) + self.doubt, transposed=True)
        dual = self._grown(np.abs(self.dual) + self.unsure, transposed=False)
        lag, vague = ((seen @ X) * dual + seen * (X @ dual) for X in parts)
        own = self._grown(np.abs(self.seen), transposed=True)
        missed = self._grown(self.doubt, transposed=True)
        vague += own * self._grown(self.unsure, transposed=False) + missed * dual
        return lag, vague


def find_modes(reduced: Reduced) -> Modes:
    """Return the modes of reduced equations by a dense eigenproblem (25 n³ flops).

    LinAlgError: A is not finite.
    """
    return Modes.of(find_block_modes(reduced))
