"""Numbers of about 106 bits as unevaluated sums of two doubles, and exact matrix products.

Sums and products are Dekker's and Knuth's error-free transformations. Matrix products split both
factors into slices so narrow that every product and partial sum of the BLAS is exact (Ozaki, Ogita,
Oishi and Rump, Numer. Algorithms 59, 2012), so they run at BLAS speed.
"""

from __future__ import annotations

from dataclasses import dataclass
from fractions import Fraction
from math import ceil, factorial, fsum, log, log2

import numpy as np

from taction.system.array_types import Floats

FUNCTION_ERROR = 2.0**-96
"""Bound on the relative error of every function here, for arguments of exp up to 700."""
PRODUCT_ERROR = 2.0**-102
"""Error of a matrix product over the norms of its factors."""

_SPLITTER = 2.0**27 + 1.0
_PRODUCT_BITS = 110
_UNDERFLOW = -745.2
_NEAR_ZERO = 0.34


def _two_sum(a: Floats, b: Floats) -> tuple[Floats, Floats]:
    s = a + b
    t = s - a
    return s, (a - (s - t)) + (b - t)


def _quick_two_sum(a: Floats, b: Floats) -> tuple[Floats, Floats]:
    """Return the sum and its error for ``|a| >= |b|``."""
    s = a + b
    return s, b - (s - a)


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
    """An array ``hi + lo``, with ``|lo|`` at most half a unit in the last place of ``hi``."""

    hi: Floats
    lo: Floats

    @classmethod
    def of(cls, value: Floats | float) -> DoubleDouble:
        """Convert doubles."""
        hi = np.asarray(value, dtype=np.float64)
        return cls(hi, np.zeros_like(hi))

    def __add__(self, other: DoubleDouble) -> DoubleDouble:
        s, e = _two_sum(self.hi, other.hi)
        t, f = _two_sum(self.lo, other.lo)
        s, e = _quick_two_sum(s, e + t)
        return DoubleDouble(*_quick_two_sum(s, e + f))

    def __neg__(self) -> DoubleDouble:
        return DoubleDouble(-self.hi, -self.lo)

    def __sub__(self, other: DoubleDouble) -> DoubleDouble:
        return self + (-other)

    def __mul__(self, other: DoubleDouble) -> DoubleDouble:
        p, e = _two_product(self.hi, other.hi)
        return DoubleDouble(*_quick_two_sum(p, e + (self.hi * other.lo + self.lo * other.hi)))

    def __truediv__(self, other: DoubleDouble) -> DoubleDouble:
        first = DoubleDouble.of(self.hi / other.hi)
        rest = self - first * other
        second = DoubleDouble.of(rest.hi / other.hi)
        rest = rest - second * other
        return first + second + DoubleDouble.of(rest.hi / other.hi)


def _constant(value: Fraction) -> DoubleDouble:
    hi = float(value)
    return DoubleDouble(np.asarray(hi), np.asarray(float(value - Fraction(hi))))


ONE = DoubleDouble.of(1.0)
HALF = DoubleDouble.of(0.5)
_LN2 = DoubleDouble(np.asarray(0.6931471805599453), np.asarray(2.3190468138462996e-17))
_INVERSE_FACTORIALS = tuple(_constant(Fraction(1, factorial(k))) for k in range(15))
_EXACT_TERMS = 7
_SQUARINGS = 4


def _expm1_near_zero(x: DoubleDouble) -> DoubleDouble:
    """Return e^x - 1 for ``|x| <= 0.35``, to full relative accuracy."""
    r = DoubleDouble(x.hi * 2.0**-_SQUARINGS, x.lo * 2.0**-_SQUARINGS)
    tail = np.zeros_like(r.hi)  # high powers are small: double precision is enough
    for term in _INVERSE_FACTORIALS[:_EXACT_TERMS:-1]:
        tail = tail * r.hi + float(term.hi)
    result = DoubleDouble.of(tail)
    for term in _INVERSE_FACTORIALS[_EXACT_TERMS:0:-1]:
        result = result * r + term
    result = result * r
    for _ in range(_SQUARINGS):
        result = result * result + DoubleDouble(2.0 * result.hi, 2.0 * result.lo)
    return result


