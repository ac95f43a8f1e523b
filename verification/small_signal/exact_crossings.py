"""Crossings and peaks of an exact transient, found by root finding on the solution itself.

A grid follows the modes that are still alive (24 points on the period of the fastest), so no
excursion between its points is higher than a hundredth of what its neighbours show; crossings and
peaks are then refined on the continuous solution with its derivative.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

import numpy as np

from spice_models.array_types import Floats
from spice_models.errors import EngineError
from verification.engines.statespace.transients.exact import Exact
from verification.small_signal.time_scales import UNRESOLVED

FINENESS = 0.25  # step times |p| of the fastest mode alive: 25 points a period
ALIVE = 1e-4  # of the finest detail asked for: a mode below is not followed
BLOCK = 2000  # points with one step
MAX_POINTS = 2_000_000
NEAR = 0.04  # of a level: a peak between points that comes so close to it is looked at
ROOT_STEPS = 60


@dataclass(frozen=True, slots=True, eq=False)
class Continuous:
    """The channels ``u = sign V`` of an exact solution on a grid, with refinement.

    Attributes
    ----------
    solution : Exact
        Its nodes are the channels.
    signs : ndarray (N,)
        Of the channels.
    time : ndarray (P,)
        The grid, s.
    u, slope : ndarray (P, N)
        The channels there, and their time derivatives, V and V/s.
    """

    solution: Exact
    signs: Floats
    time: Floats
    u: Floats
    slope: Floats

    @classmethod
    def of(cls, solution: Exact, signs: Floats, detail: float, horizon: float) -> Continuous:
        """Make a grid up to `horizon`, s, fine enough for anything larger than `detail`, V.

        Raises
        ------
        EngineError
            The time scales are too far apart for a grid.
        """
        time = _grid(solution, detail, horizon)
        u, slope = solution.at(time) * signs, solution.derivative(time) * signs
        return cls(solution, signs, time, u, slope)

    def mirrored(self) -> Continuous:
        """Return the same channels with the other sign, sharing the grid."""
        return replace(self, signs=-self.signs, u=-self.u, slope=-self.slope)

    def values(self, channel: int, times: Floats) -> tuple[Floats, Floats]:
        """One channel and its derivative at `times`, (P,) each."""
        sign = self.signs[channel]
        return (
            sign * self.solution.at(times)[:, channel],
            sign * self.solution.derivative(times)[:, channel],
        )

    def root(self, channel: int, level: float, low: float, high: float) -> float:
        """Return where the channel crosses `level` between two instants on both sides of it."""
        begin = float(self.values(channel, np.array([low]))[0][0]) - level
        t = 0.5 * (low + high)
        for _ in range(ROOT_STEPS):
            value, slope = (float(x[0]) for x in self.values(channel, np.array([t])))
            excess = value - level
            if excess == 0.0:
                return t
            low, high = (t, high) if (excess > 0.0) == (begin > 0.0) else (low, t)
            newton = t - excess / slope if slope != 0.0 else math.inf
            following = newton if low < newton < high else 0.5 * (low + high)
            if abs(following - t) <= 1e-15 * abs(t) or high - low <= 4e-16 * abs(t):
                return following
            t = following
        return t

    def peaks(self, channel: int, first: int, last: int, level: float) -> list[tuple[float, float]]:
        """Peaks ``(instant, height)`` above `level` between two points of the grid."""
        slope, u = self.slope[first : last + 1, channel], self.u[first : last + 1, channel]
        tops = np.flatnonzero((slope[:-1] > 0.0) & (slope[1:] <= 0.0))
        tops = tops[np.maximum(u[tops], u[tops + 1]) > level]
        return [self._peak(channel, first + int(k)) for k in tops]

    def _peak(self, channel: int, k: int) -> tuple[float, float]:
        """Refine a peak between grid points k and k + 1: where the derivative vanishes."""
        low, high = float(self.time[k]), float(self.time[k + 1])
        for _ in range(ROOT_STEPS):
            instants = np.linspace(low, high, 9)
            rising = np.flatnonzero(self.values(channel, instants)[1] > 0.0)
            j = int(rising[-1]) if rising.size else 0
            low, high = float(instants[j]), float(instants[min(j + 1, 8)])
            if high - low <= 1e-7 * (self.time[k + 1] - self.time[k]):
                break
        top = 0.5 * (low + high)
        return top, float(self.values(channel, np.array([top]))[0][0])

    def first_above(self, channel: int, level: float) -> float | None:
        """Return the first instant at which a channel rises through `level`, s."""
        u = self.u[:, channel]
        above = np.flatnonzero(u > level)
        last = int(above[0]) if above.size else len(u) - 1
        margin = NEAR * float(np.abs(u[: last + 1] - level).max(initial=0.0))
        for t, height in self.peaks(channel, 0, last, level - margin):
            if height > level:
                k = int(np.searchsorted(self.time, t)) - 1
                return self.root(channel, level, float(self.time[k]), t)
        if not above.size:
            return None
        if last == 0:
            return 0.0
        return self.root(channel, level, float(self.time[last - 1]), float(self.time[last]))

    def last_above(self, channel: int, level: float) -> float | None:
        """Return the last instant at which a channel falls through `level`; None if never above."""
        u = self.u[:, channel]
        above = np.flatnonzero(u > level)
        last = int(above[-1]) if above.size else 0
        margin = NEAR * abs(level - self.solution.final[channel] * self.signs[channel])
        tops = [p for p in self.peaks(channel, last, len(u) - 1, level - margin) if p[1] > level]
        if tops:
            t = tops[-1][0]
            k = int(np.searchsorted(self.time, t))
            return self.root(channel, level, t, float(self.time[k]))
        if not above.size:
            return None
        if last == len(u) - 1:
            return float(self.time[-1])
        return self.root(channel, level, float(self.time[last]), float(self.time[last + 1]))

    def highest(self, channel: int) -> float:
        """Return a channel's maximum."""
        u = self.u[:, channel]
        k = int(np.argmax(u))
        around = self.peaks(channel, max(k - 1, 0), min(k + 1, len(u) - 1), -math.inf)
        return max([float(u[k]), *(height for _, height in around)])


def _grid(solution: Exact, detail: float, horizon: float) -> Floats:
    weight = np.abs(solution.share).max(axis=1)
    if solution.form != "modes":
        step = float(np.abs(solution.final - solution.start).max(initial=detail))
        weight = np.full(len(solution.poles), UNRESOLVED * step)
    poles, times, t, count = solution.poles, [], 0.0, 0
    log_weight = np.log(np.maximum(weight, 1e-300))
    while t < horizon:
        alive = log_weight + poles.real * t > math.log(ALIVE * detail)
        rate = float(np.abs(poles[alive]).max(initial=0.0))
        step = min(FINENESS / rate, horizon / 50) if rate > 0.0 else horizon / 50
        # While fast modes die the step follows them after every block.
        points = min(BLOCK, math.ceil((horizon - t) / step))
        times.append(t + step * np.arange(points))
        t, count = t + step * points, count + points
        if count > MAX_POINTS:
            message = f"{MAX_POINTS} points reach {t:.3g} s of {horizon:.3g} s: the time \
scales are too far apart to be measured"
            raise EngineError(message)
    return np.concatenate([*times, [max(t, horizon)]])
