"""Count the poles right of the imaginary axis in integers: no rounding decides.

Every stamped value is a double, so M and K are rational numbers, and so are the coefficients of
``det(s M - K)``. Routh's array of these has a change of sign for each pole right of the axis.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from fractions import Fraction

import numpy as np

from taction.verification.engines.statespace.equations.descriptor import Descriptor

MOST = 40  # unknowns: some 0.1 s
DEGREE = 16  # largest number of rows with charge


def characteristic(descriptor: Descriptor) -> tuple[Fraction, ...] | None:
    """Return the coefficients of ``det(s M - K)`` of a linear board, lowest power first.

    None for a board of more than `MOST` unknowns, or with amplifiers that are not linear.

    Examples
    --------
    >>> from taction.netlist_gen.deck.flat_cards import circuit_of, read_cards
    >>> from taction.verification.engines.statespace.equations.stamps import stamp
    >>> flat = read_cards(["r1 a 0 -2", "c1 a 0 1", "r2 b 0 1", "c2 b 0 1"])
    >>> found = characteristic(stamp(circuit_of(flat, "two", ["a"])))
    >>> [float(each) for each in found], count_right(found)
    ([-0.5, 0.5, 1.0], 1)
    """
    if descriptor.size > MOST or descriptor.devices.count:
        return None
    M, K = descriptor.summed(np.vectorize(Fraction, otypes=[np.object_]), np.zeros(0))
    degree = int((M != 0).any(axis=1).sum())
    if degree > DEGREE:
        return None
    rows, size = list[list[tuple[int, int]]](), Fraction(1)
    for charges, currents in zip(M.tolist(), K.tolist(), strict=True):
        scale = math.lcm(*(Fraction(each).denominator for each in (*charges, *currents)))
        rows.append(
            [(int(m * scale), int(k * scale)) for m, k in zip(charges, currents, strict=True)]
        )
        size /= scale
    at = range(1, degree + 2)
    values = [_determinant([[s * m - k for m, k in row] for row in rows]) for s in at]
    return tuple(size * each for each in _coefficients(values))


def _determinant(rows: list[list[int]]) -> int:
    """Return the determinant by Bareiss' elimination, in which every division is exact."""
    last, sign = 1, 1
    while rows:
        at = min(
            (k for k, row in enumerate(rows) if row[0]), key=lambda k: abs(rows[k][0]), default=None
        )
        if at is None:
            return 0
        pivot = rows.pop(at)
        sign = -sign if at % 2 else sign
        first, rest = pivot[0], pivot[1:]
        rows = [
            [(first * x - row[0] * y) // last for x, y in zip(row[1:], rest, strict=True)]
            for row in rows
        ]
        last = first
    return sign * last


def _coefficients(values: Sequence[int]) -> list[Fraction]:
    """Return the polynomial with `values` at 1, 2, ..., lowest power first (Newton's formula)."""
    degree, differences = len(values) - 1, list(values)
    for k in range(1, degree + 1):
        for j in range(degree, k - 1, -1):
            differences[j] -= differences[j - 1]
    found = [0]
    for k in range(degree, -1, -1):  # over the factorial of the degree
        higher = [0, *found]
        found = [a - (k + 1) * b for a, b in zip(higher, [*found, 0], strict=True)]
        found[0] += differences[k] * math.factorial(degree) // math.factorial(k)
    return [Fraction(each, math.factorial(degree)) for each in found[: degree + 1]]


def count_right(coefficients: Sequence[Fraction]) -> int | None:
    """Count the roots of a polynomial, lowest power first, right of the imaginary axis.

    None where one is on the axis, or symmetric to another one about it.
    """
    scale = math.lcm(*(each.denominator for each in coefficients))
    whole = [int(each * scale) for each in coefficients]
    while whole and not whole[-1]:
        whole.pop()
    return _right(whole)


def _right(coefficients: list[int]) -> int | None:
    """Return how many roots are right of the axis by Routh's array; None where it has a zero."""
    falling = coefficients[::-1]
    upper, lower = falling[0::2], falling[1::2]
    count, sign = 0, 1
    if not upper or (upper[0] < 0):
        upper, lower = [-each for each in upper], [-each for each in lower]
    for _ in range(len(falling) - 1):
        if not lower or not lower[0]:
            return None
        if (lower[0] > 0) != (sign > 0):
            count, sign = count + 1, -sign
        padded = [*lower, *[0] * (len(upper) - len(lower))]
        following = [
            sign * (lower[0] * upper[k + 1] - upper[0] * padded[k + 1])
            for k in range(len(upper) - 1)
        ]
        common = math.gcd(*following) or 1
        upper, lower = lower, [each // common for each in following]
    return count if falling else None
