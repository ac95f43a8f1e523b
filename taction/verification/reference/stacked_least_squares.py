"""Solvers of ``(A^T A + mu I) y = A^T f1 + f2``, and sums of products that are rounded once.

QR and the singular values work on A itself (or on the stacked ``[A; sqrt(mu) I]``), so the error of
f1 is not multiplied by the square of the condition number.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from taction.system.array_types import EPS, Floats
from taction.system.errors import SolverError

PRODUCT_ERROR = 2.0**-100
"""Error of `exact_sums` over the norms of the factors, beside the rounding of the result."""


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


def products(a: Floats | float, b: Floats) -> tuple[Floats, Floats]:
    """Return products and their rounding errors, by halves of both factors (Dekker 1971)."""
    (ah, al), (bh, bl) = _halves(a), _halves(b)
    p = np.asarray(a * b)
    return p, np.asarray(((ah * bh - p) + ah * bl + al * bh) + al * bl)


def _halves(a: Floats | float) -> tuple[Floats, Floats]:
    c = (2.0**27 + 1.0) * np.asarray(a)
    high = c - (c - a)
    return high, a - high


def exact_sums(A: Floats, x: Pair, *terms: Floats) -> Floats:
    """Return ``A x`` plus `terms`, all added with twice the digits before the result is rounded.

    The entries of A and of x are below 1e150.

    Examples
    --------
    >>> A = np.array([[1e16, 1.0]])
    >>> exact_sums(A, Pair.of(np.array([1.0, 1.0])), np.array([-1e16])).tolist()
    [1.0]
    """
    sums, errors = products(A, x.hi)
    sums = np.concatenate([sums, *(term[:, None] for term in terms)], axis=1)
    errors = np.concatenate([errors + A * x.lo, np.zeros((len(A), len(terms)))], axis=1)
    while (half := sums.shape[1] // 2) > 0:  # halves of the columns are added, with their errors
        a, b = sums[:, :half], sums[:, half : 2 * half]
        s = a + b
        t = s - a
        rounding = (a - (s - t)) + (b - t) + errors[:, :half] + errors[:, half : 2 * half]
        sums = np.concatenate([s, sums[:, 2 * half :]], axis=1)
        errors = np.concatenate([rounding, errors[:, 2 * half :]], axis=1)
    return np.asarray((sums + errors)[:, 0])


Solver = Callable[[Floats, Floats], Floats]
"""Return y (N,) for f1 (M,) and f2 (N,)."""
CHOLESKY_LIMIT = 1e-12  # of mu over ``|A|^2``: from here on normal equations are accurate enough


def factorise(A: Floats, mu: float) -> Solver:
    """Factorise A (M, N) by Cholesky where it is accurate enough, else by QR; mu is positive."""
    from scipy.linalg.lapack import dpotrf, dpotrs, dtrtrs

    one = np.eye(A.shape[1])
    if mu > CHOLESKY_LIMIT * float(np.sum(A * A)):
        L, failed = dpotrf(A.T @ A + mu * one, lower=1)
        if not failed:
            return lambda f1, f2: np.asarray(dpotrs(L, f1 @ A + f2, lower=1)[0])
    Q, R = np.linalg.qr(np.vstack([A, np.sqrt(mu) * one]))

    def solve(f1: Floats, f2: Floats) -> Floats:
        return np.asarray(dtrtrs(R, f1 @ Q[: len(A)] + dtrtrs(R, f2, trans=1)[0])[0])

    return solve


class SVD:
    """Singular values `sigma` (N,) of T, 0 where rounding hides them; mu may be 0.

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
