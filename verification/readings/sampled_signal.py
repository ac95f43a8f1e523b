"""Sampled records as signals."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from taction.system.array_types import Floats, Indices
from taction.verification.readings.crossings import (
    Crossings,
    first_crossings,
    highest,
    last_crossings,
)

FEWEST_POINTS = 8
_FIRST_STRETCH = 1024  # points that are searched first for a rise


@dataclass(frozen=True, slots=True, eq=False)
class Rest:
    """Where channels come to rest after their record, by other knowledge than the record.

    `values` (N,) are reached at the end of time; after the record no channel is further than `left`
    from them.
    """

    values: Floats
    left: float


@dataclass(frozen=True, slots=True, eq=False)
class SampledSignal:
    """Samples of errors as a `taction.verification.readings.readings.Signal`."""

    time: Floats  # (P,), s, P at least 8
    errors: Floats  # distances from the targets (N, P)
    error: float = 0.0  # bound of the error of every sample
    rest: Rest | None = None  # of the errors

    @property
    def ends(self) -> Floats:
        """Errors (N,) at the last point."""
        return np.asarray(self.errors[:, -1])

    @property
    def end_bounds(self) -> Floats:
        """Bounds (N,) at the last point."""
        return np.full(len(self.errors), self.error)

    def last_outside(self, levels: Floats, shifts: Floats) -> Crossings:
        """See `Signal`; the levels are shifted instead of the samples."""
        moved, place = np.unique(np.maximum(levels - shifts * self.error, 0.0), return_inverse=True)
        time, errors, widest = self.time, self.errors, moved[-1]
        channels = len(errors)
        # Search only from the last point clearly outside, and the four points of a cubic before.
        outside = (errors > widest) | (errors < -widest)
        last = np.where(outside.any(axis=1), time.size - 1 - outside[:, ::-1].argmax(axis=1), 0)
        first = np.minimum(np.maximum(last - 4, 0), time.size - FEWEST_POINTS)
        begin = int(first.min())
        every = np.repeat(moved[:, None], channels, axis=1)
        at, doubt = last_crossings(
            time[begin:], errors[:, begin:], every, first - begin, mirrored=True
        )
        later = np.fmax(at[:, :channels], at[:, channels:])
        doubt = np.where(later == at[:, channels:], doubt[:, channels:], doubt[:, :channels])
        return Crossings((later - time[0])[place], np.fmax(doubt, self._rounding)[place])

    def first_reached(
        self, rows: Indices, steps: Floats, levels: Floats, shifts: Floats
    ) -> Crossings:
        """See `Signal`; the levels are shifted instead of the samples."""
        time, errors = self.time, self.errors
        moved = levels[:, None] - shifts[:, None] * (self.error / np.abs(steps))
        # Search only up to the first point clearly above, and the points that a cubic needs.
        clear, up = ((moved.max(axis=0) - 1) * steps)[:, None], (steps > 0)[:, None]
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
        at, doubt = first_crossings(time[:head], progress, moved, stop)
        return Crossings(at, np.fmax(doubt, self._rounding))

    def _peaks(self, sign: float) -> tuple[Floats, Floats]:
        """Return the maxima of ``sign * error`` and their uncertainty, (N,) each."""
        return highest(self.time, self.errors, sign)

    @property
    def _rounding(self) -> float:
        """Rounding of an instant, s."""
        return float(np.spacing(np.abs(self.time[[0, -1]]).max()))

    def highest(self, sign: float) -> tuple[Floats, Floats]:
        """See `Signal`."""
        heights, doubt = self._peaks(sign)
        doubt = doubt + self.error
        if self.rest is None:
            return heights, doubt
        last = sign * self.rest.values
        top = np.maximum(heights + doubt, last + self.rest.left + self.error)
        heights = np.maximum(heights, last)
        return heights, np.maximum(doubt, top - heights)
