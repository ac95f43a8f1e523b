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
import math
from dataclasses import dataclass, replace

import numpy as np

from taction.system.array_types import EPS, Bools, Complexes, Floats, Ints
from taction.verification.engines.statespace.linearised.reduction import ROUNDED, Reduced

UNDRIVEN = 1e-6  # of its terms: a smaller response to the sources may be rounding
NARROW = 0.4  # of the decay rate: largest distance of a pole from the centre of its group
POWERS = 100  # largest number of powers of the time in a group
SAMPLED = (1e-2, 1e2, 120)  # first and last instant in units of the scale, and number
BALANCING = 20  # steps to units in which couplings are equal in both directions
CERTAIN = 0.2  # row sum of couplings over distances in these units, from which no bound is stated
SPARE = 1.05  # for what lies between the instants
LINKED = 16.0  # the square of a distance, over it: a larger coupling in both directions links
TIGHT = 0.9  # row sum of the couplings over distances, from which their series may not end
IRREDUCIBLE = 1e-18  # keeps the sizes of couplings irreducible


@dataclass(frozen=True, eq=False)
class Modes:
    """``A = right (diag(poles) + couplings within groups) left`` with ``left right = 1``.

    Vectors and poles, and what their residual says.
    """

    reduced: Reduced
    T: Complexes  # (n, n): poles, 1/s, and the triangular matrices of groups, along the diagonal
    # `group`, `mates`: (n,): number of the group of each mode, and the place of its conjugate; -1
    # in a group of several.
    group: Ints
    mates: Ints
    # `right`, `V`, `W`: (n, n): vectors of the states (eigenvectors where `alone`), then right and
    # left vectors of the pencil.
    right: Complexes
    V: Complexes
    W: Complexes
    # `F`, `E`: (n, n): what corrects T, 1/s, and a bound on the error of that.
    F: Complexes
    E: Floats
    mixed: Floats  # (n, n): bound on ``W M V - 1``
    hidden: Floats  # (k, n): bound on the error of V in unknowns without charge
    other: Modes | None = None  # modes found otherwise, whose poles may be better known

    @functools.cached_property
    def poles(self) -> Complexes:
        """The corrected poles, 1/s, (n,)."""
        return np.asarray(np.diag(self.T - self.F))

    @functools.cached_property
    def alone(self) -> Bools:
        """Whether a mode is the only one of its group, (n,)."""
        return np.asarray(np.bincount(self.group, minlength=1)[self.group] == 1)

    @functools.cached_property
    def groups(self) -> list[Group]:
        """The groups of more than one mode."""
        numbers = np.unique(self.group[~self.alone]).tolist()
        return [Group.of(self, np.flatnonzero(self.group == number)) for number in numbers]

    @functools.cached_property
    def coupling(self) -> Floats:
        """Bound on what the board has beside T with the corrected poles, 1/s, (n, n)."""
        return np.abs(self.F - np.diag(np.diag(self.F))) + self.E

    @functools.cached_property
    def left(self) -> Complexes:
        """The dual vectors of the states, (n, n)."""
        return np.asarray(self.W @ (self.reduced.pencil.M @ self.reduced.seen))

    @property
    def is_known(self) -> bool:
        """Whether the vectors are a basis."""
        return bool(np.all(np.isfinite(self.E)))

    @functools.cached_property
    def error(self) -> float:
        """Estimate of the error of the response to the sources, over its largest voltage.

        Without sources it is that of the response to a start with 1 V at every unknown.
        """
        if not self.is_known:
            return math.inf
        s, sizes, pencil = self.poles, np.abs(self.V), self.reduced.pencil
        fastest = float(np.abs(s).max(initial=0.0)) or 1.0
        speed = np.maximum(np.abs(s), 1e-12 * fastest)
        start = (self.W @ pencil.b).sum(axis=1) / speed
        largest = float(np.abs(self.V @ start).max(initial=0.0))
        terms = sizes @ (np.abs(self.W) @ np.abs(pencil.b).sum(axis=1) / speed)
        if not largest > UNDRIVEN * float(terms.max(initial=0.0)):  # 1 V at every unknown
            start, largest = np.abs(self.W @ pencil.M).sum(axis=1), 1.0
        gap = np.maximum(np.abs(s[:, None] - s), np.abs(s.real)[:, None])
        gap = np.maximum(gap, 1e-3 * speed)
        weight = np.abs(start)
        off = sizes @ ((self.coupling / gap) @ weight) + self.hidden @ weight
        return float(off.max(initial=0.0)) / largest

    @property
    def ordered(self) -> Modes:
        """The same with the rightmost pole first."""
        order = np.lexsort((-self.poles.imag, -self.poles.real))
        if np.all(np.diff(order) == 1):
            return self
        place, both = np.append(np.argsort(order), -1), np.ix_(order, order)  # -1 stays -1
        rows = {name: getattr(self, name)[order] for name in ("group", "W")}
        columns = {name: getattr(self, name)[:, order] for name in ("right", "V", "hidden")}
        squares = {name: getattr(self, name)[both] for name in ("T", "F", "E", "mixed")}
        return replace(self, mates=place[self.mates[order]], **rows, **columns, **squares)

    @functools.cached_property
    def defect(self) -> float:
        """Largest element of ``left right - 1``; infinite where the vectors are no basis."""
        if not self.is_known:
            return np.inf
        off = np.abs(self.left @ self.right - np.eye(len(self.right))).max(initial=0.0)
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
        """Bound on the distance of each pole to the true one, 1/s, (n,); infinite where unknown."""
        errors = _errors(self)
        if self.other is not None and len(errors):
            there = np.abs(self.poles[:, None] - self.other.poles) + _errors(self.other)
            errors = np.minimum(errors, there.min(axis=1))
        return errors

    @functools.cached_property
    def mixing(self) -> tuple[tuple[Floats, ...], tuple[Floats, ...]] | None:
        """Bounds on how couplings exchange modes: the rates of near ones, 1/s, and shares, (n, n).

        They are products of matrices; None where they are not known.
        """
        s, E, rates = self.poles, self.coupling, self.rates
        strong = ~(self.alone[:, None] & self.alone)
        gap = np.abs(np.where(strong, rates[:, None] - rates, s[:, None] - s))
        near = gap <= np.minimum(np.abs(rates)[:, None], np.abs(rates))
        apart = np.where(near, 0.0, E / np.where(near, 1.0, gap))
        if not (self.is_known and np.all(balanced_sums(apart, s) < CERTAIN)):
            return None
        more = np.asarray(np.linalg.inv(np.eye(len(s)) - 4.0 * apart))  # of higher orders
        close = np.where(near, E, 0.0)
        np.fill_diagonal(close, 0.5 * np.diag(E))  # it counts once
        return (more, close, more), (more, apart)

    def shares(self, C: Floats, deviation: Floats, doubt: Floats | None = None) -> ModeShares:
        """Return the shares of the modes in the rows of ``C x`` (K, n) for a start.

        `deviation` (size,) are all unknowns at the start, less those at rest, V; `doubt` (K, n) is
        a bound on what the rows miss of each mode, by default nothing.
        """
        pencil = self.reduced.pencil
        with np.errstate(invalid="ignore", over="ignore"):
            dual = self.W @ (pencil.M @ pencil.unknowns(deviation))
            size = pencil.mass @ pencil.unknowns(np.abs(deviation), sizes=True)
            sizes = np.abs(self.W) @ size
            unsure = ROUNDED * sizes + 2.0 * self.mixed @ np.abs(dual)
            terms = (np.abs(C) @ np.abs(self.right)) * sizes
        missed = np.zeros(C.shape) if doubt is None else doubt
        return ModeShares(self, C @ self.right, missed, dual, unsure, terms)

    @functools.cached_property
    def unseen(self) -> Floats:
        """Bound on the error of each mode in each of all unknowns, (size, n)."""
        return self.reduced.pencil.voltages(self.hidden, sizes=True)


