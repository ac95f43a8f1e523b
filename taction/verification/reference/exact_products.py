"""Products of a matrix with vectors of twice the digits: residuals keep what cancels.

Both factors are cut into slices so narrow that every product and partial sum of the BLAS is exact
(Ozaki, Ogita, Oishi and Rump, Numer. Algorithms 59, 2012), so the products run at BLAS speed.
"""

from __future__ import annotations

from dataclasses import dataclass
from math import ceil, fsum, log2

import numpy as np

from taction.system.array_types import Floats

PRODUCT_ERROR = 2.0**-102
"""Error of a product over the norms of its factors, beside the rounding of the result."""
_BITS = 110  # of every factor, below its largest entry


@dataclass(frozen=True, slots=True, eq=False)
class Pair:
    """A vector ``hi + lo`` of about 106 bits."""

    hi: Floats
    lo: Floats

    @classmethod
    def of(cls, x: Floats) -> Pair:
        """Convert doubles."""
        return cls(x, np.zeros_like(x))

    def __add__(self, x: Floats) -> Pair:
        s = self.hi + x
        t = s - self.hi
        error = (self.hi - (s - t)) + (x - t) + self.lo
        hi = s + error
        return Pair(hi, error - (hi - s))

    def times(self, factor: float) -> tuple[Floats, ...]:
        """Return vectors whose sum is the pair times `factor`, to 2^-104."""
        (ah, al), (bh, bl) = (_halves(np.asarray(x)) for x in (self.hi, factor))
        p = self.hi * factor
        return p, ((ah * bh - p) + ah * bl + al * bh) + al * bl, self.lo * factor


def _halves(a: Floats) -> tuple[Floats, Floats]:
    c = (2.0**27 + 1.0) * a
    high = c - (c - a)
    return high, a - high


def _slices(x: Floats, bits: int) -> list[Floats]:
    """Split x into arrays of 53 - `bits` bits times a power of two each."""
    out = list[Floats]()
    peak = float(np.max(np.abs(x), initial=0.0))
    anchor = 2.0 ** (ceil(log2(peak)) + bits) if peak > 0.0 else 0.0
    while len(out) * (53 - bits) < _BITS and x.any():
        out.append((x + anchor) - anchor)
        x = x - out[-1]
        anchor *= 2.0 ** (bits - 53)
    return out


class ExactMatrix:
    """Products of a matrix, largest entry within 1e-100 .. 1e100, and of its transpose.

    The error is below `PRODUCT_ERROR` times ``|A|_F |x|`` beside the rounding of the result: a
    matrix whose entries span less than 110 bits is represented exactly.

    Examples
    --------
    >>> A = ExactMatrix(np.array([[1e16, 1.0]]))
    >>> A.sums(Pair.of(np.array([1.0, 1.0])), np.array([-1e16])).tolist()
    [1.0]
    """

    def __init__(self, A: Floats) -> None:
        self._bits = ceil((53 + log2(max(A.shape))) / 2)
        self._parts = np.array(_slices(A, self._bits)).reshape(-1, *A.shape)

    @property
    def transposed(self) -> ExactMatrix:
        """The transpose."""
        other = object.__new__(ExactMatrix)
        other._bits, other._parts = self._bits, self._parts.transpose(0, 2, 1)
        return other

    def sums(self, x: Pair, *terms: Floats) -> Floats:
        """Return ``A x`` plus `terms`, all added before the result is rounded."""
        columns = [*_slices(x.hi, self._bits), *_slices(x.lo, self._bits)]
        rows = [np.zeros((self._parts.shape[1], 1)), *(term[:, None] for term in terms)]
        if columns:
            rows.extend(self._parts @ np.array(columns).T)
        return np.array([fsum(row) for row in np.concatenate(rows, axis=1).tolist()])
