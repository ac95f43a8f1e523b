"""Evaluate ``C exp(A t) d`` of a linear board at chosen nodes, with a bound on the error.

Modes that are alone give exponentials; those of a group exponentials times powers of the time.
"""

from __future__ import annotations

import copy
import functools
import math

import numpy as np

from taction.system.array_types import EPS, Complexes, Floats, Ints
from taction.verification.engines.statespace.linearised.block_modes import Group
from taction.verification.engines.statespace.linearised.modes import Modes

BLOCK = 512  # instants evaluated at a time
FADED = -90.0  # exponent below which a mode is left out: 1e-39 of its first amplitude
NEGLIGIBLE = 1e-18  # share of a mode, relative to the largest, below the rounding of any sum
LARGEST = 700.0  # exponent of a growing mode whose bound is a float
NOISE = 8 * EPS  # share of a mode, relative to the sum of its terms, that is only rounding
POWERS = 100  # largest number of powers of the time


class Exponentials:
    """``Re sum_i share_i (s_i t)^k_i / k_i! exp(p_i t)``: P m K multiplications for P instants.

    Attributes
    ----------
    poles : ndarray (m,)
        p, 1/s, one of each conjugate pair.
    powers : ndarray of int (m,)
        k; a term with a power follows that with the power below.
    scales : ndarray (m,)
        s, 1/s; 0 where the pole has no powers.
    rates : ndarray (m,)
        1/s, the largest first: no term exceeds its share times ``exp(rate t)``.
    share : ndarray (m, K)
        Share of each term in each output, twice that for pairs.
    """

    def __init__(self, poles: Complexes, powers: Ints, scales: Floats, share: Complexes) -> None:
        order = np.argsort(-(poles.real + scales), kind="stable")
        self.poles, self.powers, self.scales = poles[order], powers[order], scales[order]
        self.rates: Floats = self.poles.real + self.scales
        self.share = share[order]
        self._highest = int(powers.max(initial=0))

    @functools.cached_property
    def speeds(self) -> Floats:
        """Largest relative change of each term, 1/s, (m,)."""
        return np.abs(self.poles) + self.scales

    def basis(self, times: Floats, live: int | None = None) -> Complexes:
        """Return the terms with shares of 1 at `times`, shape (P, m), or only the first ones."""
        poles, powers = self.poles[:live], self.powers[:live]
        ring = np.flatnonzero(poles.imag)
        with np.errstate(over="ignore", invalid="ignore"):  # an unstable board overflows
            values = np.exp(np.outer(times, poles.real)).astype(np.complex128)
            angle = np.outer(times, poles.imag[ring])  # quicker than a complex exponential
            values.imag[:, ring] = values.real[:, ring] * np.sin(angle)
            values.real[:, ring] *= np.cos(angle)
            for k in range(1, self._highest + 1):
                higher = np.flatnonzero(powers >= k)
                values[:, higher] *= np.outer(times, self.scales[higher] / k)
        return values

    def _after(self, share: Complexes) -> Complexes:
        """Return the shares of the terms with one power more, at their places."""
        after, lower = np.zeros_like(share), np.flatnonzero(self.powers[1:])
        after[lower] = share[lower + 1]
        return after

    def derived(self, order: int) -> Complexes:
        """Return the shares of a time derivative, (m, K)."""
        share = self.share
        for _ in range(order):
            rising = self.scales[:, None] * self._after(share) if self._highest else 0.0
            share = share * self.poles[:, None] + rising
        return share

    def at(self, times: Floats, order: int = 0) -> Floats:
        """Return values, or their time derivatives, at `times` (P,), s; shape (P, K)."""
        return self._sums(times, self.derived(order))

    @functools.cached_property
    def _pairs(self) -> Complexes:
        """Shares of the values and of their derivatives, (m, 2 K)."""
        return np.hstack([self.share, self.derived(1)])

    def pair(self, times: Floats) -> tuple[Floats, Floats]:
        """Return values and their time derivatives, shape (P, K) each."""
        both = self._sums(times, self._pairs)
        return both[:, : self.share.shape[1]], both[:, self.share.shape[1] :]

    def _sums(self, times: Floats, weight: Complexes) -> Floats:
        """Return ``Re sum_i weight_i basis_i``, shape (P, columns of `weight`)."""
        values = np.empty((len(times), weight.shape[1]))
        for first in range(0, len(times), BLOCK):
            part = slice(first, first + BLOCK)
            live = self._live(float(times[part].min()))
            values[part] = _real_product(self.basis(times[part], live), weight[:live])
        return values

    def uniform(self, step: float, count: int) -> Floats:
        """Return values at ``step * (0 .. count - 1)``, (count, K), by 2 √count exponentials."""
        inner = math.isqrt(count) + 1
        outer, columns = -(-count // inner), self.share.shape[1]
        fine = self.basis(step * np.arange(inner, dtype=np.float64))
        starts = step * inner * np.arange(1, outer, dtype=np.float64)
        values = np.empty((outer, inner, columns))
        values[0] = _real_product(fine, self.share)
        live = self._live(step * inner)
        with np.errstate(over="ignore", invalid="ignore"):
            later = np.exp(np.outer(self.poles[:live], starts))[:, :, None]
            share, grown, following = self.share[:live, None, :], np.array(1.0), self.share
            for k in range(1, self._highest + 1):
                grown = grown * np.outer(self.scales[:live] / k, starts)[:, :, None]
                following = self._after(following)
                share = share + grown * following[:live, None, :]
            weight = (later * share).reshape(live, (outer - 1) * columns)
        rest = _real_product(fine[:, :live], weight).reshape(inner, outer - 1, columns)
        values[1:] = rest.transpose(1, 0, 2)
        return values.reshape(outer * inner, columns)[:count]

    def _live(self, time: float) -> int:
        """Return the number of terms, slowest first, that still matter at an instant, s."""
        return int(np.count_nonzero(self.rates * time > FADED))


class ModalFlow(Exponentials):
    """The modes of a board, for output rows C (K, n) and the deviation (size,) of all unknowns.

    `doubt` (K, n) is what the rows may miss of each mode. Modes are left out whose shares are
    negligible or within their rounding, and at each instant those that have decayed. `errors` (K,)
    are the largest of the `bounds`, `error` that of all.
    """

    def __init__(
        self, modes: Modes, C: Floats, deviation: Floats, doubt: Floats | None = None
    ) -> None:
        with np.errstate(invalid="ignore", over="ignore"):
            shares = modes.shares(C, deviation, doubt)
            share, terms, (lag, vague) = shares.amplitudes, shares.terms, shares.errors
            # Rounding excites every growing mode, as noise does in a circuit.
            faint = (modes.poles.real > 0.0) & (np.abs(share) < EPS * terms)
            share = np.where(faint, EPS * terms, share)
        size, alone = np.abs(share), modes.alone
        # One of each conjugate pair is enough.
        kept = alone & (modes.poles.imag >= 0.0)
        large = size.max(axis=0, initial=0.0)
        kept &= large > NEGLIGIBLE * large.max(initial=0.0)
        noise = alone & (modes.poles.real < 0.0) & np.all(size <= NOISE * terms, axis=0)
        kept &= ~noise
        pair = np.where(modes.poles[kept].imag > 0.0, 2.0, 1.0)
        poles, parts = [modes.poles[kept]], [(share[:, kept] * pair).T]
        powers, scales = [np.zeros(len(pair), dtype=np.int64)], [np.zeros(len(pair))]
        for group, seen, dual in shares.grouped():
            series = _series(group, seen, dual)
            parts.append(series)
            poles.append(np.full(len(series), group.centre))
            powers.append(np.arange(len(series)))
            scales.append(np.full(len(series), group.scale))
        super().__init__(
            np.concatenate(poles),
            np.concatenate(powers),
            np.concatenate(scales),
            np.concatenate(parts),
        )
        # Rounding of A and, by their condition number times eps, of the vectors.
        bounded = kept | ~alone
        twice = np.where(modes.alone[bounded] & (modes.poles[bounded].imag > 0.0), 2.0, 1.0)
        self._bounded = modes.rates[bounded]
        with np.errstate(divide="ignore", invalid="ignore"):
            self._lag = (lag[:, bounded] * twice).T
            self._vague = ((vague + terms * EPS)[:, bounded] * twice).T
            self._omitted = size[:, noise].sum(axis=1)
            peak = self._lag / (math.e * np.abs(self._bounded))[:, None]
        peak = np.where(self._lag == 0.0, 0.0, peak)
        most = (peak + self._vague).sum(axis=0) + self._omitted
        self.errors: Floats = np.nan_to_num(most, nan=math.inf)
        self.error = float(self.errors.max(initial=0.0))

    def columns(self, chosen: Ints) -> ModalFlow:
        """Return the flow of some outputs."""
        found = copy.copy(self)
        for name in ("share", "_lag", "_vague"):
            setattr(found, name, getattr(self, name)[:, chosen])
        found._omitted, found.errors = self._omitted[chosen], self.errors[chosen]
        found.__dict__.pop("_pairs", None)
        return found

    @property
    def bound_terms(self) -> tuple[Floats, Floats, Floats, Floats]:
        """Rates r (m,), lags l and errors v (m, K), and o (K,): ``sum (l t + v) exp(r t) + o``."""
        return self._bounded, self._lag, self._vague, self._omitted

    def bounds(self, times: Floats) -> Floats:
        """Return bounds on the rounding error at `times` (P,), to first order, shape (P, K)."""
        left = np.exp(np.minimum(np.outer(times, self._bounded), LARGEST))
        return np.asarray((times[:, None] * left) @ self._lag + left @ self._vague + self._omitted)


def _series(group: Group, seen: Complexes, dual: Complexes) -> Complexes:
    """Return the shares of the powers of the time in ``seen exp(inner t) dual``, (powers, K)."""
    terms, largest = [seen @ dual], float(np.abs(dual).sum())
    for _ in range(1, POWERS):
        dual = group.inner @ dual / group.scale
        if not float(np.abs(dual).sum()) > NEGLIGIBLE * largest:
            break
        terms.append(seen @ dual)
    return np.array(terms)


def _real_product(a: Complexes, b: Complexes) -> Floats:
    """Return the real part of a product at half the cost."""
    with np.errstate(over="ignore", invalid="ignore"):
        return np.asarray(a.real @ b.real - a.imag @ b.imag)
