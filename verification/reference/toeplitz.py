"""Solver for Toeplitz problems of up to a million channels; T is never formed.

A kernel that depends only on the distance makes T Toeplitz on an even grid. `newton` has the outer
iteration, its homotopy and its gap; `toeplitz_products` has the products and the inner solvers.
"""

from __future__ import annotations

import time
from dataclasses import dataclass

import numpy as np

from taction.system.array_types import Floats
from taction.verification.reference.newton import (
    Iterate,
    NewtonResult,
    System,
    error_bound,
    homotopy,
    largest_ratio,
    newton,
)
from taction.verification.reference.problem import SMALLEST_SCALE, Solution, ToeplitzProblem
from taction.verification.reference.regularisers import REGULARISERS
from taction.verification.reference.stacked_least_squares import Factor
from taction.verification.reference.toeplitz_products import (
    ConjugateGradients,
    Levinson,
    ToeplitzMatrix,
    circulant_power,
)

TOLERANCE = 1e-6
"""Default error of u over its largest entry below which a solution is trusted."""
LEVINSON_SIZE = 8192
"""Largest size at which Levinson's recursion solves symmetric linear problems."""


@dataclass(frozen=True, slots=True, eq=False)
class _ToeplitzSystem(System):
    """A scaled Toeplitz problem."""

    T: ToeplitzMatrix
    column: Floats  # of T (N,)
    power: Floats  # see `circulant_power`
    symmetric: bool

    @classmethod
    def of(cls, problem: ToeplitzProblem) -> _ToeplitzSystem:
        norm = ToeplitzMatrix(problem.column, problem.row).norm
        scale = float(2.0 ** np.rint(np.log2(norm))) if norm > 0.0 else 1.0
        column, row = problem.column / scale, problem.row / scale
        above, below = np.cumsum(row**2), np.cumsum(column**2)
        h = above + below[::-1] - column[0] ** 2  # the diagonal entry is in both sums
        regulariser, T = REGULARISERS[problem.regulariser], ToeplitzMatrix(column, row)
        return cls(
            eps=problem.eps / scale,
            mu=regulariser.weight * problem.lam / scale / scale,
            beta=float(problem.bias),
            scale=scale,
            norm=T.norm,
            h=np.maximum(h, max(1e-30 * float(np.max(h)), float(np.finfo(float).tiny))),
            regulariser=regulariser,
            T=T,
            column=column,
            power=circulant_power(column, row),
            symmetric=bool(np.array_equal(column, row)),
        )

    def product(self, u: Floats) -> Floats:
        return self.T.product(u)

    def transposed(self, r: Floats) -> Floats:
        return self.T.transposed(r)

    def factor(self, D: Floats, mu: float) -> Factor:
        linear = self.regulariser is REGULARISERS["linear"]
        if linear and self.symmetric and self.T.size <= LEVINSON_SIZE:
            return Levinson(self.column, mu)
        return ConjugateGradients(self.T, self.power, D, mu)


def _gap(s: _ToeplitzSystem, result: NewtonResult) -> float:
    """Evaluate the gap, with a bound on its rounding error added."""
    v, size = result.primal.v, float(np.linalg.norm(result.primal.u))
    dual, strain = float(np.linalg.norm(result.dual)), float(np.linalg.norm(s.eps))
    misfit = float(np.linalg.norm(result.primal.residual - result.dual))
    misfit += s.T.rounding * (s.norm * size + strain + dual)
    d = np.abs(s.transposed(result.dual) - s.mu * (v + s.beta)) / s.mu
    d += float(np.finfo(float).eps) * np.abs(v)
    rounding = s.T.rounding * s.norm * dual / s.mu  # norm of the rounding error of d
    with np.errstate(over="ignore", invalid="ignore"):
        slope = s.regulariser.largest_slope(v, d + rounding)
        apart = float(np.sum(slope * d * d)) + float(np.max(slope)) * rounding * rounding
    gap = 0.5 * misfit * misfit + s.mu * apart  # (d + e)^2 / 2 <= d^2 + e^2
    return gap if np.isfinite(gap) else float("inf")


def solve_toeplitz_problem(problem: ToeplitzProblem, tolerance: float = TOLERANCE) -> Solution:
    """Solve a Toeplitz problem of any size.

    Parameters
    ----------
    problem : ToeplitzProblem
        The problem.
    tolerance : float
        Error over the largest entry of u at which to stop, and below which u is trusted.

    Returns
    -------
    Solution
        Certificate: duality gap, with the rounding of the transforms added to it.
    """
    start = time.perf_counter()
    s = _ToeplitzSystem.of(problem)
    reg = s.regulariser

    def allowed(u: Floats) -> tuple[float, float]:
        peak = float(np.max(np.abs(u)))
        return tolerance * max(peak, SMALLEST_SCALE), float(np.max(reg.slope_bound(u)))

    def target_ratio(u: Floats) -> float:
        return 0.1 * largest_ratio(*allowed(u))

    if problem.regulariser == "linear":
        result = newton(s, s.mu, Iterate.at(s, np.zeros(len(s.h)), s.mu), target_ratio)
    else:
        result = homotopy(s, target_ratio)
    last = result.primal
    gap, (limit, slope_bound) = _gap(s, result), allowed(last.u)
    in_units = 2.0 * s.scale**2
    certificate, bound = in_units * gap, in_units * s.mu * largest_ratio(limit, slope_bound)
    trusted = certificate <= bound
    return Solution(
        problem=problem,
        u=last.u,
        v=None if problem.regulariser == "linear" else last.v,
        objective=in_units * last.objective,
        certificate_kind="duality gap",
        certificate=certificate,
        bound=bound,
        error_bound=error_bound(gap / s.mu, slope_bound),
        trusted=trusted,
        condition=float(np.sqrt(1.0 + s.norm**2 * float(np.max(reg.slope(last.v))) / s.mu)),
        iterations=result.steps,
        seconds=time.perf_counter() - start,
        reason=""
        if trusted
        else (
            f"the duality gap {certificate!r} is above {bound!r}, the limit for a relative error of"
            f" {tolerance!r}; use a larger lambda or a larger tolerance"
        ),
    )
