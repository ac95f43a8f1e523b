"""Crossings and peaks of an exact transient, found by root finding on the solution itself.

The grid resolves the modes that have not decayed (25 points on the period of the fastest). A peak
between two points of the grid is lower than the point where their tangents meet, which shows every
peak that may exceed a level; crossings and peaks are then refined on the continuous solution.
"""

from __future__ import annotations

import math
import sys
from collections.abc import Callable

import numpy as np

from spice_models.array_types import Floats, Indices
from spice_models.errors import EngineError
from verification.engines.statespace.transients.exact import Exact
from verification.measures.crossings import Crossings
from verification.small_signal.time_scales import UNRESOLVED

FINENESS = 0.25  # step times |p| of the fastest mode that has not decayed: 25 points a period
BLOCK = 2000  # points with the same step
MAX_POINTS = 2_000_000
ABOVE = 2.0  # times the height at which tangents meet: upper bound of a peak between points


class ExactSignal:
    """Errors of the channels ``u = sign V`` of an exact solution, a `measures.readings.Signal`.

    Parameters
    ----------
    solution : Exact
        Solution whose nodes are the channels.
    signs, target : ndarray (N,)
        Signs of the channels, and their reference steady state, V.
    detail : float
        Smallest amplitude of a mode that the grid resolves, V.
    horizon : float
        Latest instant of interest, s.
    """

    def __init__(
        self, solution: Exact, signs: Floats, target: Floats, detail: float, horizon: float
    ) -> None:
        self.solution, self.signs, self.target = solution, signs, target
        self.ends: Floats = solution.final * signs - target
        self.weight = np.abs(solution.share).max(axis=1)
        if solution.form != "modes":
            step = float(np.abs(solution.final - solution.start).max(initial=detail))
            self.weight = np.full(len(solution.poles), UNRESOLVED * step)
        self.time = self._grid(detail, horizon)
        self.errors: Floats = solution.at(self.time) * signs - target
        self.slopes: Floats = solution.derivative(self.time) * signs

    def _grid(self, detail: float, horizon: float) -> Floats:
        poles, times, t, count = self.solution.poles, [], 0.0, 0
        log_weight = np.log(np.maximum(self.weight, 1e-300))
        while t < horizon:
            active = log_weight + poles.real * t > math.log(detail)
            rate = float(np.abs(poles[active]).max(initial=0.0))
            step = min(FINENESS / rate, horizon / 50) if rate > 0.0 else horizon / 50
            # The step is chosen anew for every block, because the fast modes decay.
            points = min(BLOCK, math.ceil((horizon - t) / step))
            times.append(t + step * np.arange(points))
            t, count = t + step * points, count + points
            if count > MAX_POINTS:
                message = f"{MAX_POINTS} points reach {t:.3g} s of {horizon:.3g} s: the time \
scales are too far apart for a measurement"
                raise EngineError(message)
        return np.concatenate([*times, [max(t, horizon)]])

    def last_outside(self, levels: Floats) -> Crossings:
        """See `Signal`."""
        channels = np.arange(len(self.target))
        above, below = (
            [[self._last(n, sign, level) for n in channels.tolist()] for level in levels.tolist()]
            for sign in (1.0, -1.0)
        )
        return self._crossings(np.fmax(above, below), channels)

    def first_reached(self, rows: Indices, steps: Floats, levels: Floats) -> Crossings:
        """See `Signal`."""
        sides = list(zip(rows.tolist(), np.sign(steps), np.abs(steps), strict=True))
        at = [
            [self._first(n, up, (level - 1.0) * size) for n, up, size in sides] for level in levels
        ]
        return self._crossings(np.array(at), rows)

    def highest(self, sign: float) -> Floats:
        """See `Signal`."""
        heights = []
        for n in range(len(self.target)):
            top = float(max((sign * self.errors[:, n]).max(), sign * self.ends[n]))
            peaks = self._peaks(n, sign, 0, len(self.time) - 1, top)
            heights.append(max([top, *(height for _, height in peaks)]))
        return np.array(heights)

    def _crossings(self, at: Floats, channels: Indices) -> Crossings:
        """Return crossings of `channels` with the shift that the rounding error may cause."""
        flat, column = np.nan_to_num(at).ravel(), np.tile(channels, len(at))
        slope = np.abs(self.solution.derivative(flat)[np.arange(flat.size), column])
        with np.errstate(divide="ignore", invalid="ignore"):
            moved = np.where(slope > 0.0, self.solution.error / slope, 0.0)
        return Crossings(at, np.maximum(moved, np.spacing(flat)).reshape(at.shape))

    def _error(self, n: int, t: float) -> float:
        return float(self.solution.at(np.array([t]))[0, n] * self.signs[n] - self.target[n])

    def _slope(self, n: int, t: float) -> float:
        return float(self.solution.derivative(np.array([t]))[0, n] * self.signs[n])

    def _root(self, n: int, level: float, low: float, high: float) -> float:
        """Return the instant at which the error of channel `n` crosses `level`, s."""
        return _root(lambda t: self._error(n, t) - level, low, high)

    def _peaks(
        self, n: int, sign: float, first: int, last: int, level: float
    ) -> list[tuple[float, float]]:
        """Return peaks ``(instant, height)`` of ``sign * error`` between two points of the grid.

        Peaks that cannot be higher than `level` are omitted.
        """
        time, stretch = self.time[first : last + 1], slice(first, last + 1)
        slope, y = sign * self.slopes[stretch, n], sign * self.errors[stretch, n]
        tops = np.flatnonzero((slope[:-1] > 0.0) & (slope[1:] <= 0.0))
        width, rise, fall = time[tops + 1] - time[tops], slope[tops], slope[tops + 1]
        meet = np.clip((y[tops + 1] - y[tops] - fall * width) / (rise - fall), 0.0, width)
        higher = np.maximum(y[tops], y[tops + 1])
        tops = tops[higher + ABOVE * (y[tops] + rise * meet - higher) > level]
        ends = zip(time[tops].tolist(), time[tops + 1].tolist(), strict=True)
        at = [_root(lambda t: self._slope(n, t), low, high) for low, high in ends]
        return [(t, sign * self._error(n, t)) for t in at]

    def _first(self, n: int, sign: float, level: float) -> float:
        """Return the first instant at which ``sign * error`` rises through `level`, s, or NaN."""
        y = sign * self.errors[:, n]
        above = np.flatnonzero(y > level)
        last = int(above[0]) if above.size else len(y) - 1
        for t, height in self._peaks(n, sign, 0, last, level):
            if height > level:
                k = int(np.searchsorted(self.time, t)) - 1
                return self._root(n, sign * level, float(self.time[k]), t)
        if not above.size:
            return math.nan
        if last == 0:
            return 0.0
        return self._root(n, sign * level, float(self.time[last - 1]), float(self.time[last]))

    def _last(self, n: int, sign: float, level: float) -> float:
        """Return the last instant at which ``sign * error`` falls through `level`, s, or NaN."""
        y = sign * self.errors[:, n]
        above = np.flatnonzero(y > level)
        last = int(above[-1]) if above.size else 0
        peaks = self._peaks(n, sign, last, len(y) - 1, level)
        higher = [t for t, height in peaks if height > level]
        if higher:
            k = int(np.searchsorted(self.time, higher[-1]))
            return self._root(n, sign * level, higher[-1], float(self.time[k]))
        if not above.size:
            return math.nan
        if last == len(y) - 1:
            return float(self.time[-1])
        return self._root(n, sign * level, float(self.time[last]), float(self.time[last + 1]))


def _root(f: Callable[[float], float], low: float, high: float) -> float:
    """Return the point at which `f` changes sign, or the nearer end if rounding hides it."""
    from scipy.optimize import brentq

    ends = f(low), f(high)
    if ends[0] * ends[1] >= 0.0:
        return low if abs(ends[0]) <= abs(ends[1]) else high
    precision = 4.0 * sys.float_info.epsilon
    return float(brentq(f, low, high, xtol=float(np.spacing(high)), rtol=precision, maxiter=500))