@dataclass(frozen=True, eq=False)
class Group:
    """Nearly parallel modes: ``exp(T t)`` is ``exp(centre t) exp(inner t)`` among them."""

    members: Ints  # (m,): their places
    centre: complex
    inner: Complexes
    growth: Floats  # (m, m): G with ``|exp(inner t)| <= G exp(scale t)`` for t >= 0, by element
    scale: float  # 1/s

    @classmethod
    def of(cls, modes: Modes, members: Ints) -> Group:
        """Return the group of some places."""
        acting = modes.T[np.ix_(members, members)] - np.diag(modes.F.diagonal()[members])
        centre = complex(acting.diagonal().mean())
        inner, scale = acting - centre * np.eye(len(members)), 0.5 * abs(centre.real)
        growth = np.full(inner.shape, np.inf)
        if np.abs(inner.diagonal()).max() < NARROW * abs(centre.real):
            growth = _growth(np.asarray(inner / scale, dtype=np.complex128))
        return cls(members, centre, inner, growth, scale)


def _growth(inner: Complexes) -> Floats:
    """Return G with ``|exp(inner x)| <= G exp(x)`` for x >= 0; infinite where powers do not end."""
    powers = [np.eye(len(inner), dtype=np.complex128)]
    for k in range(1, POWERS):
        powers.append(powers[-1] @ inner / k)
        if np.abs(powers[-1]).max() * (k / math.e) ** k < EPS:
            break
    else:
        return np.full(inner.shape, np.inf)
    x = np.append(0.0, np.geomspace(*SAMPLED))
    weight = x[:, None] ** np.arange(len(powers)) * np.exp(-x)[:, None]
    return np.asarray(SPARE * np.abs(np.tensordot(weight, np.array(powers), 1)).max(axis=0))


