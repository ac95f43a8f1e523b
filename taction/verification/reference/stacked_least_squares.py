"""Solvers of ``(A^T A + mu I) y = A^T f1 + f2``, ``A = T D`` with D diagonal, to full accuracy.

Every refinement in this folder solves these equations for its correction. QR and the singular
values work on A itself (or on the stacked ``[A; sqrt(mu) I]``), so the error of f1 is not
multiplied by the square of the condition number.
"""

from __future__ import annotations

from typing import Protocol

import numpy as np

from taction.system.array_types import EPS, Floats, Indices
from taction.system.errors import SolverError

CHOLESKY_LIMIT = 1e-12
"""Normal equations are used while mu is above this times ``|T D|^2``; QR below."""
NEGLIGIBLE = 1e-16
"""A channel whose ``|T D|^2`` is below this times mu is not coupled to the others."""
WORTHWHILE = 0.9
"""Uncoupled channels are left out if at most this share of all channels remains."""


class StackedFactor(Protocol):
    """A factorised stacked system."""

    def solve(self, f1: Floats, f2: Floats) -> Floats:
        """Return y (N,) for f1 (M,) and f2 (N,)."""
        ...


class _Cholesky:
    """Normal equations: fastest, error about ``condition^2 * 1e-16``."""

    def __init__(self, T: Floats, gram: Floats, D: Floats, mu: float) -> None:
        from scipy.linalg.lapack import dpotrf

        H = gram * D
        H *= D[:, None]
        H.flat[:: len(H) + 1] += mu
        # H is symmetric, and H.T has LAPACK's memory order: no copy.
        self._L, self.failed = dpotrf(H.T, lower=1, clean=0, overwrite_a=1)
        self._T, self._D = T, D

    def solve(self, f1: Floats, f2: Floats) -> Floats:
        from scipy.linalg.lapack import dpotrs

        return np.asarray(dpotrs(self._L, self._D * (f1 @ self._T) + f2, lower=1)[0])


class _QR:
    """Orthogonal factorisation: error about ``condition * 1e-16``."""

    def __init__(self, A: Floats, mu: float) -> None:
        Q, self._R = np.linalg.qr(np.vstack([A, np.sqrt(mu) * np.eye(A.shape[1])]))
        self._Q = Q[: A.shape[0]]

    def solve(self, f1: Floats, f2: Floats) -> Floats:
        from scipy.linalg.lapack import dtrtrs

        z = dtrtrs(self._R, f2, trans=1)[0]
        return np.asarray(dtrtrs(self._R, f1 @ self._Q + z)[0])


class SVD:
    """Singular values `sigma` of T (D = 1, descending); mu may be 0.

    `least` is a lower bound on the least singular value of the stacked matrix (0 if it is
    rank-deficient), `condition` the condition number of the stacked matrix.

    Raises
    ------
    SolverError
        The decomposition does not converge.
    """

    def __init__(self, T: Floats, mu: float) -> None:
        try:
            self._U, self.sigma, self._Vt = np.linalg.svd(T, full_matrices=False)
        except np.linalg.LinAlgError as error:
            raise SolverError(f"singular value decomposition of T: {error}") from error
        self._mu, self._complete = mu, T.shape[0] >= T.shape[1]
        sigma = self.sigma
        doubt = 4.0 * max(T.shape) * EPS * sigma[0]
        keep = sigma > doubt
        inverse = 1.0 / np.where(keep, sigma * sigma + mu, 1.0)
        self._gain = np.where(keep, inverse, 1.0 / mu if mu > 0.0 else 0.0)
        last = float(sigma[-1]) if self._complete else 0.0
        smallest = np.hypot(last, np.sqrt(mu))
        self.least = float(np.hypot(max(last - doubt, 0.0), np.sqrt(mu)))
        self.condition = (
            float(np.hypot(sigma[0], np.sqrt(mu)) / smallest) if smallest > 0.0 else float("inf")
        )

    def solve(self, f1: Floats, f2: Floats) -> Floats:
        """Return y (N,) for f1 (M,), f2 (N,); if mu = 0, without components in T's null space."""
        inner = self._Vt @ f2
        y = (self._gain * (self.sigma * (f1 @ self._U) + inner)) @ self._Vt
        if self._mu > 0.0 and not self._complete:
            orthogonal = f2 - inner @ self._Vt
            orthogonal -= (self._Vt @ orthogonal) @ self._Vt  # mu would magnify the rounding
            y = y + orthogonal / self._mu
        return np.asarray(y)


class _Partial:
    """Factorise only the channels that D leaves coupled; divide the others by mu.

    The neglected part is below 1e-8 of a correction; the next correction removes its effect.
    """

    def __init__(self, T: Floats, gram: Floats, D: Floats, mu: float, active: Indices) -> None:
        self._T, self._D, self._mu, self._active = T, D, mu, active
        inside = np.ix_(active, active)
        self._inner = factorise(T[:, active], gram[inside], D[active], mu) if len(active) else None

    def solve(self, f1: Floats, f2: Floats) -> Floats:
        y = (self._D * (f1 @ self._T) + f2) / self._mu
        if self._inner is not None:
            y[self._active] = self._inner.solve(f1, f2[self._active])
        return np.asarray(y)


def factorise(T: Floats, gram: Floats, D: Floats, mu: float) -> StackedFactor:
    """Factorise by Cholesky where Cholesky is accurate enough, else by QR.

    `T` (M, N), `gram` = ``T^T T`` (N, N), `D` (N,) at least 0, `mu` positive. Channels with a
    negligible D are left out of the factorisation: most channels for small mu.
    """
    diagonal = gram.diagonal() * D * D
    active = np.flatnonzero(diagonal > NEGLIGIBLE * mu)
    if len(active) < WORTHWHILE * len(D):
        return _Partial(T, gram, D, mu, active)
    if mu > CHOLESKY_LIMIT * float(np.sum(diagonal)):
        factor = _Cholesky(T, gram, D, mu)
        if not factor.failed:
            return factor
    return _QR(T * D, mu)
