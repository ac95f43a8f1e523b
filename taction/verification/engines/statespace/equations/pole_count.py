"""Count poles in integers, all and those right of the imaginary axis: no rounding decides.

Every stamped value is a double, so M and K are rational numbers, and so are the coefficients of
``det(s M - K)``. Routh's array of these has a change of sign for each pole right of the axis.

The number of finite poles is the degree of the determinant. Reduced modulo a prime of 31 bits, its
degree is the true one unless the leading coefficient, not zero, is a multiple of the prime: by
chance one in 2e9. No tolerance decides.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from fractions import Fraction

import numpy as np

from taction.system.array_types import Floats, Ints
from taction.system.errors import EngineError
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


PRIME = 2**31 - 19  # not 2**31 - 1, in which 2**31 is 1
SHIFT = 1_234_567_891  # any value of s that is no pole modulo the prime
DIGITS = 53  # of a double
HALF = 16  # bits of the lower half of a residue


def finite_poles(descriptor: Descriptor, slopes: Floats) -> int:
    """Return the number of finite poles, with multiplicity; `slopes` (m,) are the amplifiers'.

    EngineError: ``det(s M - K)`` is zero for every s: voltages or currents that nothing determines.

    Notes
    -----
    ``N = (s0 M - K)^-1 M`` has the eigenvalue ``1 / (s0 - s)`` for every pole s, and zero for the
    others: the poles are as many as the rank of a high power of N.
    """
    size = descriptor.size
    M, K = descriptor.summed(residues, slopes)
    whole = np.concatenate([(SHIFT * (M % PRIME) - K) % PRIME, M % PRIME], axis=1)
    if _eliminate(whole, size) < size:
        raise EngineError("voltages or currents that no part determines: det(s M - K) = 0")
    N = image = whole[:, size:]
    rank = size
    while True:
        basis = image.T.copy()  # its rows span the columns
        found = _eliminate(basis, size)
        if found == rank:
            return found
        rank, image = found, _product(N, basis[:found].T)


def residues(values: Floats) -> Ints:
    """Return finite doubles modulo the prime.

    Examples
    --------
    >>> import numpy as np
    >>> half, minus = residues(np.array([0.5, -3.0])).tolist()
    >>> 2 * half % PRIME, minus - PRIME
    (1, -3)
    """
    mantissa, exponent = np.frexp(values)
    whole = np.ldexp(mantissa, DIGITS).astype(np.int64) % PRIME
    kinds, place = np.unique(exponent, return_inverse=True)
    powers = np.array([pow(2, int(e) - DIGITS, PRIME) for e in kinds], dtype=np.int64)
    return np.asarray(whole * powers[place.reshape(exponent.shape)] % PRIME)


def _eliminate(X: Ints, columns: int) -> int:
    """Bring the first columns of X to reduced echelon form, in place; return their rank."""
    rank = 0
    for column in range(columns):
        below = np.flatnonzero(X[rank:, column])
        if not below.size:
            continue
        first = rank + int(below[0])
        if first != rank:
            X[[rank, first]] = X[[first, rank]]
        X[rank] = X[rank] * pow(int(X[rank, column]), -1, PRIME) % PRIME
        others = np.flatnonzero(X[:, column])
        others = others[others != rank]
        X[others] = (X[others] - X[others, column, None] * X[rank]) % PRIME
        rank += 1
        if rank == len(X):
            break
    return rank


def _product(A: Ints, B: Ints) -> Ints:
    high, low = A >> HALF, A & ((1 << HALF) - 1)
    return ((high @ B % PRIME << HALF) + low @ B) % PRIME
