"""A table of the regularisers that amplifiers add to the energy (eq 17).

An amplifier ``u = g(v)``, g increasing, regularises with the integral of its inverse. All functions
take v, which stays finite where u underflows or saturates. With ``Psi`` the integral of g,
``integral of g^-1 = u v - Psi(v)`` up to a constant. With mu half of lam and h a positive weight,
the solver's coordinate is ``q = mu v + h g(v)``; it neither overflows nor stalls as mu goes to 0.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass

import numpy as np

from taction.system.array_types import Floats
from taction.system.plugins import OpenTable

Function = Callable[[Floats], Floats]
STEPS = 200  # enough for bisection alone


@dataclass(frozen=True, slots=True)
class Pieces:
    """The convex function ``phi(u) = size |u| + u^2 / 2`` within bounds, a regulariser's pieces."""

    size: float = 0.0  # slope of ``|u|``
    # `low`, `high`: bounds of u.
    low: float = -math.inf
    high: float = math.inf

    def g(self, v: Floats) -> Floats:
        """Return the inverse of the derivative of phi: the proximal map of its other parts."""
        u = v - np.clip(v, -self.size, self.size)
        return np.asarray(np.clip(u, self.low, self.high))

    def regulariser(self) -> Regulariser:
        """Return the functions of the regulariser."""

        def inside(v: Floats) -> Floats:
            return np.asarray(
                (np.abs(v) > self.size) & (self.g(v) > self.low) & (self.g(v) < self.high)
            )

        def inverse(u: Floats) -> Floats:
            outside = (u < self.low) | (u > self.high)
            return np.where(outside, np.nan, u + self.size * np.sign(u))

        def potential(v: Floats) -> Floats:
            u = self.g(v)
            return np.asarray(u * v - self.size * np.abs(u) - 0.5 * u * u)

        return Regulariser(
            g=self.g,
            slope=lambda v: inside(v).astype(np.float64),
            inverse=inverse,
            potential=potential,
            pieces=self,
        )


@dataclass(frozen=True, slots=True)
class Regulariser:
    """An increasing g with the functions that a certified Newton method needs."""

    g: Function
    slope: Function  # derivative of g
    inverse: Function  # of g
    potential: Function  # ``Psi``
    # ``(v, d)``: largest slope in [v - d, v + d]; by default of a g whose slope is at most 1.
    largest_slope: Callable[[Floats, Floats], Floats] = lambda v, _: np.ones_like(v)
    # ``u ->`` a bound S on the slope at u; ``S + d`` bounds the slope at u + d.
    slope_bound: Function = np.ones_like
    weight: float = 0.5  # ``mu = weight * lam``: 1 for linear, whose Omega is ``sum u^2``
    biased: bool = False  # whether the paper's Omega needs the bias current: eq (8) has the entropy
    pieces: Pieces | None = None  # of a g of straight pieces, whose problem is solved exactly

    def energy(self, v: Floats) -> Floats:
        """Return the integral of the inverse at ``u = g(v)``, up to a constant."""
        return self.g(v) * v - self.potential(v)

    def v_from_q(self, q: Floats, mu: float, h: Floats) -> Floats:
        """Solve ``mu v + h g(v) = q`` by Newton's method in a bracket of each root.

        It starts from ``h g(v) = q``. A step that leaves the bracket, or that follows one that left
        more than half of the residual, is replaced by the bracket's middle.
        """
        far = (q - h * self.g(np.zeros_like(q))) / mu
        low, high, before = np.minimum(far, 0.0), np.maximum(far, 0.0), np.full_like(q, np.inf)
        with np.errstate(all="ignore"):
            v = np.clip(np.nan_to_num(self.inverse(q / h), nan=0.0), low, high)
            for _ in range(STEPS):
                linear, curved = mu * v, h * self.g(v)
                excess = linear + curved - q
                terms = np.abs(linear) + np.abs(curved) + np.abs(q)
                if np.all(np.abs(excess) <= 1e-15 * terms):
                    break
                low, high = np.where(excess <= 0.0, v, low), np.where(excess >= 0.0, v, high)
                step = v - excess / (mu + h * self.slope(v))
                good = (step >= low) & (step <= high) & (np.abs(excess) <= 0.5 * before)
                good |= np.abs(excess) <= 1e-15 * terms
                before = np.abs(excess)
                v = np.where(good, step, 0.5 * (low + high))
        return v


def _sigmoid(v: Floats) -> Floats:
    small = np.exp(-np.abs(v))
    return np.where(v >= 0.0, 1.0, small) / (1.0 + small)


def _sech2(v: Floats) -> Floats:
    small = np.exp(-2.0 * np.abs(v))
    return 4.0 * small / (1.0 + small) ** 2


def _softplus(v: Floats) -> Floats:
    return np.maximum(v, 0.0) + np.log1p(np.exp(-np.abs(v)))


def _softplus_potential(v: Floats) -> Floats:
    from scipy.special import spence

    tail = -spence(1.0 + np.exp(-np.abs(v)))  # -Li2(-e^-|v|)
    return np.where(v > 0.0, 0.5 * v * v + np.pi**2 / 6.0 - tail, tail)


REGULARISERS: Mapping[str, Regulariser] = OpenTable(
    "taction.amplifiers",
    {
        "linear": Regulariser(
            g=lambda v: v,
            slope=np.ones_like,
            inverse=lambda u: u,
            potential=lambda v: 0.5 * v * v,
            weight=1.0,
        ),
        "exponential": Regulariser(
            g=np.exp,
            slope=np.exp,
            inverse=np.log,
            potential=np.exp,
            largest_slope=lambda v, d: np.exp(v + d),
            slope_bound=lambda u: u,
            biased=True,
        ),
        "sinh": Regulariser(
            g=np.sinh,
            slope=np.cosh,
            inverse=np.arcsinh,
            potential=np.cosh,
            largest_slope=lambda v, d: np.cosh(np.abs(v) + d),
            slope_bound=lambda u: 1.0 + np.abs(u),
        ),
        "softplus": Regulariser(
            g=_softplus,
            slope=_sigmoid,
            inverse=lambda u: u + np.log(-np.expm1(-u)),
            potential=_softplus_potential,
            largest_slope=lambda v, d: _sigmoid(v + d),
            slope_bound=lambda u: -np.expm1(-u),
        ),
        "tanh": Regulariser(
            g=np.tanh,
            slope=_sech2,
            inverse=np.arctanh,
            potential=lambda v: np.abs(v) + np.log1p(np.exp(-2.0 * np.abs(v))) - np.log(2.0),
            largest_slope=lambda v, d: _sech2(np.maximum(np.abs(v) - d, 0.0)),
        ),
        "deadzone": Pieces(size=1.0).regulariser(),
        "rectifier": Pieces(low=0.0).regulariser(),
        "saturation": Pieces(low=-1.0, high=1.0).regulariser(),
    },
    Regulariser,
    part="regulariser",
)
"""The regularisers by the names of their amplifiers, with those of other packages."""
