"""Readings of an integrated transient: crossings are searched on a dense grid and refined."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from flint import arb
from scipy.optimize import brentq, minimize_scalar

from tests.support.nonlinear_response import Transient

PER_STEP = 8  # points in each step of the integrator
Floats = np.ndarray


@dataclass(frozen=True, eq=False)
class Samples:
    """A channel's error ``e = u - target`` on a dense grid (P,), and as a function of time."""

    time: Floats
    error: Floats
    at: Callable[[float], float]
    end: float  # at the equilibrium

    @classmethod
    def of(cls, transient: Transient, ends: list[tuple[float, float]]) -> list[Samples]:
        """Return the samples of channels with these targets and errors at the equilibrium."""
        steps, targets = transient.steps, [target for target, _ in ends]
        inner = np.linspace(0.0, 1.0, PER_STEP + 1)[:-1]
        time = (steps[:-1, None] + np.diff(steps)[:, None] * inner).ravel()
        time = np.append(time, steps[-1])
        errors = transient.outputs(time) - np.array(targets)

        def function(n: int) -> Callable[[float], float]:
            return lambda t: float(transient.outputs(np.array([t]))[0, n] - targets[n])

        return [cls(time, errors[:, n], function(n), end) for n, (_, end) in enumerate(ends)]

    def highest(self, sign: int) -> float:
        """Return the supremum of ``sign * e``."""
        k = int(np.argmax(sign * self.error))
        best = max(float(sign * self.error[k]), sign * self.end)
        if not 0 < k < len(self.time) - 1:
            return best
        found = minimize_scalar(
            lambda t: -sign * self.at(t),
            bounds=(self.time[k - 1], self.time[k + 1]),
            method="bounded",
            options={"xatol": 1e-6 * (self.time[k + 1] - self.time[k - 1])},
        )
        return max(best, -float(found.fun))

    def last_outside(self, level: arb) -> float | None:
        """Return the last instant with ``|e| > level``: 0 if never, None if it stays so."""
        if abs(self.end) > float(level):
            return None
        outside = np.flatnonzero(np.abs(self.error) > float(level))
        if not outside.size:
            return 0.0
        k = int(outside[-1])
        assert k < len(self.time) - 1, "the integration ends too early"
        return self._root(k, float(level) * float(np.sign(self.error[k])))

    def first_above(self, sign: int, level: arb) -> float | None:
        """Return the first instant with ``sign * e > level``, or None."""
        above = np.flatnonzero(sign * self.error > float(level))
        if not above.size:
            return None
        return 0.0 if above[0] == 0 else self._root(int(above[0]) - 1, sign * float(level))

    def _root(self, k: int, level: float) -> float:
        a, b = self.time[k], self.time[k + 1]
        return float(brentq(lambda t: self.at(t) - level, a, b, xtol=1e-13 * b, rtol=1e-13))
