"""Toeplitz problems at size: a million channels without ever forming T.

A kernel that depends on the distance alone, on an even grid, makes T Toeplitz. The outer iteration,
its homotopy and its gap are those of `newton`; the products and the inner solvers are those of
`convolution`.
"""

from __future__ import annotations

import time
from dataclasses import dataclass

import numpy as np

from spice_models.array_types import Floats
from verification.reference.newton import (
    Iterate,
    Pair,
    error_bound,
    homotopy,
    largest_ratio,
    newton,
)
from verification.reference.problem import SMALLEST_SCALE, Solution, ToeplitzProblem
from verification.reference.regularisers import REGULARISERS, Regulariser
from verification.reference.stacked_least_squares import Factor
from verification.reference.toeplitz_products import (
    ConjugateGradients,
    Levinson,
    ToeplitzMatrix,
    circulant_power,
)

TOLERANCE = 1e-6
"""Error of u over its largest entry below which a solution is trusted, if not asked otherwise."""
LEVINSON_SIZE = 8192
"""Up to here, Levinson's recursion solves symmetric linear problems."""


@dataclass(frozen=True, slots=True, eq=False)
class _System:
    """A scaled Toeplitz problem as `newton` wants it."""

    T: ToeplitzMatrix
    column: Floats
    power: Floats
    eps: Floats
    mu: float
    beta: float
    scale: float
    h: Floats
    regulariser: Regulariser
    symmetric: bool

    @classmethod
    def of(cls, problem: ToeplitzProblem) -> _System:
        norm = ToeplitzMatrix(problem.column, problem.row).norm
        scale = float(2.0 ** np.rint(np.log2(norm))) if norm > 0.0 else 1.0
        column, row = problem.column / scale, problem.row / scale
        before, after = np.cumsum(row**2), np.cumsum(column**2)
        h = before + after[::-1] - column[0] ** 2  # squares of the entries above and below
        regulariser = REGULARISERS[problem.regulariser]
        return cls(
            T=ToeplitzMatrix(column, row),
            column=column,
            power=circulant_power(column, row),
            eps=problem.eps / scale,
            mu=regulariser.weight * problem.lam / scale / scale,
            beta=float(problem.bias),
            scale=scale,
            h=np.maximum(h, max(1e-30 * float(np.max(h)), float(np.finfo(float).tiny))),
            regulariser=regulariser,
            symmetric=bool(np.array_equal(column, row)),
        )

    @property
    def norm(self) -> float:
        return self.T.norm

    def product(self, u: Floats) -> Floats:
        return self.T.product(u)

    def transposed(self, r: Floats) -> Floats:
        return self.T.transposed(r)

    def factor(self, D: Floats, mu: float) -> Factor:
        linear = self.regulariser is REGULARISERS["linear"]
        if linear and self.symmetric and self.T.size <= LEVINSON_SIZE:
            return Levinson(self.column, mu)
        return ConjugateGradients(self.T, self.power, D, mu)


def _gap(s: _System, pair: Pair) -> float:
    """Evaluate the gap again with what rounding may have added to it."""
    v, size = pair.primal.v, float(np.linalg.norm(pair.primal.u))
    dual, strain = float(np.linalg.norm(pair.dual)), float(np.linalg.norm(s.eps))
    miss = float(np.linalg.norm(pair.primal.residual - pair.dual))
    miss += s.T.rounding * (s.norm * size + strain + dual)
    d = np.abs(s.transposed(pair.dual) - s.mu * (v + s.beta)) / s.mu
    d += float(np.finfo(float).eps) * np.abs(v)
    lost = s.T.rounding * s.norm * dual / s.mu  # norm of what rounding did to d
    with np.errstate(over="ignore", invalid="ignore"):
        steepest = s.regulariser.steepest(v, d + lost)
        apart = float(np.sum(steepest * d * d)) + float(np.max(steepest)) * lost * lost
    gap = 0.5 * miss * miss + s.mu * apart  # (d + e)^2 / 2 <= d^2 + e^2
    return gap if np.isfinite(gap) else float("inf")


def solve_toeplitz_problem(problem: ToeplitzProblem, tolerance: float = TOLERANCE) -> Solution:
    """Solve a Toeplitz problem of any size.

    Parameters
    ----------
    problem : ToeplitzProblem
        What to solve.
    tolerance : float
        Error over the largest entry of u at which to stop, and below which to trust the answer.

    Returns
    -------
    Solution
        Certificate: duality gap, with the rounding of the transforms added to it.
    """
    start = time.perf_counter()
    s = _System.of(problem)
    reg = s.regulariser

    def allowed(u: Floats) -> tuple[float, float]:
        peak = float(np.max(np.abs(u)))
        return tolerance * max(peak, SMALLEST_SCALE), float(np.max(reg.ceiling(u)))

    def enough(u: Floats) -> float:
        return 0.1 * largest_ratio(*allowed(u))

    if problem.regulariser == "linear":
        pair = newton(s, s.mu, Iterate.at(s, np.zeros(len(s.h)), s.mu), enough)
    else:
        pair = homotopy(s, enough)
    last = pair.primal
    gap, (limit, ceiling) = _gap(s, pair), allowed(last.u)
    in_units = 2.0 * s.scale**2
    certificate, bound = in_units * gap, in_units * s.mu * largest_ratio(limit, ceiling)
    trusted = certificate <= bound
    return Solution(
        problem=problem,
        u=last.u,
        v=None if problem.regulariser == "linear" else last.v,
        objective=in_units * last.objective,
        certificate_kind="duality gap",
        certificate=certificate,
        bound=bound,
        error_bound=error_bound(gap / s.mu, ceiling),
        trusted=trusted,
        condition=float(np.sqrt(1.0 + s.norm**2 * float(np.max(reg.slope(last.v))) / s.mu)),
        iterations=pair.steps,
        seconds=time.perf_counter() - start,
        reason="" if trusted else _reason(certificate, bound, tolerance),
    )


def _reason(gap: float, bound: float, tolerance: float) -> str:
    return (
        f"the duality gap {gap!r} is above {bound!r}, which a relative error of {tolerance!r} "
        "needs; use a larger lambda or a larger tolerance"
    )
