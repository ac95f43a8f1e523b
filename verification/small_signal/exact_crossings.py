"""Crossings and peaks of an exact transient, found by root finding on the solution itself.

A grid resolves the modes that have not decayed (25 points on the period of the fastest). A peak
between two points of the grid is lower than the point where their tangents meet, which shows every
peak that may exceed a level; crossings and peaks are then refined on the continuous solution, those
of all channels and levels at once. The solution is evaluated stretch by stretch, and only where the
sum of the modes can reach a level, so that ringing of a million periods needs little memory.
"""

from __future__ import annotations

import math
from bisect import bisect_left
from collections.abc import Callable
from dataclasses import dataclass
from functools import lru_cache

import numpy as np

from spice_models.array_types import Floats, Indices
from spice_models.errors import EngineError
from verification.engines.statespace.transients.exact import Exact
from verification.measures.crossings import Crossings
from verification.small_signal.time_scales import UNRESOLVED

FINENESS = 0.25  # step times |p| of the fastest mode that has not decayed: 25 points a period
FEWEST = 50.0  # points of a grid
STRETCH = 4096  # intervals of the grid that are evaluated together
KEPT = 8  # stretches that are kept for the next search
MAX_POINTS = 2_000_000  # of a grid whose solution has no modes: all of the grid is evaluated
ABOVE = 2.0  # times the height at which tangents meet: upper bound of a peak between points
MOST_STEPS = 60  # of a root search, each of which halves the bracket at least
CLOSE = 4.0 * float(np.finfo(np.float64).eps)  # relative: a root search ends there


@dataclass(frozen=True, slots=True, eq=False)
class _Tops:
    """Peaks between points of a grid: column, point before, lower and upper bound, (M,) each."""

    column: Indices
    point: Indices
    least: Floats
    most: Floats


