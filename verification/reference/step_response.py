"""Settling and rise times of a continuous solution, by root finding."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from spice_models.array_types import Floats
from spice_models.definitions import RISE_LEVELS, SETTLING_BAND, SMALL_STEP

EPS = float(np.finfo(np.float64).eps)


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

        def excess(t: float) -> float:
            return float(np.max(np.abs(self.outputs(np.array([t]))[0] - self.target))) - limit

        return _root(excess, float(self.time[last]), float(self.time[last + 1]))

    def rise_times(self) -> Floats:
        """Return every channel's time from 10 to 90 % of its own step, first crossings.

        Returns
        -------
        ndarray (N,)
            s; not a number where the step is under 5 % of the step amplitude or the record ends
            before 90 %.
        """
        low, high = RISE_LEVELS
        return self._crossings(high) - self._crossings(low)

    def _crossings(self, level: float) -> Floats:
        step = self.target - self.start
        moving = np.flatnonzero(np.abs(step) >= SMALL_STEP * self.amplitude)
        times = np.full(len(step), np.nan)
        if self.amplitude == 0.0:
            return times
        progress = (self.outputs(self.time)[:, moving] - self.start[moving]) / step[moving]
        above = progress >= level
        for column, n in enumerate(moving.tolist()):
            if not above[:, column].any():
                continue
            first = int(np.argmax(above[:, column]))

            def height(t: float, n: int = n) -> float:
                u = float(self.outputs(np.array([t]))[0, n])
                return float((u - self.start[n]) / step[n]) - level

            times[n] = _root(height, float(self.time[max(first - 1, 0)]), float(self.time[first]))
        return times


def _root(f: Callable[[float], float], low: float, high: float) -> float:
    """Return the zero of `f` in the interval; `high` if rounding hides the change of sign."""
    from scipy.optimize import brentq

    if low == high or f(low) * f(high) >= 0.0:
        return high
    return float(brentq(f, low, high, xtol=float(np.spacing(high)), rtol=4.0 * EPS, maxiter=500))
