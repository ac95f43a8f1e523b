"""Newton's method in the coordinate ``q = mu v + h g(v)``, with a homotopy in mu.

Minimises ``1/2 |T u - eps|^2 + mu sum(phi(u) + beta u)``, ``u = g(v)``, ``phi' = g^-1``, whether T
is an array or a fast product. The coordinate neither overflows nor stalls as mu goes to 0, where
the method becomes an active-set method; the homotopy starts where one step nearly suffices.

Every iterate comes with a duality gap: with y the Newton step, ``r+ = eps - T u - T D y`` is dual
feasible whatever the quality of y, and the gap is at least ``1/2 |T (u - u*)|^2`` and mu times the
Bregman divergence of u from u*.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Protocol

import numpy as np

from spice_models.array_types import Floats
from verification.reference.regularisers import Regulariser
from verification.reference.stacked_least_squares import Factor

HOMOTOPY = 0.01
"""Factor between two values of mu."""
STAGE = 1.0
"""Square of the relative error of u at which a stage ends."""
MAX_STEPS = 100
NOISE = 1e-14
"""Relative rounding error of the objective, which the line search overlooks."""
SHORTEST = 1e-10


class System(Protocol):
    """What Newton's method needs to know of a problem; |T| is near 1."""

    @property
    def eps(self) -> Floats:
        """Strain (M,)."""
        ...

    @property
    def mu(self) -> float:
        """Regularisation asked for, positive."""
        ...

    @property
    def beta(self) -> float:
        """1 with bias, else 0."""
        ...

    @property
    def h(self) -> Floats:
        """Diagonal of ``T^T T`` (N,), positive."""
        ...

    @property
    def norm(self) -> float:
        """Upper bound on the spectral norm of T."""
        ...

    @property
    def regulariser(self) -> Regulariser:
        """Entry of the table."""
        ...

    def product(self, u: Floats) -> Floats:
        """Return ``T u`` (M,)."""
        ...

    def transposed(self, r: Floats) -> Floats:
        """Return ``T^T r`` (N,)."""
        ...

    def factor(self, D: Floats, mu: float) -> Factor:
        """Prepare ``(D T^T T D + mu I) y = D T^T f1 + f2``."""
        ...


def error_bound(ratio: float, ceiling: float) -> float:
    """Return the largest ``|u - u*|`` that a gap of mu times `ratio` allows.

    The divergence is at least ``d^2 / 2`` over the largest slope between, and that is at most
    ``ceiling + d``.
    """
    return ratio + float(np.sqrt(ratio * ratio + 2.0 * ratio * ceiling))


def largest_ratio(allowed: float, ceiling: float) -> float:
    """Return the largest gap over mu whose error bound is `allowed`."""
    return allowed * allowed / (2.0 * (ceiling + allowed))


def divergence(regulariser: Regulariser, v: Floats, size: Floats) -> float:
    """Bound ``sum Psi(v + d) - Psi(v) - g(v) d`` for ``|d| <= size``, free of cancellation."""
    with np.errstate(over="ignore", invalid="ignore"):
        return float(np.sum(0.5 * size * size * regulariser.steepest(v, size)))


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
class Pair:
    """How far Newton's method came.

    Attributes
    ----------
    primal : Iterate
        The last iterate.
    dual : ndarray (M,)
        Dual vector that goes with it for the gap.
    ahead : ndarray (N,) or None
        The Newton step in q that was not needed; None if the gap stayed above what was asked.
    steps : int
        Steps taken.
    """

    primal: Iterate
    dual: Floats
    ahead: Floats | None
    steps: int


def newton(s: System, mu: float, now: Iterate, enough: Callable[[Floats], float]) -> Pair:
    """Minimise at one mu.

    Parameters
    ----------
    s : System
        The problem; its own mu is not used.
    mu : float
        Regularisation.
    now : Iterate
        Where to start.
    enough : callable
        ``u ->`` the gap over mu at which to stop.

    Returns
    -------
    Pair
        Certified or not: what it is worth is for the caller to find out.
    """
    reg, previous = s.regulariser, float("inf")
    size = float(np.linalg.norm(s.eps))
    dual = now.residual
    for step in range(MAX_STEPS):
        D = np.sqrt(reg.slope(now.v))
        y = s.factor(D, mu).solve(now.residual, -mu * D * (now.v + s.beta))
        g = s.product(D * y)
        dual = now.residual - g
        toward = s.transposed(dual) - mu * (now.v + s.beta)  # mu times the step in v
        dq = toward + s.h * D * y
        gap = 0.5 * float(g @ g) + mu * divergence(reg, now.v, np.abs(toward) / mu)
        if gap <= mu * enough(now.u):
            return Pair(now, dual, dq, step)
        noise = NOISE * (abs(now.objective) + size * float(np.linalg.norm(now.residual)))
        if gap <= noise and gap > 0.5 * previous:
            return Pair(now, dual, None, step)
        previous = gap
        trial = _search(s, mu, now, dq, float(mu * y @ y + g @ g), noise)
        if trial is None:
            return Pair(now, dual, None, step)
        now = trial
    return Pair(now, dual, None, MAX_STEPS)


def _search(
    s: System, mu: float, now: Iterate, dq: Floats, decrement: float, noise: float
) -> Iterate | None:
    """Halve the step until the objective falls enough (Armijo); None if it never does."""
    q, length = mu * now.v + s.h * now.u, 1.0
    while length >= SHORTEST:
        trial = Iterate.at(s, s.regulariser.unfold(q + length * dq, mu, s.h), mu)
        if trial.objective <= now.objective - 1e-4 * length * decrement + noise:
            return trial
        length *= 0.5
    return None


def homotopy(s: System, enough: Callable[[Floats], float]) -> Pair:
    """Follow the minimiser from a large mu down to the one asked for.

    Parameters
    ----------
    s : System
        The problem.
    enough : callable
        ``u ->`` the gap over mu at which to stop.

    Returns
    -------
    Pair
        At the last mu, with all steps counted.
    """
    reg, steps = s.regulariser, 0
    mu = max(s.mu, s.norm**2)
    now = Iterate.at(s, np.full(len(s.h), -s.beta), mu)
    while mu > s.mu:
        stage = newton(s, mu, now, lambda u: STAGE * float(np.sum(reg.ceiling(u))))
        v, u = stage.primal.v, stage.primal.u
        kept = mu * (v + s.beta) + s.h * u  # T^T r + h u: continuous as mu goes to 0
        mu = max(HOMOTOPY * mu, s.mu)
        now = Iterate.at(s, reg.unfold(kept - mu * s.beta, mu, s.h), mu)
        steps += stage.steps
    last = newton(s, mu, now, enough)
    return Pair(last.primal, last.dual, last.ahead, steps + last.steps)
