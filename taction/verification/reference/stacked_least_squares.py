"""Solvers of ``(A^T A + mu I) y = A^T f1 + f2``.

QR and the singular values work on A itself (or on the stacked ``[A; sqrt(mu) I]``), so the error of
f1 is not multiplied by the square of the condition number.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from taction.system.array_types import EPS, Floats
from taction.system.errors import SolverError

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
