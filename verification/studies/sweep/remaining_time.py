"""Remaining time of a sweep: the forecast of the points that are left, calibrated by the others."""

from __future__ import annotations

import time
from collections import deque
from collections.abc import Callable, Mapping

import numpy as np

from taction.system.array_types import Bools
from taction.verification.studies.sweep.cost_forecast import CostForecast

INTERVAL = 0.2  # s between two estimates


class RemainingTime:
    """Follows the points of a sweep and estimates the time until all of them are computed.

    The processes take the points in the order in which the sweep submits them. A point that is done
    calibrates the forecast of its engine by the time that it took; a point that began before any
    other was done does not, since the processes start in that time.

    Parameters
    ----------
    forecast : CostForecast
        Estimated processor time of every point.
    left : mapping of str to ndarray (P,)
        The points to compute, by engine.
    processes : callable
        Number of processes at work.
    clock : callable, optional
        Returns the time, s.
    """

    def __init__(
        self,
        forecast: CostForecast,
        left: Mapping[str, Bools],
        processes: Callable[[], int],
        clock: Callable[[], float] = time.monotonic,
    ) -> None:
        self._forecast, self._processes, self._clock = forecast, processes, clock
        self._left = {engine: np.array(places) for engine, places in left.items()}
        self._waiting: deque[tuple[str, int]] = deque()
        self._running: dict[tuple[str, int], tuple[float, bool]] = {}  # start; if it calibrates
        self._taken = dict.fromkeys(left, 0.0)
        self._expected = dict.fromkeys(left, 0.0)
        self._warm = False
        self._last = (-INTERVAL, 0.0)

    def replace(self, engine: str, left: Bools) -> None:
        """Set the points that are left for `engine`, (P,)."""
        self._left[engine] = np.array(left)

    def submit(self, engine: str, place: int) -> None:
        """Count a point that waits for a process."""
        self._waiting.append((engine, place))
        self._begin()

    def finish(self, engine: str, place: int) -> None:
        """Count a point that is done, or that needs no computation."""
        self._left[engine][place] = False
        if (engine, place) in self._waiting:
            self._waiting.remove((engine, place))
        elif (engine, place) in self._running:
            start, calibrates = self._running.pop((engine, place))
            if calibrates:
                self._taken[engine] += self._clock() - start
                self._expected[engine] += float(self._forecast.seconds[engine][place])
            self._warm = True
            self._begin()

    def seconds(self) -> float:
        """Return the remaining time, s."""
        now = self._clock()
        then, seconds = self._last
        if now - then < INTERVAL:
            return max(seconds - (now - then), 0.0)
        total, longest = 0.0, 0.0
        for engine, left in self._left.items():
            rest = self._ratio(engine) * self._forecast.seconds[engine] * left
            for (other, place), (start, _) in self._running.items():
                if other == engine:
                    rest[place] = max(rest[place] - (now - start), 0.0)
            total, longest = total + float(rest.sum()), max(longest, float(rest.max(initial=0.0)))
        seconds = max(total / max(self._processes(), 1), longest)
        self._last = (now, seconds)
        return seconds

    def _begin(self) -> None:
        """Give waiting points to free processes."""
        while self._waiting and len(self._running) < max(self._processes(), 1):
            self._running[self._waiting.popleft()] = (self._clock(), self._warm)

    def _ratio(self, engine: str) -> float:
        """Return wall time over forecast, of `engine` if it has results, else of all engines."""
        expected, taken = self._expected[engine], self._taken[engine]
        if not expected:
            expected, taken = sum(self._expected.values()), sum(self._taken.values())
        return taken / expected if expected else self._forecast.slowness
