"""Newton's method in the coordinate ``q = mu v + h g(v)``, with a homotopy in mu.

Minimises ``1/2 |T u - eps|^2 + mu sum(phi(u) + beta u)``, ``u = g(v)``, ``phi' = g^-1``, whether T
is an array or a fast product. The coordinate neither overflows nor stalls as mu goes to 0, where
the method becomes an active-set method; the homotopy starts where one step nearly suffices.

Every iterate has a duality gap: with y the Newton step, ``r+ = eps - T u - T D y`` is dual
feasible whatever the accuracy of y, and the gap is at least ``1/2 |T (u - u*)|^2`` and mu times
the Bregman divergence of u from u*.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np

from taction.system.array_types import Floats
from taction.system.errors import SolverError
from taction.verification.reference.problem import Problem
from taction.verification.reference.regularisers import REGULARISERS, Regulariser
from taction.verification.reference.stacked_least_squares import StackedFactor, factorise

STAGE = 1.0
"""Square of the relative error of u at which a stage of the homotopy ends."""
MAX_STEPS = 100
OBJECTIVE_ROUNDING = 1e-14
"""Relative rounding error of the objective, which the line search ignores."""
SHORTEST_STEP = 1e-10


@dataclass(frozen=True, slots=True, eq=False)
class System(ABC):
    """A problem divided by a power of two near |T|; a subclass holds T."""

    eps: Floats  # strain over `scale` (M,)
    mu: float  # `lam` times the regulariser's weight, over the square of `scale`; positive
    beta: float  # 1 with bias, else 0
    scale: float  # the power of two
    norm: float  # upper bound on the spectral norm of the scaled T
    h: Floats  # diagonal of ``T^T T`` (N,), positive
    regulariser: Regulariser

    @abstractmethod
    def product(self, u: Floats) -> Floats:
        """Return ``T u`` (M,)."""

    @abstractmethod
    def transposed(self, r: Floats) -> Floats:
        """Return ``T^T r`` (N,)."""

    @abstractmethod
    def factor(self, D: Floats, mu: float) -> StackedFactor:
        """Prepare ``(D T^T T D + mu I) y = D T^T f1 + f2``."""


def error_bound(ratio: float, slope_bound: float) -> float:
    """Return the largest ``|u - u*|`` for a gap of mu times `ratio`.

    The divergence is at least ``d^2 / 2`` over the largest slope between u and u*, and that slope
    is at most ``slope_bound + d``.
    """
    return ratio + float(np.sqrt(ratio * ratio + 2.0 * ratio * slope_bound))


def largest_ratio(allowed: float, slope_bound: float) -> float:
    """Return the largest gap over mu whose error bound is `allowed`."""
    return allowed * allowed / (2.0 * (slope_bound + allowed))


def divergence(regulariser: Regulariser, v: Floats, size: Floats) -> float:
    """Bound ``sum Psi(v + d) - Psi(v) - g(v) d`` for ``|d| <= size``, free of cancellation."""
    with np.errstate(over="ignore", invalid="ignore"):
        return float(np.sum(0.5 * size * size * regulariser.largest_slope(v, size)))


@dataclass(frozen=True, slots=True, eq=False)
class Iterate:
    """v with u = g(v), the residual eps - T u and the objective at some mu."""

    v: Floats
    u: Floats
    residual: Floats
    objective: float

    @classmethod
    def at(cls, s: System, v: Floats, mu: float) -> Iterate:
        """Evaluate at v (N,)."""
        u = s.regulariser.g(v)
        residual = s.eps - s.product(u)
        penalty = float(np.sum(s.regulariser.energy(v) + s.beta * u))
        return cls(v, u, residual, 0.5 * float(residual @ residual) + mu * penalty)


@dataclass(frozen=True, slots=True, eq=False)
class NewtonResult:
    """The last iterate of Newton's method."""

    primal: Iterate
    dual: Floats  # dual vector (M,) of the gap
    next_step: Floats | None  # the step in q (N,) that would follow; None if the target is missed
    steps: int


