"""Crossings and peaks of an exact transient, found by root finding on the solution itself.

The grid resolves the modes that have not decayed (25 points on the period of the fastest). A peak
between two points of the grid is lower than the point where their tangents meet, which shows every
peak that may exceed a level; crossings and peaks are then refined on the continuous solution.
"""

from __future__ import annotations

import math
from collections.abc import Callable

import numpy as np

from spice_models.array_types import Floats, Indices
from spice_models.errors import EngineError
from verification.engines.statespace.transients.exact import Exact
from verification.measures.crossings import Crossings
from verification.small_signal.time_scales import UNRESOLVED

FINENESS = 0.25  # step times |p| of the fastest mode that has not decayed: 25 points a period
BLOCK = 25  # points with the same step
MAX_POINTS = 2_000_000
ABOVE = 2.0  # times the height at which tangents meet: upper bound of a peak between points
MOST_STEPS = 60  # of a root search, each of which halves the bracket at least
CLOSE = 4.0 * float(np.finfo(np.float64).eps)  # relative: a root search ends there


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
        self.errors = self._errors(self.time)
        self.slopes: Floats = (solution.derivative(self.time) * signs).T

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
        rows, signs = np.tile(channels, 2), np.repeat([1.0, -1.0], channels.size)
        at = self._crossings(rows, signs, np.repeat(levels[:, None], rows.size, axis=1), last=True)
        return self._uncertain(np.fmax(*np.split(at, 2, axis=1)), channels)

    def first_reached(self, rows: Indices, steps: Floats, levels: Floats) -> Crossings:
        """See `Signal`."""
        heights = np.multiply.outer(levels - 1.0, np.abs(steps))
        return self._uncertain(self._crossings(rows, np.sign(steps), heights, last=False), rows)

    def highest(self, sign: Floats) -> Floats:
        """See `Signal`; the final values count as well."""
        rows = np.arange(len(sign))
        top = np.maximum((sign[:, None] * self.errors).max(axis=1), sign * self.ends)
        column, point, _, bound = self._tops(rows, sign)
        higher = bound > top[column]
        column = column[higher]
        at = self._extremes(column, point[higher])
        np.maximum.at(top, column, sign[column] * self._errors(at)[column, np.arange(len(at))])
        return top

    def _errors(self, times: Floats) -> Floats:
        """Return the errors of all channels, (N, P)."""
        return np.ascontiguousarray((self.solution.at(times) * self.signs - self.target).T)

    def _crossings(self, rows: Indices, signs: Floats, levels: Floats, *, last: bool) -> Floats:
        """Return when ``signs * errors[rows]`` (C,) is above `levels` (J, C) last or first, (J, C).

        NaN for a level that is never exceeded.
        """
        time, errors = self._with_peaks(rows, signs, levels)
        end, edge = (time.size - 1, 1) if last else (0, -1)
        at, point = np.empty(levels.shape), np.empty(levels.shape, dtype=np.intp)
        for each, k, level in zip(at, point, levels, strict=True):
            above = signs[:, None] * errors[rows] > level[:, None]
            k[:] = end - above[:, ::-1].argmax(axis=1) if last else above.argmax(axis=1)
            each[:] = np.where(above.any(axis=1), time[k], np.nan)
        inside = np.nonzero(~np.isnan(at) & (point != end))
        k, column = point[inside], inside[1]
        level, channel = (signs * levels)[inside], rows[column]
        at[inside] = _roots(
            lambda t: self._errors(t)[channel, np.arange(len(t))] - level, time[k], time[k + edge]
        )
        return at

    def _with_peaks(
        self, rows: Indices, signs: Floats, levels: Floats
    ) -> tuple[Floats, Floats]:
        """Return the grid and its errors, with the peaks that exceed a level between its points."""
        column, point, top, bound = self._tops(rows, signs)
        hidden = ((top <= levels[:, column]) & (bound > levels[:, column])).any(axis=0)
        if not hidden.any():
            return self.time, self.errors
        at = self._extremes(rows[column[hidden]], point[hidden])
        time = np.concatenate([self.time, at])
        order = np.argsort(time, kind="stable")
        return time[order], np.concatenate([self.errors, self._errors(at)], axis=1)[:, order]

    def _tops(self, rows: Indices, signs: Floats) -> tuple[Indices, Indices, Floats, Floats]:
        """Find the peaks of ``signs * errors[rows]`` (C,) between points of the grid, (M,) each.

        Return column, point before the peak, the higher of the two points, and an upper bound of
        the peak.
        """
        slope = signs[:, None] * self.slopes[rows]
        column, k = np.nonzero((slope[:, :-1] > 0.0) & (slope[:, 1:] <= 0.0))
        width, rise, fall = self.time[k + 1] - self.time[k], slope[column, k], slope[column, k + 1]
        row, sign = rows[column], signs[column]
        left, right = sign * self.errors[row, k], sign * self.errors[row, k + 1]
        meet = np.clip((right - left - fall * width) / (rise - fall), 0.0, width)
        top = np.maximum(left, right)
        return column, k, top, top + ABOVE * (left + rise * meet - top)

    def _extremes(self, channel: Indices, point: Indices) -> Floats:
        """Return the instants after grid points at which the slopes of channels vanish, s."""
        return _roots(
            lambda t: self.solution.derivative(t)[np.arange(len(t)), channel],
            self.time[point],
            self.time[point + 1],
        )

    def _uncertain(self, at: Floats, channels: Indices) -> Crossings:
        """Return crossings of `channels` with the shift that the rounding error may cause."""
        flat, column = np.nan_to_num(at).ravel(), np.tile(channels, len(at))
        slope = np.abs(self.solution.derivative(flat)[np.arange(flat.size), column])
        with np.errstate(divide="ignore", invalid="ignore"):
            moved = np.where(slope > 0.0, self.solution.error / slope, 0.0)
        return Crossings(at, np.maximum(moved, np.spacing(flat)).reshape(at.shape))


def _roots(f: Callable[[Floats], Floats], low: Floats, high: Floats) -> Floats:
    """Return the points (Q,) at which the values of `f` change sign, by Ridders' method.

    Where rounding hides a change between `low` and `high`, the end with the smaller value.
    """
    at_low, at_high = f(low), f(high)
    hidden = at_low * at_high >= 0.0
    nearer = np.where(np.abs(at_low) <= np.abs(at_high), low, high)
    root = nearer
    for _ in range(MOST_STEPS):
        middle = 0.5 * (low + high)
        at_middle = f(middle)
        curved = np.sqrt(np.maximum(at_middle**2 - at_low * at_high, 0.0))
        with np.errstate(divide="ignore", invalid="ignore"):
            share = np.where(curved > 0.0, at_middle / curved, 0.0)
        before, root = root, middle + (middle - low) * np.sign(at_low - at_high) * share
        if np.all(hidden | (np.abs(root - before) <= CLOSE * np.abs(root))):
            break
        at_root = f(root)
        left, right = at_low * at_root < 0.0, at_middle * at_root < 0.0
        low, at_low = (
            np.where(right, middle, np.where(left, low, high)),
            np.where(right, at_middle, np.where(left, at_low, at_high)),
        )
        high, at_high = root, at_root
    return np.where(hidden, nearer, root)
