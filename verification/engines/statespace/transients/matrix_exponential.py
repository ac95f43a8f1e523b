"""The flow ``exp(A t)`` of a linear board seen at chosen nodes: by modes, or by a ladder of powers.

Both evaluate ``C exp(A t) d`` and its time derivative at any t >= 0 and say how far they may be
off. The modes are cheaper by far; the ladder needs no eigenvectors and so serves where they are
defective or ill-conditioned.
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
FADED = -90.0  # exponent below which a mode has gone: 1e-39 of its first amplitude
NEGLIGIBLE = 1e-18  # share of a mode, of the largest, that no double precision sum can see
NOISE = 8 * EPS  # share of a mode, of what adds up to it, that is but rounding


class Flow(Protocol):
    """A deviation from the final value, as a function of time."""

    error: float

    def at(self, times: Floats, order: int = 0) -> Floats:
        """Deviation (order 0) or its time derivative (order 1), shape (P, K)."""
        ...


class Exponentials:
    """``Re sum_i share_i exp(p_i t)``: P m K multiplications for P instants and m poles.

    Parameters
    ----------
    poles : ndarray (m,)
        1/s, rightmost first; of conjugate pairs one.
    share : ndarray (m, K)
        Of each pole in each output; of pairs twice that.
    """

    def __init__(self, poles: Complexes, share: Complexes) -> None:
        self.poles, self.share = poles, share

    def at(self, times: Floats, order: int = 0) -> Floats:
        """Values, or their time derivatives, at `times` (P,), s; shape (P, K)."""
        weight = self.share * self.poles[:, None] ** order
        found = np.empty((len(times), weight.shape[1]))
        for first in range(0, len(times), BLOCK):
            part = slice(first, first + BLOCK)
            live = self._live(float(times[part].min()))
            shape = _exponentials(times[part], self.poles[:live])
            found[part] = _real_product(shape, weight[:live])
        return found

    def uniform(self, step: float, count: int) -> Floats:
        """Values at ``step * (0 .. count - 1)``, shape (count, K): 2 √count exponentials."""
        inner = math.isqrt(count) + 1
        outer, columns = -(-count // inner), self.share.shape[1]
        fine = _exponentials(step * np.arange(inner, dtype=np.float64), self.poles)
        starts = step * inner * np.arange(1, outer, dtype=np.float64)
        found = np.empty((outer, inner, columns))
        found[0] = _real_product(fine, self.share)
        live = self._live(step * inner)
        with np.errstate(over="ignore", invalid="ignore"):
            later = _exponentials(starts, self.poles[:live]).T[:, :, None]
            weight = (later * self.share[:live, None, :]).reshape(live, (outer - 1) * columns)
        rest = _real_product(fine[:, :live], weight).reshape(inner, outer - 1, columns)
        found[1:] = rest.transpose(1, 0, 2)
        return found.reshape(outer * inner, columns)[:count]

    def _live(self, time: float) -> int:
        """How many modes, the rightmost first, have not faded away at an instant, s."""
        return int(np.count_nonzero(self.poles.real * time > FADED))


class ModalFlow(Exponentials):
    """The modes of a board.

    Left out are modes that do not show, or by no more than the rounding of their shares; and of
    those left, at each instant, those that have faded away.

    Parameters
    ----------
    modes : Modes
        Of A.
    C : ndarray (K, n)
        Output rows.
    deviation : ndarray (n,)
        State at t = 0 minus final state.
    """

    def __init__(self, modes: Modes, C: Floats, deviation: Floats) -> None:
        with np.errstate(invalid="ignore", over="ignore"):
            share = modes.amplitudes(C, deviation)
            terms = modes.terms(C, deviation)
            # What grows is excited by rounding if by nothing else, in a circuit as in a computer.
            faint = (modes.poles.real > 0.0) & (np.abs(share) < EPS * terms)
            share = np.where(faint, EPS * terms, share)
        size = np.abs(share)
        self.error = _modal_error(modes, size, terms)
        # Of a conjugate pair one suffices.
        kept = modes.poles.imag >= 0.0
        large = size.max(axis=0, initial=0.0)
        kept &= large > NEGLIGIBLE * large.max(initial=0.0)
        noise = (modes.poles.real < 0.0) & np.all(size <= NOISE * terms, axis=0)
        self.error += float(size[:, noise].sum(axis=1).max(initial=0.0))
        kept &= ~noise
        pair = np.where(modes.poles[kept].imag > 0.0, 2.0, 1.0)
        super().__init__(modes.poles[kept], (share[:, kept] * pair).T)


def _exponentials(times: Floats, poles: Complexes) -> Complexes:
    ring = np.flatnonzero(poles.imag)  # a real exponential costs a thirtieth of a complex one
    with np.errstate(over="ignore", invalid="ignore"):  # an unstable board may leave all bounds
        found = np.exp(np.outer(times, poles.real)).astype(np.complex128)
        found[:, ring] = np.exp(np.outer(times, poles[ring]))
    return found


def _real_product(a: Complexes, b: Complexes) -> Floats:
    """Real part of a product, at half the work."""
    with np.errstate(over="ignore", invalid="ignore"):
        return np.asarray(a.real @ b.real - a.imag @ b.imag)


def _modal_error(modes: Modes, size: Floats, terms: Floats) -> float:
    """Bound the error of any output over all time to first order, in the unit of C x.

    A pole wrong by d shows at most ``d t exp(Re p t) <= d / (e |Re p|)``; a vector wrong by
    rounding shows its condition number times eps. `size` are the shares' sizes, `terms` those of
    what adds up to them, (K, n).
    """
    if not math.isfinite(modes.defect):
        return math.inf
    with np.errstate(divide="ignore", invalid="ignore"):
        lag = modes.spread / (math.e * np.abs(modes.poles.real))
    lag = np.where(modes.spread == 0.0, 0.0, lag)
    vectors = float(terms.sum(axis=1).max(initial=0.0)) * (EPS + modes.defect)
    return float((size @ lag).max(initial=0.0)) + vectors


class LadderFlow:
    """``exp(A t)`` by binary powers of one short step; no eigenvectors.

    Costs about ``log2(|A| stop)`` products of n-by-n matrices to set up, and
    ``log2(|A| stop) + 20`` products of A with the states of all instants to evaluate.

    Parameters
    ----------
    A : ndarray (n, n)
        1/s.
    C : ndarray (K, n)
        Output rows.
    deviation : ndarray (n,)
        State at t = 0 minus final state.
    stop : float
        Latest instant that will be asked for, s.
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
        # Rounding of the first power is doubled by every squaring.
        growth = max(float(np.abs(P).sum(axis=1).max()) for P in self.powers)
        reach = float((np.abs(self.C) @ np.abs(self.deviation)).max(initial=0.0))
        self.error = EPS * 2.0**levels * growth * reach

    def at(self, times: Floats, order: int = 0) -> Floats:
        """Deviation or its derivative at `times`, shape (P, K)."""
        rows = self.C @ self.A if order else self.C
        found = np.empty((len(times), len(self.C)))
        for first in range(0, len(times), BLOCK):
            part = slice(first, first + BLOCK)
            found[part] = (rows @ self._states(times[part])).T
        return found

    def _states(self, times: Floats) -> Floats:
        count = np.floor(times / self.step)
        rest = times - count * self.step
        X = np.repeat(self.deviation[:, None], len(times), axis=1)
        X = _taylor(self.A * self.step, X, rest / self.step)
        number = count.astype(np.int64)
        while number.max(initial=0) >> len(self.powers):  # later than was said at the start
            self.powers.append(self.powers[-1] @ self.powers[-1])
            self.error *= 2.0
        for level, power in enumerate(self.powers):
            chosen = (number >> level & 1).astype(np.bool_)
            if chosen.any():
                X[:, chosen] = power @ X[:, chosen]
        return X


def _taylor(small: Floats, X: Floats, fractions: Floats | float = 1.0) -> Floats:
    """``exp(small * fraction) X``, one fraction a column; the norm of `small` is at most 1/2."""
    total, term = X.copy(), X
    for k in range(1, TAYLOR):
        term = (small @ term) * (fractions / k)
        total += term
    return total
