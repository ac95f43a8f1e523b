"""Settling and rise times of a continuous solution, by root finding."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from spice_models.array_types import Floats

SMALL_STEP = 0.05
"""A channel whose step is below this times the network's step amplitude has no rise time."""
_BISECTIONS = 60


@dataclass(frozen=True, slots=True, eq=False)
class Response:
    """Outputs of the ideal network as a function of time.

    Attributes
    ----------
    time : ndarray (P,)
        Instants, s, increasing from 0, close enough together that no crossing hides between two.
    outputs : callable
        ``outputs(t (K,)) -> u (K, N)``, V, at any time from 0 to the last of `time`.
    start, target : ndarray (N,)
        Outputs at time 0 and at rest, V.
    """

    time: Floats
    outputs: Callable[[Floats], Floats]
    start: Floats
    target: Floats

    @property
    def amplitude(self) -> float:
        """Step amplitude ``max |u(inf) - u(0)|``, V."""
        return float(np.max(np.abs(self.target - self.start)))

    def settling_time(self, band: float = 0.01) -> float:
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
            deviation = np.abs(self.outputs(t) - self.target)
            return np.asarray(limit - np.max(deviation, axis=1))

        return float(_bisect(excess, self.time[[last]], self.time[[last + 1]])[0])

    def rise_times(self) -> Floats:
        """Return every channel's time from 10 to 90 % of its own step, first crossings.

        Returns
        -------
        ndarray (N,)
            s; not a number where the step is under 5 % of the step amplitude or the record ends
            before 90 %.
        """
        return self._crossings(0.9) - self._crossings(0.1)

    def _crossings(self, level: float) -> Floats:
        step = self.target - self.start
        moving = np.flatnonzero(np.abs(step) >= SMALL_STEP * self.amplitude)
        found = np.full(len(step), np.nan)
        if self.amplitude == 0.0:
            return found
        progress = (self.outputs(self.time)[:, moving] - self.start[moving]) / step[moving]
        above = progress >= level
        reached = above.any(axis=0)
        moving, first = moving[reached], np.argmax(above, axis=0)[reached]
        if not len(moving):
            return found

        def height(t: Floats) -> Floats:
            u = self.outputs(t)[np.arange(len(t)), moving]
            return np.asarray((u - self.start[moving]) / step[moving] - level)

        found[moving] = _bisect(height, self.time[np.maximum(first - 1, 0)], self.time[first])
        return found


def _bisect(f: Callable[[Floats], Floats], low: Floats, high: Floats) -> Floats:
    """Return the roots of f, negative at low and not negative at high, all at once."""
    for _ in range(_BISECTIONS):
        middle = 0.5 * (low + high)
        below = f(middle) < 0.0
        low, high = np.where(below, middle, low), np.where(below, high, middle)
    return high
