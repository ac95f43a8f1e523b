"""Settling and rise times of a continuous solution, by root finding."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from taction.system.array_types import Floats, Indices
from taction.system.reading_definitions import RISE_LEVELS, SETTLING_BAND, SMALL_STEP

SECTIONS, ROUNDS = 64, 9  # 64^9 is 2^54: an interval is divided down to its rounding


@dataclass(frozen=True, slots=True, eq=False)
class Response:
    """Outputs of the ideal network as a function of time."""

    time: Floats  # s, increasing from 0, dense enough for at most one crossing in an interval
    outputs: Callable[[Floats], Floats]  # ``t (K,) -> u (K, N)``, V, for t within `time`
    start: Floats  # outputs at time 0 (N,), V
    target: Floats  # outputs at rest (N,), V

    @property
    def amplitude(self) -> float:
        """Step amplitude ``max |u(inf) - u(0)|``, V."""
        return float(np.max(np.abs(self.target - self.start)))

    def settling_time(self, band: float = SETTLING_BAND) -> float:
        """Return the last instant at which any channel is outside the band around its target.

        Parameters
        ----------
        band : float
            Half-width over the step amplitude.

        Returns
        -------
        float
            s; 0 if no channel moves; infinite if the record ends outside the band.
        """
        limit = band * self.amplitude
        outside = np.max(np.abs(self.outputs(self.time) - self.target), axis=1) > limit
        if limit == 0.0 or not outside.any():
            return 0.0
        last = int(np.flatnonzero(outside)[-1])
        if last == len(self.time) - 1:
            return float("inf")

        def excess(t: Floats) -> Floats:
            return np.asarray(limit - np.max(np.abs(self.outputs(t) - self.target), axis=1))

        return _root(excess, float(self.time[last]), float(self.time[last + 1]))

    def rise_times(self, *channels: int) -> Floats:
        """Return the time from 10 to 90 % of a channel's own step, first crossings.

        Parameters
        ----------
        *channels : int
            From 0; without them every channel.

        Returns
        -------
        ndarray (K,)
            One time for each of the K channels, s; not a number where the step is under 5 % of the
            step amplitude or the record ends before 90 %.
        """
        low, high = RISE_LEVELS
        asked: Indices = np.array(channels or range(len(self.target)), dtype=np.intp)
        return (self._crossings(high, asked) - self._crossings(low, asked))[asked]

    def _crossings(self, level: float, asked: Indices) -> Floats:
        step = self.target - self.start
        moving = asked[np.abs(step[asked]) >= SMALL_STEP * self.amplitude]
        times = np.full(len(step), np.nan)
        if self.amplitude == 0.0:
            return times
        progress = (self.outputs(self.time)[:, moving] - self.start[moving]) / step[moving]
        above = progress >= level
        for column, n in enumerate(moving.tolist()):
            if not above[:, column].any():
                continue
            first = int(np.argmax(above[:, column]))

            def height(t: Floats, n: int = n) -> Floats:
                return np.asarray((self.outputs(t)[:, n] - self.start[n]) / step[n] - level)

            times[n] = _root(height, float(self.time[max(first - 1, 0)]), float(self.time[first]))
        return times


def _root(f: Callable[[Floats], Floats], low: float, high: float) -> float:
    """Return the first instant in the interval from which `f` is not negative; else `high`.

    Every round evaluates `SECTIONS` instants at once. The import of `scipy.optimize` for its
    `brentq` takes 0.15 s, a fifth of the command `taction verify`.
    """
    for _ in range(ROUNDS):
        times = np.linspace(low, high, SECTIONS + 1)
        reached = f(times) >= 0.0
        k = int(np.argmax(reached)) if reached.any() else SECTIONS
        if k == 0:
            return low
        low, high = float(times[k - 1]), float(times[k])
    return high
