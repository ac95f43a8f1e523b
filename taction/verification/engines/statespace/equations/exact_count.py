"""Count the poles right of the imaginary axis in integers: no rounding decides.

Every stamped value is a double, so M and K are integers times powers of two, and so are the
coefficients of ``det(s M - K)``. Routh's array of these integers has a change of sign for each pole
right of the axis.
"""

from __future__ import annotations

import math
from fractions import Fraction

import numpy as np

from taction.system.array_types import Floats
from taction.verification.engines.statespace.equations.descriptor import Descriptor

MOST = 30  # unknowns: some 0.1 s
DEGREE = 16  # largest number of rows with charge


def exact_unstable_count(descriptor: Descriptor, slopes: Floats) -> int | None:
    """Count the poles right of the imaginary axis; `slopes` (m,) are the amplifiers'.

    None where a pole is on the axis, or symmetric to another one about it, and for a board of more
    than `MOST` unknowns.

    Examples
    --------
    >>> from taction.netlist_gen.deck.flat_cards import circuit_of, read_cards
    >>> from taction.verification.engines.statespace.equations.stamps import stamp
    >>> flat = read_cards(["r1 a 0 -1k", "c1 a 0 1n", "r2 b 0 1k", "c2 b 0 1n"])
    >>> exact_unstable_count(stamp(circuit_of(flat, "two", ["a"], {})), np.zeros(0))
    1
    """
    if descriptor.size > MOST:
        return None
    M, K = descriptor.summed(_fractions, slopes)
    degree = int((M != 0).any(axis=1).sum())
    if degree > DEGREE:
        return None
    rows = [_integers([*m, *k]) for m, k in zip(M.tolist(), K.tolist(), strict=True)]
    values = []
    for s in range(1, degree + 2):
        at = [[s * m - k for m, k in _halves(row)] for row in rows]
        values.append(_determinant(at))
    return _right(_coefficients(values))


_fractions = np.vectorize(Fraction, otypes=[np.object_])


def _halves(row: list[int]) -> zip[tuple[int, int]]:
    """Pair the first half of a row with the second."""
    half = len(row) // 2
    return zip(row[:half], row[half:], strict=True)


def _integers(row: list[Fraction]) -> list[int]:
    """Return a row without its common factor."""
    scale = math.lcm(*(Fraction(each).denominator for each in row))
    whole = [int(each * scale) for each in row]
    common = math.gcd(*whole) or 1
    return [each // common for each in whole]


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


def _coefficients(values: list[int]) -> list[int]:
    """Return a multiple of the polynomial with `values` at 1, 2, ..., lowest power first."""
    differences = [Fraction(value) for value in values]
    for k in range(1, len(values)):
        for j in range(len(values) - 1, k - 1, -1):
            differences[j] = (differences[j] - differences[j - 1]) / k
    found = [Fraction(0)]
    for point in range(len(values), 0, -1):
        higher = [Fraction(0), *found]
        found = [a - point * b for a, b in zip(higher, [*found, Fraction(0)], strict=True)]
        found[0] += differences[point - 1]
    while found and not found[-1]:
        found.pop()
    return _integers(found) if found else []


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
