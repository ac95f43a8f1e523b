"""Evaluate ``C exp(A t) d`` of a linear board at chosen nodes: by modes, or by a ladder of powers.

Both ways give the value and its time derivative at any t >= 0, with a bound on the error. Modes are
much cheaper; the ladder needs no eigenvectors and serves where these are defective or
ill-conditioned.
"""

from __future__ import annotations

import math
from copy import copy
from typing import Protocol, Self

import numpy as np

from taction.system.array_types import EPS, Complexes, Floats, Ints
from taction.verification.engines.statespace.linearised.modes import Modes

TAYLOR = 20  # terms that give exp of a matrix of norm below 1/2 to rounding
BLOCK = 512  # instants evaluated at a time
FADED = -90.0  # exponent below which a mode is left out: 1e-39 of its first amplitude
NEGLIGIBLE = 1e-18  # share of a mode, relative to the largest, below the rounding of any sum
LARGEST = 700.0  # exponent of a growing mode whose bound is a float
NOISE = 8 * EPS  # share of a mode, relative to the sum of its terms, that is only rounding


class Flow(Protocol):
    """A deviation from the final value, as a function of time.

    `error` is the largest of the `bounds`.
    """

    error: float

    def at(self, times: Floats, order: int = 0) -> Floats:
        """Return the deviation, or its time derivative of an `order`, shape (P, K)."""
        ...

    def pair(self, times: Floats) -> tuple[Floats, Floats]:
        """Return the deviation and its time derivative, shape (P, K) each."""
        ...

    def chosen(self, times: Floats, columns: Ints, order: int) -> tuple[Floats, Floats]:
        """Return the derivatives of two orders from `order`, of one column at each time, (P,)."""
        ...

    def bounds(self, times: Floats) -> Floats:
        """Return bounds on the rounding error at `times` (P,), to first order, shape (P, K)."""
        ...

    def part(self, columns: Ints) -> Self:
        """Return the flow of some columns."""
        ...


