"""Sampled records as signals, and the part of a record within the physical range."""

from __future__ import annotations

from dataclasses import dataclass

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

    @property
    def ends(self) -> Floats:
        """Errors (N,) at the last point."""
        return np.asarray(self.errors[:, -1])

    def last_outside(self, levels: Floats) -> Crossings:
        """See `Signal`."""
        time, errors, widest = self.time, self.errors, levels.max()
        channels = len(errors)
        # Search only from the last point clearly outside, and the four points of a cubic before.
        outside = (errors > widest) | (errors < -widest)
        last = np.where(outside.any(axis=1), time.size - 1 - outside[:, ::-1].argmax(axis=1), 0)
        first = np.minimum(np.maximum(last - 4, 0), time.size - FEWEST_POINTS)
        begin = int(first.min())
        every = np.repeat(levels[:, None], channels, axis=1)
        at, doubt = last_crossings(
            time[begin:], errors[:, begin:], every, first - begin, mirrored=True
        )
        later = np.fmax(at[:, :channels], at[:, channels:])
        doubt = np.where(later == at[:, channels:], doubt[:, channels:], doubt[:, :channels])
        return Crossings(later - time[0], doubt)

    def first_reached(self, rows: Indices, steps: Floats, levels: Floats) -> Crossings:
        """See `Signal`."""
        time, errors = self.time, self.errors
        # Search only up to the first point clearly above, and the points that a cubic needs.
        clear, up = ((levels.max() - 1) * steps)[:, None], (steps > 0)[:, None]
        size = 0
        while size < time.size:
            size = min(max(_FIRST_STRETCH, 8 * size), time.size)
            above = (errors[:, :size][rows] > clear) == up
            reached = above.any(axis=1)
            if reached.all():
                break
        stop = np.where(reached, np.maximum(above.argmax(axis=1) + 4, FEWEST_POINTS), time.size)
        stop = np.minimum(stop, time.size)
        head = int(stop.max())
        progress = 1 + errors[:, :head][rows] / steps[:, None]
        return first_crossings(
            time[:head], progress, np.repeat(levels[:, None], len(rows), axis=1), stop
        )

    def highest(self, sign: float) -> Floats:
        """See `Signal`."""
        return highest(self.time, self.errors, sign)


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
            return Readings(tuple(self.final.tolist()), nothing, nothing, zero, zero)
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
