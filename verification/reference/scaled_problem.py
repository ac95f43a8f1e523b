"""A problem with an array T, divided by a power of two near |T|."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from taction.system.array_types import Floats
from taction.system.errors import SolverError
from taction.verification.reference.newton import System
from taction.verification.reference.problem import Problem
from taction.verification.reference.regularisers import REGULARISERS
from taction.verification.reference.stacked_least_squares import Factor, factorise


@dataclass(frozen=True, slots=True, eq=False)
class Scaled(System):
    """Minimise ``1/2 |T u - eps|^2 + mu sum(phi(u) + beta u)``, with |T| near 1.

    The division by a power of two is exact, so this is the same problem; general solvers given
    T at 1e-12 report success with half of u wrong. `norm` is the Frobenius norm of T.
    """

    T: Floats  # (M, N), Frobenius norm between 0.7 and 1.5, or 0
    gram: Floats  # ``T^T T`` (N, N)

    @classmethod
    def of(cls, problem: Problem) -> Scaled:
        """Scale a problem; SolverError if lam or eps then overflows."""
        peak = float(np.max(np.abs(problem.T)))
        length = np.sqrt(np.sum((problem.T / peak) ** 2)) if peak > 0.0 else 0.0
        scale = float(2.0 ** np.rint(np.log2(peak * length))) if peak > 0.0 else 1.0
        T = problem.T / scale
        regulariser = REGULARISERS[problem.regulariser]
        mu = regulariser.weight * problem.lam / scale / scale
        gram = T.T @ T
        if not np.isfinite(mu):
            raise SolverError(f"T of norm {peak * length!r} is too small for lambda")
        trace = float(np.trace(gram))
        h = np.maximum(gram.diagonal(), max(1e-30 * trace, float(np.finfo(float).tiny)))
        beta, norm = float(problem.bias), float(np.sqrt(trace))
        scaled = cls(problem.eps, mu, beta, scale, norm, h, regulariser, T, gram)
        return scaled.with_strain(problem.eps)

    def with_strain(self, eps: Floats) -> Scaled:
        """Return the problem with the unscaled strain `eps`; SolverError if it overflows."""
        divided = eps / self.scale
        if not np.all(np.isfinite(divided)):
            raise SolverError(f"T of norm {self.norm * self.scale!r} is too small for eps")
        return replace(self, eps=divided)

    def product(self, u: Floats) -> Floats:
        """Return ``T u`` (M,)."""
        return np.asarray(self.T @ u)

    def transposed(self, r: Floats) -> Floats:
        """Return ``T^T r`` (N,)."""
        return np.asarray(r @ self.T)

    def factor(self, D: Floats, mu: float) -> Factor:
        """Factorise ``[T D; sqrt(mu) I]``."""
        return factorise(self.T, self.gram, D, mu)
