"""A problem of the reference solver divided by a power of two, so that |T| is near 1."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from taction.system.array_types import Floats
from taction.system.errors import SolverError
from taction.verification.reference.exact_products import ExactMatrix
from taction.verification.reference.problem import Problem
from taction.verification.reference.regularisers import REGULARISERS, Regulariser

LARGEST = 1e150
"""Numbers above this are refused: their products overflow."""


@dataclass(frozen=True, slots=True, eq=False)
class ScaledProblem:
    """Minimise ``1/2 |T u - eps|^2 + mu sum(phi(u) + beta u)``, with |T| near 1.

    The division by a power of two is exact, so this is the same problem; general solvers given
    T at 1e-12 report success with half of u wrong.
    """

    T: Floats  # (M, N), Frobenius norm between 0.7 and 1.5, or 0
    eps: Floats  # strain over `scale` (M,)
    mu: float  # `lam` times the regulariser's weight, over the square of `scale`
    beta: float  # 1 with bias, else 0
    scale: float  # the power of two
    norm: float  # Frobenius norm of T
    h: Floats  # diagonal of ``T^T T`` (N,), positive
    gram: Floats  # ``T^T T`` (N, N)
    exact: ExactMatrix  # T
    regulariser: Regulariser

    @classmethod
    def of(cls, problem: Problem) -> ScaledProblem:
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
        beta, norm, exact = float(problem.bias), float(np.sqrt(trace)), ExactMatrix(T)
        scaled = cls(T, problem.eps, mu, beta, scale, norm, h, gram, exact, regulariser)
        return scaled.with_strain(problem.eps)

    def with_strain(self, eps: Floats) -> ScaledProblem:
        """Return the problem with the unscaled strain `eps`; SolverError if it overflows."""
        divided = eps / self.scale
        if not np.all(np.abs(divided) < LARGEST):
            raise SolverError(f"T of norm {self.norm * self.scale!r} is too small for eps")
        return replace(self, eps=divided)
