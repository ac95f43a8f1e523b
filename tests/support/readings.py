"""The oracle of readings: their definition on any signal, and the signal of samples.

A signal is a channel's error ``e = u - target``: a sum of modes (`exact_readings.Signal`), or
samples with a function between them (`Samples`). Nothing here is of taction.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Protocol

import numpy as np
from flint import arb
from scipy.optimize import brentq, minimize_scalar

SMALL_STEP = 0.05  # of A, the step amplitude
STILL = 1e-6  # of A: a smaller step has no direction; both sides of it count as undershoot
Floats = np.ndarray
Level = arb | float


class AnySignal(Protocol):
    """A channel's ``e = u - target``."""

    def highest(self, sign: int) -> Level:
        """Return the supremum of ``sign * e``."""

    def last_outside(self, level: Level) -> Level | None:
        """Return the last instant with ``|e| > level``: 0 if never; None if it stays so."""

    def first_above(self, sign: int, level: Level) -> Level | None:
        """Return the first instant with ``sign * e > level``."""


def read(signal: AnySignal, step: Level, amplitude: Level, band: Level) -> dict[str, float]:
    """Return the readings of a channel that steps by `step`; `amplitude` is A, `band` in V.

    A small step overshoots on either side of start and target. The sign of a step of at most
    `STILL` decides nothing.
    """
    sign, small = (-1 if bool(step < 0) else 1), bool(abs(step) < SMALL_STEP * amplitude)
    beyond = arb(signal.highest(sign)) / amplitude
    behind = (arb(signal.highest(-sign)) - abs(step)) / amplitude
    over = max(0.0, float(beyond), float(behind) if small else 0.0)
    under = over if bool(abs(step) <= STILL * amplitude) else max(0.0, float(behind))
    found = {
        "settling_time": signal.last_outside(band),
        "rise_time": None if small else rise_time(signal, step),
        "overshoot": over,
        "undershoot": under,
    }
    return {name: float(value) for name, value in found.items() if value is not None}


def rise_time(signal: AnySignal, step: Level) -> Level | None:
    """Return the time from 10 % of the step to 90 %, first crossings; None without them."""
    sign = -1 if bool(step < 0) else 1
    low, high = (signal.first_above(sign, (arb(k) / 10 - 1) * abs(step)) for k in (1, 9))
    return None if low is None or high is None else high - low


@dataclass(frozen=True, eq=False)
class Samples:
    """A channel's error ``e = u - target`` on a dense grid (P,), and as a function of time."""

    time: Floats
    error: Floats
    at: Callable[[float], float]
    end: float  # at the equilibrium

    @classmethod
    def of_record(cls, time: Floats, u: Floats, target: float) -> Samples:
        """Return the samples of a record (P,), straight between its points."""
        error = np.asarray(u - target)
        return cls(time, error, lambda t: float(np.interp(t, time, error)), float(error[-1]))

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

    def last_outside(self, level: Level) -> float | None:
        """Return the last instant with ``|e| > level``: 0 if never, None if it stays so."""
        if abs(self.end) > float(level):
            return None
        outside = np.flatnonzero(np.abs(self.error) > float(level))
        if not outside.size:
            return 0.0
        k = int(outside[-1])
        assert k < len(self.time) - 1, "the record ends too early"
        return self._root(k, float(level) * float(np.sign(self.error[k])))

    def first_above(self, sign: int, level: Level) -> float | None:
        """Return the first instant with ``sign * e > level``, or None."""
        above = np.flatnonzero(sign * self.error > float(level))
        if not above.size:
            return None
        return 0.0 if above[0] == 0 else self._root(int(above[0]) - 1, sign * float(level))

    def _root(self, k: int, level: float) -> float:
        a, b = self.time[k], self.time[k + 1]
        ends = [(abs(self.at(t) - level), t) for t in (a, b)]
        if (self.at(a) > level) == (self.at(b) > level):  # rounding has the sign of the samples
            return float(min(ends)[1])
        return float(brentq(lambda t: self.at(t) - level, a, b, xtol=1e-13 * b, rtol=1e-13))
