"""The problem divided by a power of two near |T|, with what every solver needs of it."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from spice_models.array_types import Floats
from spice_models.errors import SolverError
from verification.reference.problem import Problem
from verification.reference.regularisers import REGULARISERS, Regulariser
from verification.reference.stacked_least_squares import Factor, factorise


@dataclass(frozen=True, slots=True, eq=False)
class Scaled:
    """Minimise ``1/2 |T u - eps|^2 + mu sum(phi(u) + beta u)``, with |T| near 1.

    The division by a power of two is exact, so this is the same problem; general solvers given
    T at 1e-12 report success with half of u wrong.

    Attributes
    ----------
    T : ndarray (M, N)
        Frobenius norm between 0.7 and 1.5, or 0.
    eps : ndarray (M,)
        Divided by `scale`.
    mu : float
        ``lam`` times the regulariser's weight, divided by the square of `scale`.
    beta : float
        1 with bias, else 0.
    scale : float
        The power of two.
    gram : ndarray (N, N)
        ``T^T T``.
    h : ndarray (N,)
        Its diagonal, floored.
    regulariser : Regulariser
        Entry of the table.
    """

    T: Floats
    eps: Floats
    mu: float
    beta: float
    scale: float
    gram: Floats
    h: Floats
    regulariser: Regulariser

    @classmethod
    def of(cls, problem: Problem) -> Scaled:
        """Scale a problem; SolverError if lam or eps overflow by it."""
        peak = float(np.max(np.abs(problem.T)))
        length = np.sqrt(np.sum((problem.T / peak) ** 2)) if peak > 0.0 else 0.0
        scale = float(2.0 ** np.rint(np.log2(peak * length))) if peak > 0.0 else 1.0
        T = problem.T / scale
        regulariser = REGULARISERS[problem.regulariser]
        mu = regulariser.weight * problem.lam / scale / scale
        gram = T.T @ T
        if not np.isfinite(mu):
            raise SolverError(f"T of norm {peak * length!r} is too small for lambda")
        h = np.maximum(gram.diagonal(), 1e-30 * float(np.trace(gram)))
        h = np.maximum(h, np.finfo(float).tiny)
        beta = float(problem.bias)
        scaled = cls(T, problem.eps, mu, beta, scale, gram, h, regulariser)
        return scaled.with_strain(problem.eps)

    def with_strain(self, eps: Floats) -> Scaled:
        """Return the same with the strain `eps`, not yet divided; SolverError if it overflows."""
        divided = eps / self.scale
        if not np.all(np.isfinite(divided)):
            raise SolverError(f"T of norm {self.norm * self.scale!r} is too small for eps")
        return replace(self, eps=divided)

    @property
    def norm(self) -> float:
        """Frobenius norm of the scaled T."""
        return float(np.sqrt(np.trace(self.gram)))

    def product(self, u: Floats) -> Floats:
        """Return ``T u`` (M,)."""
        return np.asarray(self.T @ u)

    def transposed(self, r: Floats) -> Floats:
        """Return ``T^T r`` (N,)."""
        return np.asarray(r @ self.T)

    def factor(self, D: Floats, mu: float) -> Factor:
        """Factorise ``[T D; sqrt(mu) I]``."""
        return factorise(self.T, self.gram, D, mu)
