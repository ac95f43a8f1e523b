"""Sums of matrices and products of matrices, accurate to twice the working precision.

Every factor is split into slices of so few bits that the product of two slices is exact, in any
order of summation; the exact products are then added with compensation (Ozaki, Ogita, Oishi and
Rump 2012).
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Sequence

import numpy as np

from taction.system.array_types import Floats

DIGITS = 53
SLICES = 4  # of a factor, of at least 20 bits each; products of the smallest are left out


def accurate_sum(terms: Sequence[Floats], products: Iterable[tuple[Floats, Floats]]) -> Floats:
    """Return ``sum terms + sum P Q`` of matrices of one shape, rounded only once or nearly so.

    Examples
    --------
    >>> import numpy as np
    >>> third = np.full((1, 1), 1.0 / 3.0)
    >>> float(accurate_sum([-third * third], [(third, third)])[0, 0])
    -6.167905692361981e-18
    """
    total: Floats | None = None
    rest: Floats | None = None
    for part in (*terms, *(part for P, Q in products for part in _exact_products(P, Q))):
        if total is None or rest is None:
            total, rest = part.copy(), np.zeros_like(part)
            continue
        new = total + part
        back = new - total
        rest += (total - (new - back)) + (part - back)
        total = new
    if total is None or rest is None:
        raise ValueError("nothing to add")
    return total + rest


def _exact_products(P: Floats, Q: Floats) -> Iterable[Floats]:
    """Yield products of slices, the largest first, whose sum is ``P Q``.

    Powers of two make the rows of Q equally large first, so that slices keep its small elements.
    """
    size = np.abs(Q).max(axis=1, initial=0.0)
    exponent = np.where(size > 0.0, np.frexp(size)[1], 0)
    P, Q = np.ldexp(P, exponent), np.ldexp(Q, -exponent[:, None])
    bits = math.ceil((DIGITS + math.log2(max(P.shape[1], 1))) / 2.0)
    left, right = _slices(P, 1, bits), _slices(Q, 0, bits)
    for level in range(SLICES):
        for k in range(level + 1):
            yield left[k] @ right[level - k]


def _slices(X: Floats, axis: int, bits: int) -> list[Floats]:
    """Split X into slices that are multiples of one power of two along `axis`."""
    found, rest = [], X
    for _ in range(SLICES):
        largest = np.abs(rest).max(axis=axis, initial=0.0, keepdims=True)
        shift = np.where(largest > 0.0, np.ldexp(1.0, np.frexp(largest)[1] + bits), 0.0)
        head = (rest + shift) - shift
        found.append(head)
        rest = rest - head
    return found
