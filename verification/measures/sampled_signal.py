"""Sampled records as signals, and the part of a record within the physical range."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass
from functools import partial

import numpy as np

from spice_models.array_types import Bools, Floats, Indices
from verification.measures.crossings import Crossings, first_crossings, highest, last_crossings
from verification.measures.readings import Readings, Step, read

FEWEST_POINTS = 8
_FIRST_STRETCH = 1024  # points that are searched first for a rise


@dataclass(frozen=True, slots=True, eq=False)
class SampledSignal:
    """Samples of errors as a `verification.measures.readings.Signal`."""

    time: Floats  # (P,), s, P at least 8
    errors: Floats  # distances from the targets (N, P)
    bounds: Floats | None = None  # of the error of each sample (N, P), where known

    @property
    def ends(self) -> Floats:
        """Errors (N,) at the last point."""
        return np.asarray(self.errors[:, -1])

    @property
    def end_bounds(self) -> Floats:
        """Bounds (N,) at the last point."""
        return np.zeros(len(self.errors)) if self.bounds is None else self.bounds[:, -1]

    def last_outside(self, levels: Floats, shifts: Floats) -> Crossings:
        """See `Signal`."""
        return self._by_shift(levels, shifts, self._last_outside)

    def first_reached(
        self, rows: Indices, steps: Floats, levels: Floats, shifts: Floats
    ) -> Crossings:
        """See `Signal`."""
        return self._by_shift(levels, shifts, partial(self._first_reached, rows, steps))

    def _by_shift(
        self, levels: Floats, shifts: Floats, search: Callable[[Floats, float], Crossings]
    ) -> Crossings:
        """Search for each shift, and for equal levels once."""
        shifts = np.zeros(len(levels)) if self.bounds is None else shifts
        at, doubt = [np.empty(0)] * len(levels), [np.empty(0)] * len(levels)
        for shift in np.unique(shifts).tolist():
            chosen = np.flatnonzero(shifts == shift)
            few, places = np.unique(levels[chosen], return_inverse=True)
            found = search(few, shift)
            for j, place in zip(chosen.tolist(), places.tolist(), strict=True):
                at[j], doubt[j] = found.time[place], found.uncertainty[place]
        return Crossings(np.array(at), np.array(doubt))

    def _last_outside(self, levels: Floats, shift: float) -> Crossings:
        time, widest, channels = self.time, levels.max(), len(self.errors)
        rows = self.errors
        if shift and self.bounds is not None:
            rows = np.concatenate([rows, -rows]) + shift * np.tile(self.bounds, (2, 1))
        mirrored = len(rows) == channels
        # Search only from the last point clearly outside, and the four points of a cubic before.
        outside = (rows > widest) | (rows < -widest) if mirrored else rows > widest
        last = np.where(outside.any(axis=1), time.size - 1 - outside[:, ::-1].argmax(axis=1), 0)
        first = np.minimum(np.maximum(last - 4, 0), time.size - FEWEST_POINTS)
        begin = int(first.min())
        every = np.repeat(levels[:, None], len(rows), axis=1)
        at, doubt = last_crossings(
            time[begin:], rows[:, begin:], every, first - begin, mirrored=mirrored
        )
        later = np.fmax(at[:, :channels], at[:, channels:])
        doubt = np.where(later == at[:, channels:], doubt[:, channels:], doubt[:, :channels])
        return Crossings(later - time[0], doubt)

    def _first_reached(
        self, rows: Indices, steps: Floats, levels: Floats, shift: float
    ) -> Crossings:
        time, errors = self.time, self.errors[rows]
        if shift and self.bounds is not None:
            errors = errors + shift * np.sign(steps)[:, None] * self.bounds[rows]
        # Search only up to the first point clearly above, and the points that a cubic needs.
        clear, up = ((levels.max() - 1) * steps)[:, None], (steps > 0)[:, None]
        size = 0
        while size < time.size:
            size = min(max(_FIRST_STRETCH, 8 * size), time.size)
            above = (errors[:, :size] > clear) == up
            reached = above.any(axis=1)
            if reached.all():
                break
        stop = np.where(reached, np.maximum(above.argmax(axis=1) + 4, FEWEST_POINTS), time.size)
        stop = np.minimum(stop, time.size)
        head = int(stop.max())
        progress = 1 + errors[:, :head] / steps[:, None]
        return first_crossings(
            time[:head], progress, np.repeat(levels[:, None], len(rows), axis=1), stop
        )

    def highest(self, sign: float) -> tuple[Floats, Floats]:
        """See `Signal`."""
        heights, doubt = highest(self.time, self.errors, sign)
        if self.bounds is not None:
            top = (sign * self.errors).max(axis=1)
            high, low = (
                (sign * self.errors + side * self.bounds).max(axis=1) for side in (1.0, -1.0)
            )
            doubt += np.maximum(high - top, top - low)
        return heights, doubt


@dataclass(frozen=True, slots=True, eq=False)
class SoundPart:
    """The part of a record before any channel leaves its physical range."""

    signal: SampledSignal
    step: Step
    final: Floats  # last values (N,)
    lost: Bools  # channels that left their physical range (N,)
    cut: str  # why the record cannot prove that a channel settled; empty for a whole record

    @property
    def readable(self) -> bool:
        """Whether the points are enough to read a time."""
        return self.signal.time.size >= FEWEST_POINTS

    def scale(self) -> float:
        """Return the step amplitude; without a step the largest excursion of any channel."""
        return self.step.amplitude or float(np.abs(self.signal.errors).max())

    def read(self, band: float) -> Readings:
        """Read the record; without a step the band is in % of the largest excursion."""
        if not self.readable:
            nothing, zero = (None,) * len(self.final), (0.0,) * len(self.final)
            return Readings(tuple(self.final.tolist()), nothing, nothing, zero, zero, math.inf)
        tolerance = band * self.scale()
        return read(self.signal, self.step, self.final, tolerance, self.lost)


def sound_part(
    time: Floats,
    u: Floats,
    target: Floats,
    start: Floats | None,
    bound: float | None,
    expected_stop: float | None,
) -> SoundPart:
    """Cut a record where a channel leaves its physical range; parameters as `measures.measure`."""
    start = u[0] if start is None else start
    start = np.where(np.isfinite(start), start, target)
    limit = np.finfo(np.float64).max if bound is None else bound
    sound, lost = time.size, np.zeros(target.size, dtype=bool)
    if not (u.max() <= limit and u.min() >= -limit):  # also where a sample is not a number
        wrong = ~(np.abs(u) <= limit)
        sound = int(wrong.any(axis=1).argmax())
        lost = wrong[sound]
    cut = _cut(time, sound, lost, expected_stop)
    final = u[sound - 1] if sound else start
    errors = np.subtract(u[:sound].T, target[:, None], order="C")
    signal = SampledSignal(np.ascontiguousarray(time[:sound]), errors)
    return SoundPart(signal, Step(start, target), final, lost, cut)


def _cut(time: Floats, sound: int, lost: Bools, expected_stop: float | None) -> str:
    """Return why the record cannot prove that a channel settled; empty for a whole record."""
    if sound < time.size:
        return f"channel {int(np.argmax(lost)) + 1} diverged at {float(time[sound])!r} s"
    if sound < FEWEST_POINTS:
        return f"the record has {sound} points; at least {FEWEST_POINTS} are needed"
    if expected_stop is not None and time[-1] < expected_stop * (1 - 1e-9):
        return f"the record ends at {float(time[-1])!r} s, before {expected_stop!r} s"
    return ""