@np.errstate(over="ignore", invalid="ignore", divide="ignore")
def _errors(modes: Modes) -> Floats:
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
        H = np.nan_to_num(E / nearest[:, None], nan=np.inf, posinf=1e300)
        tight = ~(balanced_sums(H, s) < TIGHT)
        if not tight.any():
            beyond = np.linalg.solve((np.eye(n) - H).T, E.T).T / half  # E (1 + H + H H + ...)
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
        root = np.sqrt(sizes.max(axis=1))  # of far poles a product overflows
        weak = IRREDUCIBLE * np.outer(root, root)
        disc = 1.01 * float(np.abs(np.linalg.eigvals(sizes + weak)).max())
        joined = components(gap <= 2.0 * disc)
        errors[own] = np.where(joined[:, None] == joined, gap + disc, 0.0).max(axis=1)
    return errors


def balanced_sums(H: Floats, s: Complexes) -> Floats:
    """Return the row sums of H >= 0 for modes s in units in which they are about the column sums.

    The largest bounds the spectral radius in any units. They start from the square roots of the
    poles' inverses (E. E. Osborne, J. ACM 7, 1960, all rows at once).
    """
    unit = 1.0 / np.sqrt(np.maximum(np.abs(s), 1e-30))
    for _ in range(BALANCING):
        rows, columns = (H @ unit) / unit, (1.0 / unit @ H) * unit
        if rows.max(initial=0.0) < CERTAIN:
            break
        unit = unit * (np.maximum(rows, 1e-30) / np.maximum(columns, 1e-30)) ** 0.25
    return np.asarray(rows)


def components(linked: Bools) -> Ints:
    """Return a number for each connected component of a graph, the least of its places, (n,)."""
    linked = linked | linked.T
    np.fill_diagonal(linked, val=True)
    label = np.arange(len(linked))
    while True:
        least = np.where(linked, label, len(label)).min(axis=1, initial=len(label))
        if np.array_equal(least, label):
            return label
        label = least


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
        lag, vague = (
            functools.reduce(np.matmul, part, seen) * dual
            + seen * functools.reduce(lambda x, X: X @ x, part[::-1], dual)
            for part in parts
        )
        own = self._grown(np.abs(self.seen), transposed=True)
        missed = self._grown(self.doubt, transposed=True)
        vague += own * self._grown(self.unsure, transposed=False) + missed * dual
        return lag, vague
