"""Evaluate ``C exp(A t) d`` of a linear board at chosen nodes: by modes, or by a ladder of powers.

Both ways give the value and its time derivative at any t >= 0, with a bound on the error. Modes are
much cheaper; the ladder needs no eigenvectors and serves where these are defective or
ill-conditioned.
"""

from __future__ import annotations

import math
from typing import Protocol

import numpy as np

from spice_models.array_types import Complexes, Floats
from verification.engines.statespace.linearised.modes import Modes

EPS = float(np.finfo(np.float64).eps)
TAYLOR = 20  # terms that give exp of a matrix of norm below 1/2 to rounding
BLOCK = 512  # instants evaluated at a time
FADED = -90.0  # exponent below which a mode is left out: 1e-39 of its first amplitude
NEGLIGIBLE = 1e-18  # share of a mode, relative to the largest, below the rounding of any sum
NOISE = 8 * EPS  # share of a mode, relative to the sum of its terms, that is only rounding


class Flow(Protocol):
    """A deviation from the final value, as a function of time."""

    error: float

    def at(self, times: Floats, order: int = 0) -> Floats:
        """Return the deviation (order 0) or its time derivative (order 1), shape (P, K)."""
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
        weight = self.share * self.poles[:, None] ** order
        values = np.empty((len(times), weight.shape[1]))
        for first in range(0, len(times), BLOCK):
            part = slice(first, first + BLOCK)
            live = self._live(float(times[part].min()))
            shape = _exponentials(times[part], self.poles[:live])
            values[part] = _real_product(shape, weight[:live])
        return values

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
            # Rounding excites every growing mode, as noise does in a circuit.
            faint = (modes.poles.real > 0.0) & (np.abs(share) < EPS * terms)
            share = np.where(faint, EPS * terms, share)
        size = np.abs(share)
        self.error = _modal_error(modes, size, terms)
        # One of each conjugate pair is enough.
        kept = modes.poles.imag >= 0.0
        large = size.max(axis=0, initial=0.0)
        kept &= large > NEGLIGIBLE * large.max(initial=0.0)
        noise = (modes.poles.real < 0.0) & np.all(size <= NOISE * terms, axis=0)
        self.error += float(size[:, noise].sum(axis=1).max(initial=0.0))
        kept &= ~noise
        pair = np.where(modes.poles[kept].imag > 0.0, 2.0, 1.0)
        super().__init__(modes.poles[kept], (share[:, kept] * pair).T)


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


def _modal_error(modes: Modes, size: Floats, terms: Floats) -> float:
    """Bound the error of any output over all time to first order, in the unit of C x.

    An error d of a pole contributes at most ``d t exp(Re p t) <= d / (e |Re p|)``; the rounding of
    a vector contributes its condition number times eps. `size` are the sizes of the shares,
    `terms` those of the terms that add up to them, (K, n).
    """
    if not math.isfinite(modes.defect):
        return math.inf
    with np.errstate(divide="ignore", invalid="ignore"):
        lag = modes.spread / (math.e * np.abs(modes.poles.real))
    lag = np.where(modes.spread == 0.0, 0.0, lag)
    vectors = float(terms.sum(axis=1).max(initial=0.0)) * (EPS + modes.defect)
    return float((size @ lag).max(initial=0.0)) + vectors


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
        for _ in range(levels):
            self.powers.append(self.powers[-1] @ self.powers[-1])
        # Every squaring doubles the rounding error of the first power.
        growth = max(float(np.abs(P).sum(axis=1).max()) for P in self.powers)
        reach = float((np.abs(self.C) @ np.abs(self.deviation)).max(initial=0.0))
        self.error = EPS * 2.0**levels * growth * reach

    def at(self, times: Floats, order: int = 0) -> Floats:
        """Return the deviation or its derivative at `times`, shape (P, K)."""
        rows = self.C @ self.A if order else self.C
        values = np.empty((len(times), len(self.C)))
        for first in range(0, len(times), BLOCK):
            part = slice(first, first + BLOCK)
            values[part] = (rows @ self._states(times[part])).T
        return values

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