class Exponentials:
    """``Re sum_i share_i exp(p_i t)``: P m K multiplications for P instants and m poles.

    `poles` (m,), 1/s, rightmost first, have one of each conjugate pair; `share` (m, K) is the share
    of each pole in each output, twice that for pairs.
    """

    def __init__(self, poles: Complexes, share: Complexes) -> None:
        self.poles, self.share = poles, share

    def at(self, times: Floats, order: int = 0) -> Floats:
        """Return values, or their time derivatives, at `times` (P,), s; shape (P, K)."""
        return self._sums(times, self.share * self.poles[:, None] ** order)

    def pair(self, times: Floats) -> tuple[Floats, Floats]:
        """See `Flow`."""
        both = self._sums(times, np.hstack([self.share, self.share * self.poles[:, None]]))
        return both[:, : self.share.shape[1]], both[:, self.share.shape[1] :]

    def _sums(self, times: Floats, weight: Complexes) -> Floats:
        """Return ``Re sum_i weight_i exp(p_i t)``, shape (P, columns of `weight`)."""
        values = np.empty((len(times), weight.shape[1]))
        for first in range(0, len(times), BLOCK):
            part = slice(first, first + BLOCK)
            live = self._live(float(times[part].min()))
            shape = _exponentials(times[part], self.poles[:live])
            values[part] = _real_product(shape, weight[:live])
        return values

    def chosen(self, times: Floats, columns: Ints, order: int) -> tuple[Floats, Floats]:
        """See `Flow`."""
        live = self._live(float(times.min(initial=math.inf)))
        terms = _exponentials(times, self.poles[:live]) * self.share[:live, columns].T
        terms *= self.poles[:live] ** order
        return terms.real.sum(axis=1), (terms @ self.poles[:live]).real

    def uniform(self, step: float, count: int) -> Floats:
        """Return values at ``step * (0 .. count - 1)``, (count, K), by 2 √count exponentials."""
        inner = math.isqrt(count) + 1
        outer, columns = -(-count // inner), self.share.shape[1]
        fine = _exponentials(step * np.arange(inner, dtype=np.float64), self.poles)
        starts = step * inner * np.arange(1, outer, dtype=np.float64)
        values = np.empty((outer, inner, columns))
        values[0] = _real_product(fine, self.share)
        live = self._live(step * inner)
        with np.errstate(over="ignore", invalid="ignore"):
            later = _exponentials(starts, self.poles[:live]).T[:, :, None]
            weight = (later * self.share[:live, None, :]).reshape(live, (outer - 1) * columns)
        rest = _real_product(fine[:, :live], weight).reshape(inner, outer - 1, columns)
        values[1:] = rest.transpose(1, 0, 2)
        return values.reshape(outer * inner, columns)[:count]

    def _live(self, time: float) -> int:
        """Return the number of modes, rightmost first, that still matter at an instant, s."""
        return int(np.count_nonzero(self.poles.real * time > FADED))


class ModalFlow(Exponentials):
    """The modes of a board, for output rows C (K, n) and the deviation (n,) from the final state.

    Modes are left out whose shares are negligible or within their rounding, and at each instant
    those that have decayed.
    """

    def __init__(self, modes: Modes, C: Floats, deviation: Floats) -> None:
        with np.errstate(invalid="ignore", over="ignore"):
            share = modes.amplitudes(C, deviation)
            terms = modes.terms(C, deviation)
            lag, vague = modes.errors(C, deviation)
            # Rounding excites every growing mode, as noise does in a circuit.
            faint = (modes.poles.real > 0.0) & (np.abs(share) < EPS * terms)
            share = np.where(faint, EPS * terms, share)
        size = np.abs(share)
        # One of each conjugate pair is enough.
        kept = modes.poles.imag >= 0.0
        large = size.max(axis=0, initial=0.0)
        kept &= large > NEGLIGIBLE * large.max(initial=0.0)
        noise = (modes.poles.real < 0.0) & np.all(size <= NOISE * terms, axis=0)
        kept &= ~noise
        pair = np.where(modes.poles[kept].imag > 0.0, 2.0, 1.0)
        super().__init__(modes.poles[kept], (share[:, kept] * pair).T)
        # Rounding of A and, by their condition number times eps, of the vectors.
        with np.errstate(divide="ignore", invalid="ignore"):
            self._lag = (lag[:, kept] * pair).T
            self._vague = ((vague + terms * (EPS + modes.scatter))[:, kept] * pair).T
            self._omitted = size[:, noise].sum(axis=1)
            peak = self._lag / (math.e * np.abs(self.poles.real))[:, None]
        peak = np.where(self._lag == 0.0, 0.0, peak)
        most = (peak + self._vague).sum(axis=0) + self._omitted
        self.error = float(np.nan_to_num(most, nan=math.inf).max(initial=0.0))

    def bounds(self, times: Floats) -> Floats:
        """See `Flow`."""
        left = np.exp(np.minimum(np.outer(times, self.poles.real), LARGEST))
        return np.asarray((times[:, None] * left) @ self._lag + left @ self._vague + self._omitted)

    def part(self, columns: Ints) -> Self:
        """See `Flow`."""
        flow = copy(self)
        flow.share, flow._omitted = self.share[:, columns], self._omitted[columns]
        flow._lag, flow._vague = self._lag[:, columns], self._vague[:, columns]
        return flow


def _exponentials(times: Floats, poles: Complexes) -> Complexes:
    ring = np.flatnonzero(poles.imag)  # a real one costs a thirtieth
    with np.errstate(over="ignore", invalid="ignore"):  # an unstable board overflows
        values = np.exp(np.outer(times, poles.real)).astype(np.complex128)
        values[:, ring] = np.exp(np.outer(times, poles[ring]))
    return values


def _real_product(a: Complexes, b: Complexes) -> Floats:
    """Return the real part of a product at half the cost."""
    with np.errstate(over="ignore", invalid="ignore"):
        return np.asarray(a.real @ b.real - a.imag @ b.imag)


class LadderFlow:
    """``exp(A t)`` by binary powers of one short step, without eigenvectors.

    `C` (K, n) are output rows, `deviation` (n,) is the initial minus the final state, and `stop`
    the latest expected instant, s. The preparation costs about ``log2(|A| stop)`` products of
    n-by-n matrices, an evaluation ``log2(|A| stop) + 20`` products of A with the states of all
    instants.
    """

    def __init__(self, A: Floats, C: Floats, deviation: Floats, stop: float) -> None:
        from scipy.linalg import matrix_balance

        balanced, (scale, _) = matrix_balance(A, permute=False, separate=True)
        self.A: Floats = np.asarray(balanced, dtype=np.float64)
        self.C = C * scale[None, :]
        self.deviation = deviation / scale
        norm = float(np.abs(self.A).sum(axis=1).max(initial=0.0))
        levels = max(math.ceil(math.log2(max(2.0 * norm * stop, 1.0))), 0)
        self.step = stop / 2.0**levels if stop > 0.0 else 1.0
        self.powers = [_taylor(self.A * self.step, np.eye(len(A)))]
        with np.errstate(over="ignore", invalid="ignore"):  # rounding lets a slow mode grow
            for _ in range(levels):
                self.powers.append(self.powers[-1] @ self.powers[-1])
            # Every squaring doubles the rounding error of the first power.
            growth = float(np.max([np.abs(P).sum(axis=1).max() for P in self.powers]))
        reach = float((np.abs(self.C) @ np.abs(self.deviation)).max(initial=0.0))
        error = EPS * 2.0**levels * growth * reach
        self.error = error if math.isfinite(error) else math.inf  # not a number, too

    def at(self, times: Floats, order: int = 0) -> Floats:
        """See `Flow`."""
        rows = self.C @ np.linalg.matrix_power(self.A, order)
        values = np.empty((len(times), len(self.C)))
        for first in range(0, len(times), BLOCK):
            part = slice(first, first + BLOCK)
            values[part] = (rows @ self._states(times[part])).T
        return values

    def bounds(self, times: Floats) -> Floats:
        """See `Flow`."""
        return np.full((len(times), len(self.C)), self.error)

    def part(self, columns: Ints) -> Self:
        """See `Flow`."""
        flow = copy(self)
        flow.C = self.C[columns]
        return flow

    def pair(self, times: Floats) -> tuple[Floats, Floats]:
        """See `Flow`."""
        return self.at(times), self.at(times, 1)

    def chosen(self, times: Floats, columns: Ints, order: int) -> tuple[Floats, Floats]:
        """See `Flow`."""
        place = np.arange(len(times))
        return self.at(times, order)[place, columns], self.at(times, order + 1)[place, columns]

    def _states(self, times: Floats) -> Floats:
        count = np.floor(times / self.step)
        rest = times - count * self.step
        X = np.repeat(self.deviation[:, None], len(times), axis=1)
        X = _taylor(self.A * self.step, X, rest / self.step)
        number = count.astype(np.int64)
        while number.max(initial=0) >> len(self.powers):  # beyond `stop`
            self.powers.append(self.powers[-1] @ self.powers[-1])
            self.error *= 2.0
        for level, power in enumerate(self.powers):
            chosen = (number >> level & 1).astype(np.bool_)
            if chosen.any():
                X[:, chosen] = power @ X[:, chosen]
        return X


def _taylor(small: Floats, X: Floats, fractions: Floats | float = 1.0) -> Floats:
    """Return ``exp(small * fraction) X``, a fraction for each column; |small| is at most 1/2."""
    total, term = X.copy(), X
    for k in range(1, TAYLOR):
        term = (small @ term) * (fractions / k)
        total += term
    return total
