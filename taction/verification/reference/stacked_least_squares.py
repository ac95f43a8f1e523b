"""Solvers of ``(A^T A + mu I) y = A^T f1 + f2``, ``A = T D`` with D diagonal, and exact products.

Of products of twice the digits both factors are cut into slices so narrow that every product and
partial sum of the BLAS is exact (Ozaki, Ogita, Oishi and Rump, Numer. Algorithms 59, 2012), so the
products run at BLAS speed.

QR and the singular values work on A itself (or on the stacked ``[A; sqrt(mu) I]``), so the error of
f1 is not multiplied by the square of the condition number.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from math import ceil, fsum, log2

import numpy as np

from taction.system.array_types import EPS, Floats
from taction.system.errors import SolverError

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


Solver = Callable[[Floats, Floats], Floats]
"""Return y (N,) for f1 (M,) and f2 (N,)."""

CHOLESKY_LIMIT = 1e-12
"""Normal equations are used while mu is above this times ``|T D|^2``; QR below."""
NEGLIGIBLE, WORTHWHILE = 1e-16, 0.9
"""A channel whose ``|T D|^2`` is below `NEGLIGIBLE` times mu is not coupled to the others. These
are factorised alone if they are at most the share `WORTHWHILE` of all; the next correction removes
the error.
"""


def factorise(T: Floats, gram: Floats, D: Floats, mu: float) -> Solver:
    """Factorise by Cholesky where Cholesky is accurate enough, else by QR.

    `T` (M, N), `gram` = ``T^T T`` (N, N), `D` (N,) at least 0, `mu` positive.
    """
    from scipy.linalg.lapack import dpotrf, dpotrs, dtrtrs

    diagonal = gram.diagonal() * D * D
    coupled = np.flatnonzero(diagonal > NEGLIGIBLE * mu)
    if 0 < len(coupled) < WORTHWHILE * len(D):
        inner = factorise(T[:, coupled], gram[np.ix_(coupled, coupled)], D[coupled], mu)

        def solve_coupled(f1: Floats, f2: Floats) -> Floats:
            y = (D * (f1 @ T) + f2) / mu
            y[coupled] = inner(f1, f2[coupled])
            return np.asarray(y)

        return solve_coupled
    if mu > CHOLESKY_LIMIT * float(np.sum(diagonal)):
        H = gram * D
        H *= D[:, None]
        H.flat[:: len(H) + 1] += mu
        # H is symmetric, and H.T has LAPACK's memory order: no copy.
        L, failed = dpotrf(H.T, lower=1, clean=0, overwrite_a=1)
        if not failed:
            return lambda f1, f2: np.asarray(dpotrs(L, D * (f1 @ T) + f2, lower=1)[0])
    Q, R = np.linalg.qr(np.vstack([T * D, np.sqrt(mu) * np.eye(len(D))]))

    def solve(f1: Floats, f2: Floats) -> Floats:
        z = dtrtrs(R, f2, trans=1)[0]
        return np.asarray(dtrtrs(R, f1 @ Q[: len(T)] + z)[0])

    return solve


class SVD:
    """Singular values `sigma` (N,) of T (D = 1), 0 where rounding hides them; mu may be 0.

    `least` is a lower bound on the least singular value of the stacked matrix (0 if it is
    rank-deficient), `condition` the condition number of the stacked matrix.

    SolverError: the decomposition does not converge.
    """

    def __init__(self, T: Floats, mu: float) -> None:
        rows, N = T.shape
        whole = np.vstack([T, np.zeros((max(N - rows, 0), N))])  # so that V has N columns
        try:
            U, sigma, self._Vt = np.linalg.svd(whole, full_matrices=False)
        except np.linalg.LinAlgError as error:
            raise SolverError(f"singular value decomposition of T: {error}") from error
        self._U = U[:rows]
        doubt = 4.0 * max(T.shape) * EPS * sigma[0]
        self.sigma = np.where(sigma > doubt, sigma, 0.0)
        square = self.sigma**2 + mu
        self._gain = np.divide(1.0, square, out=np.zeros(N), where=square > 0.0)
        last = float(sigma[-1]) if rows >= N else 0.0
        self.least = float(np.hypot(max(last - doubt, 0.0), np.sqrt(mu)))
        largest, smallest = (float(np.hypot(x, np.sqrt(mu))) for x in (sigma[0], last))
        self.condition = largest / smallest if smallest > 0.0 else float("inf")

    def solve(self, f1: Floats, f2: Floats) -> Floats:
        """Return y (N,) for f1 (M,), f2 (N,); if mu = 0, without components in T's null space."""
        y = self._gain * (self.sigma * (f1 @ self._U) + self._Vt @ f2)
        return np.asarray(y @ self._Vt)

    def along_null(self, f2: Floats) -> Floats:
        """Return the part of f2 that T does not see, (N,)."""
        hidden = self._Vt[self.sigma == 0.0]
        return np.asarray((hidden @ f2) @ hidden)