def newton(
    s: System, mu: float, iterate: Iterate, target_ratio: Callable[[Floats], float]
) -> NewtonResult:
    """Minimise at `mu`, which replaces ``s.mu``, until the gap over mu is at most the target.

    Parameters
    ----------
    s : System
        The problem.
    mu : float
        Regularisation.
    iterate : Iterate
        Start.
    target_ratio : callable
        ``u ->`` the gap over mu at which to stop; the caller checks the gap that was reached.
    """
    reg, previous = s.regulariser, float("inf")
    size = float(np.linalg.norm(s.eps))
    dual = iterate.residual
    for step in range(MAX_STEPS):
        D = np.sqrt(reg.slope(iterate.v))
        y = s.factor(D, mu).solve(iterate.residual, -mu * D * (iterate.v + s.beta))
        g = s.product(D * y)
        dual = iterate.residual - g
        mu_dv = s.transposed(dual) - mu * (iterate.v + s.beta)  # mu times the step in v
        dq = mu_dv + s.h * D * y
        gap = 0.5 * float(g @ g) + mu * divergence(reg, iterate.v, np.abs(mu_dv) / mu)
        if gap <= mu * target_ratio(iterate.u):
            return NewtonResult(iterate, dual, dq, step)
        magnitude = abs(iterate.objective) + size * float(np.linalg.norm(iterate.residual))
        rounding = OBJECTIVE_ROUNDING * magnitude
        if gap <= rounding and gap > 0.5 * previous:
            return NewtonResult(iterate, dual, None, step)
        previous = gap
        trial = _line_search(s, mu, iterate, dq, float(mu * y @ y + g @ g), rounding)
        if trial is None:
            return NewtonResult(iterate, dual, None, step)
        iterate = trial
    return NewtonResult(iterate, dual, None, MAX_STEPS)


def _line_search(
    s: System, mu: float, iterate: Iterate, dq: Floats, decrement: float, rounding: float
) -> Iterate | None:
    """Halve the step until the objective falls enough (Armijo); None if it never does."""
    q, length = mu * iterate.v + s.h * iterate.u, 1.0
    while length >= SHORTEST_STEP:
        trial = Iterate.at(s, s.regulariser.v_from_q(q + length * dq, mu, s.h), mu)
        if trial.objective <= iterate.objective - 1e-4 * length * decrement + rounding:
            return trial
        length *= 0.5
    return None


def homotopy(
    s: System, target_ratio: Callable[[Floats], float], factor: float = 0.01
) -> NewtonResult:
    """Follow the minimiser from a large mu down to ``s.mu``; `target_ratio` as in `newton`.

    `factor` is that between two values of mu.
    """
    reg, steps = s.regulariser, 0
    mu = max(s.mu, s.norm**2)
    iterate = Iterate.at(s, np.full(len(s.h), -s.beta), mu)
    while mu > s.mu:
        stage = newton(s, mu, iterate, lambda u: STAGE * float(np.sum(reg.slope_bound(u))))
        v, u = stage.primal.v, stage.primal.u
        continuous = mu * (v + s.beta) + s.h * u  # T^T r + h u: continuous as mu goes to 0
        mu = max(factor * mu, s.mu)
        iterate = Iterate.at(s, reg.v_from_q(continuous - mu * s.beta, mu, s.h), mu)
        steps += stage.steps
    last = newton(s, mu, iterate, target_ratio)
    return replace(last, steps=steps + last.steps)


@dataclass(frozen=True, slots=True, eq=False)
class ScaledProblem(System):
    """Minimise ``1/2 |T u - eps|^2 + mu sum(phi(u) + beta u)``, with |T| near 1.

    The division by a power of two is exact, so this is the same problem; general solvers given
    T at 1e-12 report success with half of u wrong. `norm` is the Frobenius norm of T.
    """

    T: Floats  # (M, N), Frobenius norm between 0.7 and 1.5, or 0
    gram: Floats  # ``T^T T`` (N, N)

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
        beta, norm = float(problem.bias), float(np.sqrt(trace))
        scaled = cls(problem.eps, mu, beta, scale, norm, h, regulariser, T, gram)
        return scaled.with_strain(problem.eps)

    def with_strain(self, eps: Floats) -> ScaledProblem:
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

    def factor(self, D: Floats, mu: float) -> StackedFactor:
        """Factorise ``[T D; sqrt(mu) I]``."""
        return factorise(self.T, self.gram, D, mu)
