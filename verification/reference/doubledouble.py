"""Numbers of about 106 bits as unevaluated sums of two doubles, and exact matrix products.

Sums and products are Dekker's and Knuth's error-free transformations. Matrix products split both
factors into slices so narrow that every product and partial sum of the BLAS is exact (Ozaki, Ogita,
Oishi and Rump, Numer. Algorithms 59, 2012), so they run at BLAS speed.
"""

from __future__ import annotations

from dataclasses import dataclass
from fractions import Fraction
from math import factorial, log

import numpy as np
from numpy.typing import NDArray

Floats = NDArray[np.float64]

UNIT = 2.0**-100
"""Relative error that every operation here stays below, with margin for sums of many terms."""

_SPLITTER = 2.0**27 + 1.0
_MAX_SLICES = 6
_UNDERFLOW = -745.2


def _two_sum(a: Floats, b: Floats) -> tuple[Floats, Floats]:
    s = a + b
    t = s - a
    return s, (a - (s - t)) + (b - t)


def _halves(a: Floats) -> tuple[Floats, Floats]:
    c = _SPLITTER * a
    high = c - (c - a)
    return high, a - high


def _two_product(a: Floats, b: Floats) -> tuple[Floats, Floats]:
    p = a * b
    ah, al = _halves(a)
    bh, bl = _halves(b)
    return p, ((ah * bh - p) + ah * bl + al * bh) + al * bl


@dataclass(frozen=True, slots=True, eq=False)
class DoubleDouble:
    """An array ``hi + lo``, with ``|lo|`` at most half a unit in the last place of ``hi``.

    Attributes
    ----------
    hi, lo : ndarray
        Of one shape.
    """

    hi: Floats
    lo: Floats

    @classmethod
    def of(cls, value: Floats | float) -> DoubleDouble:
        """Widen doubles."""
        hi = np.asarray(value, dtype=np.float64)
        return cls(hi, np.zeros_like(hi))

    def __add__(self, other: DoubleDouble) -> DoubleDouble:
        s, e = _two_sum(self.hi, other.hi)
        t, f = _two_sum(self.lo, other.lo)
        s, e = _two_sum(s, e + t)
        return DoubleDouble(*_two_sum(s, e + f))

    def __neg__(self) -> DoubleDouble:
        return DoubleDouble(-self.hi, -self.lo)

    def __sub__(self, other: DoubleDouble) -> DoubleDouble:
        return self + (-other)

    def __mul__(self, other: DoubleDouble) -> DoubleDouble:
        p, e = _two_product(self.hi, other.hi)
        return DoubleDouble(*_two_sum(p, e + (self.hi * other.lo + self.lo * other.hi)))

    def __truediv__(self, other: DoubleDouble) -> DoubleDouble:
        first = DoubleDouble.of(self.hi / other.hi)
        rest = self - first * other
        second = DoubleDouble.of(rest.hi / other.hi)
        rest = rest - second * other
        return first + second + DoubleDouble.of(rest.hi / other.hi)


def _constant(value: Fraction) -> DoubleDouble:
    hi = float(value)
    return DoubleDouble(np.float64(hi) + np.zeros(()), np.zeros(()) + float(value - Fraction(hi)))


ONE = DoubleDouble.of(1.0)
_LN2 = DoubleDouble(np.asarray(0.6931471805599453), np.asarray(2.3190468138462996e-17))
_INVERSE_FACTORIALS = tuple(_constant(Fraction(1, factorial(k))) for k in range(28))


def exp(x: DoubleDouble) -> DoubleDouble:
    """Return e to the power x; zero where it underflows."""
    low = x.hi < _UNDERFLOW
    x = DoubleDouble(np.where(low, _UNDERFLOW, x.hi), np.where(low, 0.0, x.lo))
    power = np.rint(x.hi / log(2.0))
    r = x - DoubleDouble.of(power) * _LN2
    total = _INVERSE_FACTORIALS[-1]
    for term in _INVERSE_FACTORIALS[-2::-1]:
        total = total * r + term
    k = power.astype(int)
    hi, lo = np.ldexp(total.hi, k), np.ldexp(total.lo, k)
    return DoubleDouble(np.where(low, 0.0, hi), np.where(low, 0.0, lo))


def log1p(x: DoubleDouble) -> DoubleDouble:
    """Return log(1 + x) for x >= 0, to full relative accuracy."""
    tiny = x.hi < 1e-8
    start = DoubleDouble.of(np.log1p(x.hi))
    t = (ONE + x) * exp(-start) - ONE  # |t| ~ 1e-16: two terms of log(1 + t) are enough
    big = start + t - DoubleDouble.of(0.5 * t.hi * t.hi)
    half = DoubleDouble.of(0.5)
    third = _constant(Fraction(1, 3))
    series = x * (ONE - x * (half - x * (third - x * DoubleDouble.of(0.25))))
    return DoubleDouble(np.where(tiny, series.hi, big.hi), np.where(tiny, series.lo, big.lo))


def _slices(a: Floats, bits: int, least: int = 1) -> list[Floats]:
    """Split `a` into at most six arrays that are small integers times one power of two each."""
    out: list[Floats] = []
    rest = a
    for _ in range(_MAX_SLICES):
        peak = float(np.max(np.abs(rest), initial=0.0))
        if peak == 0.0 and len(out) >= least:
            break
        anchor = 2.0 ** (np.ceil(np.log2(peak)) + bits) if peak > 0.0 else 0.0
        part = (rest + anchor) - anchor
        out.append(part)
        rest = rest - part
    return out


class ExactMatrix:
    """Products of one matrix and of its transpose with double-double vectors.

    Parameters
    ----------
    T : ndarray (M, N)
        Largest entry within 1e-100 .. 1e100; scale it first.

    Notes
    -----
    The error is at most `UNIT` times ``|T|_F |x|`` (six slices of at least 20 bits each reach
    2^-120 of the largest entry; a matrix whose entries span less is represented exactly).
    """

    def __init__(self, T: Floats) -> None:
        length = max(T.shape)
        self._bits = int(np.ceil((53 + np.log2(length)) / 2))
        self._parts = _slices(T, self._bits)

    def __matmul__(self, x: DoubleDouble) -> DoubleDouble:
        return self._product(self._parts, x)

    def transposed(self, x: DoubleDouble) -> DoubleDouble:
        """Return the product of the transpose with x (M,)."""
        return self._product([part.T for part in self._parts], x)

    def _product(self, parts: list[Floats], x: DoubleDouble) -> DoubleDouble:
        columns = np.stack(_slices(x.hi, self._bits) + _slices(x.lo, self._bits), axis=1)
        total = DoubleDouble.of(np.zeros(parts[0].shape[0]))
        for part in parts:
            products = part @ columns
            for column in products.T:
                total = total + DoubleDouble.of(column)
        return total
