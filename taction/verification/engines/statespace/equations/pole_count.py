"""Count the finite poles of a board in integers: no rounding decides.

Every stamped value is a double, so M and K are rational numbers, and so are the coefficients of
``det(s M - K)``. The number of finite poles is the degree of this determinant. Reduced modulo a
prime of 31 bits, its degree is the true one unless the leading coefficient, not zero, is a multiple
of the prime: by chance one in 2e9. No tolerance decides.
"""

from __future__ import annotations

import numpy as np

from taction.system.array_types import Floats, Ints
from taction.system.errors import EngineError
from taction.verification.engines.statespace.equations.descriptor import Descriptor

PRIME = 2**31 - 19  # not 2**31 - 1, in which 2**31 is 1
SHIFT = 1_234_567_891  # any value of s that is no pole modulo the prime
DIGITS = 53  # of a double
HALF = 16  # bits of the lower half of a residue


def finite_poles(descriptor: Descriptor, slopes: Floats) -> int:
    """Return the number of finite poles, with multiplicity; `slopes` (m,) are the amplifiers'.

    EngineError: ``det(s M - K)`` is zero for every s: voltages or currents that nothing determines.

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
    """Return finite doubles modulo the prime: of 0.5 what gives 1 times 2."""
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