def exp(x: DoubleDouble) -> DoubleDouble:
    """Return e to the power x; zero at underflow."""
    low = x.hi < _UNDERFLOW
    x = DoubleDouble(np.where(low, _UNDERFLOW, x.hi), np.where(low, 0.0, x.lo))
    power = np.rint(x.hi / log(2.0))
    total = ONE + _expm1_near_zero(x - DoubleDouble.of(power) * _LN2)
    k = power.astype(int)
    hi, lo = np.ldexp(total.hi, k), np.ldexp(total.lo, k)
    return DoubleDouble(np.where(low, 0.0, hi), np.where(low, 0.0, lo))


def expm1(x: DoubleDouble) -> DoubleDouble:
    """Return e^x - 1, to full relative accuracy."""
    near = np.abs(x.hi) < _NEAR_ZERO
    small = _expm1_near_zero(DoubleDouble(np.where(near, x.hi, 0.0), np.where(near, x.lo, 0.0)))
    large = exp(x) - ONE
    return DoubleDouble(np.where(near, small.hi, large.hi), np.where(near, small.lo, large.lo))


def log1p(x: DoubleDouble) -> DoubleDouble:
    """Return log(1 + x) for x >= 0, to full relative accuracy: one Newton step from a double."""
    start = DoubleDouble.of(np.log1p(x.hi))
    t = (x - expm1(start)) / (ONE + x)
    return start + t + DoubleDouble.of(0.5 * t.hi * t.hi)


def _slices(high: Floats, low: Floats | None, bits: int) -> Floats:
    """Split into arrays (slices, ...), each integers of 53 - `bits` bits times a power of two."""
    out: list[Floats] = []
    peak = max(float(high.max()), -float(high.min()))
    anchor = 2.0 ** (ceil(log2(peak)) + bits) if peak > 0.0 else 0.0
    while len(out) * (53 - bits) < _PRODUCT_BITS and high.any():
        part = (high + anchor) - anchor
        out.append(part)
        high = high - part
        if low is not None:
            high, low = _two_sum(high, low)
        anchor *= 2.0 ** (bits - 53)
    return np.array(out).reshape(-1, *high.shape)


def _total(terms: Floats) -> DoubleDouble:
    """Sum along the last axis of terms (N, K), rounded once."""
    rows = terms.tolist()
    hi = [fsum(row) for row in rows]
    lo = [fsum((*row, -head)) for row, head in zip(rows, hi, strict=True)]
    return DoubleDouble(np.array(hi), np.array(lo))


class ExactMatrix:
    """Products of one matrix and of its transpose with double-double vectors.

    Parameters
    ----------
    T : ndarray (M, N)
        Largest entry within 1e-100 .. 1e100; scale it first.

    Notes
    -----
    The error is below `PRODUCT_ERROR` times ``|T|_F |x|``: the slices reach 2^-110 of the largest
    entry, and a matrix whose entries span less is represented exactly.
    """

    def __init__(self, T: Floats) -> None:
        self._bits = ceil((53 + log2(max(T.shape))) / 2)
        self._parts = _slices(T, None, self._bits)

    def __matmul__(self, x: DoubleDouble) -> DoubleDouble:
        return self._product(self._parts, x)

    def transposed(self, x: DoubleDouble) -> DoubleDouble:
        """Return the product of the transpose with x (M,)."""
        return self._product(self._parts.transpose(0, 2, 1), x)

    def _product(self, parts: Floats, x: DoubleDouble) -> DoubleDouble:
        terms = parts @ _slices(x.hi, x.lo, self._bits).T  # (parts, rows, slices)
        return _total(terms.transpose(1, 0, 2).reshape(parts.shape[1], -1))