@dataclass(frozen=True, slots=True, eq=False)
class _Stretch:
    """A part of the grid with the errors and slopes of all channels, (N, P)."""

    time: Floats
    errors: Floats
    slopes: Floats

    def tops(self, rows: Indices, signs: Floats) -> _Tops:
        """Find the peaks of ``signs * errors[rows]`` (C,) between two points."""
        slope = signs[:, None] * self.slopes[rows]
        column, k = np.nonzero((slope[:, :-1] > 0.0) & (slope[:, 1:] <= 0.0))
        width, rise, fall = self.time[k + 1] - self.time[k], slope[column, k], slope[column, k + 1]
        row, sign = rows[column], signs[column]
        left, right = sign * self.errors[row, k], sign * self.errors[row, k + 1]
        meet = np.clip((right - left - fall * width) / (rise - fall), 0.0, width)
        top = np.maximum(left, right)
        return _Tops(column, k, top, top + ABOVE * (left + rise * meet - top))


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

    Raises
    ------
    EngineError
        The solution has no modes, and its time scales are too far apart for a grid.
    """

    def __init__(
        self, solution: Exact, signs: Floats, target: Floats, detail: float, horizon: float
    ) -> None:
        self.solution, self.signs, self.target = solution, signs, target
        self.ends: Floats = solution.final * signs - target
        self.share = np.abs(solution.share)
        if solution.form != "modes":
            step = float(np.abs(solution.final - solution.start).max(initial=detail))
            self.share = np.full(self.share.shape, UNRESOLVED * step)
        self._points, self._instants = self._grid(detail, horizon)
        total = self._points[-1]
        if solution.form != "modes" and total > MAX_POINTS:
            raise EngineError(
                f"{total:.3g} points reach {horizon:.3g} s: the time scales are too far apart for a"
                " measurement of a board with defective modes"
            )
        self._stretch = lru_cache(KEPT)(self._evaluate)

    def _grid(self, detail: float, horizon: float) -> tuple[Floats, Floats]:
        """Return numbers of grid points and their instants; the grid is even between two of them.

        Where a mode falls below `detail`, the step of the grid changes.
        """
        rate = self.solution.poles.real
        with np.errstate(divide="ignore", invalid="ignore"):
            ends = np.log(self.share.max(axis=1, initial=0.0) / detail) / -rate
        ends = np.where(rate < 0.0, np.clip(ends, 0.0, horizon), horizon)
        order = np.argsort(-ends)
        fastest = np.maximum.accumulate(np.abs(self.solution.poles[order]))
        instants = np.concatenate([[horizon], ends[order], [0.0]])[::-1]
        density = np.maximum(np.append(0.0, fastest)[::-1] / FINENESS, FEWEST / horizon)
        points = np.append(0.0, np.cumsum(np.diff(instants) * density))
        return points * (math.ceil(points[-1]) / points[-1]), instants

    @property
    def _stretches(self) -> range:
        return range(math.ceil(self._points[-1] / STRETCH))

    def _evaluate(self, number: int) -> _Stretch:
        last = min((number + 1) * STRETCH, int(self._points[-1]))
        time = np.interp(np.arange(number * STRETCH, last + 1), self._points, self._instants)
        values, slopes = self.solution.with_slope(time)
        return _Stretch(time, (values * self.signs - self.target).T, (slopes * self.signs).T)

    def _reach(self, number: int) -> Floats:
        """Bound ``|error - end|`` (N,) from the start of a stretch on, by the sum of the modes."""
        rate = self.solution.poles.real
        if np.any(rate >= 0.0):
            return np.full(self.ends.shape, np.inf)
        start = np.interp(number * STRETCH, self._points, self._instants)
        return np.asarray(np.exp(rate * start) @ self.share) + self.solution.error

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
        rows, ends = np.arange(len(sign)), sign * self.ends
        top = ends.copy()
        for number in self._stretches:
            if np.all(ends + self._reach(number) <= top):
                break
            stretch = self._stretch(number)
            np.maximum(top, (sign[:, None] * stretch.errors).max(axis=1), out=top)
            tops = stretch.tops(rows, sign)
            higher = tops.most > top[tops.column]
            column = tops.column[higher]
            at = self._extremes(stretch, column, tops.point[higher])
            np.maximum.at(top, column, sign[column] * self._errors(at)[column, np.arange(len(at))])
        return top

    def _errors(self, times: Floats) -> Floats:
        """Return the errors of all channels, (N, P)."""
        return (self.solution.at(times) * self.signs - self.target).T

    def _crossings(self, rows: Indices, signs: Floats, levels: Floats, *, last: bool) -> Floats:
        """Return when ``signs * errors[rows]`` (C,) is above `levels` (J, C) last or first, (J, C).

        NaN for a level that is never exceeded.
        """
        left = levels - signs * self.ends[rows]
        at = np.full(levels.shape, np.nan)

        def possible(number: int) -> bool:
            return bool((np.isnan(at) & (self._reach(number)[rows] > left)).any())

        numbers = self._stretches[
            : bisect_left(self._stretches, True, key=lambda k: not possible(k))
        ]
        for number in reversed(numbers) if last else numbers:
            if possible(number):
                found = self._within(self._stretch(number), rows, signs, levels, last=last)
                at = np.where(np.isnan(at), found, at)
        return at

    def _within(
        self, stretch: _Stretch, rows: Indices, signs: Floats, levels: Floats, *, last: bool
    ) -> Floats:
        """Return `_crossings` of one stretch; its edge where the signal is above there."""
        time, errors = self._with_peaks(stretch, rows, signs, levels)
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
        self, stretch: _Stretch, rows: Indices, signs: Floats, levels: Floats
    ) -> tuple[Floats, Floats]:
        """Return times and errors of a stretch, with peaks that pass a level between its points."""
        tops = stretch.tops(rows, signs)
        level = levels[:, tops.column]
        hidden = ((tops.least <= level) & (tops.most > level)).any(axis=0)
        if not hidden.any():
            return stretch.time, stretch.errors
        at = self._extremes(stretch, rows[tops.column[hidden]], tops.point[hidden])
        time = np.concatenate([stretch.time, at])
        order = np.argsort(time, kind="stable")
        return time[order], np.concatenate([stretch.errors, self._errors(at)], axis=1)[:, order]

    def _extremes(self, stretch: _Stretch, channel: Indices, point: Indices) -> Floats:
        """Return the instants after points of a stretch at which slopes of channels vanish, s."""
        return _roots(
            lambda t: self.solution.derivative(t)[np.arange(len(t)), channel],
            stretch.time[point],
            stretch.time[point + 1],
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
