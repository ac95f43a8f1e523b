"""Sampled records as traces, with the values between the points interpolated or known.

Between two points of a record is the cubic through the four nearest ones. Its distance from the two
parabolas that leave out one outer point shows the third derivative, and a quarter of that from the
chord the second; for a sinusoid of six points a period or more, one of the two is large wherever
the error of the cubic is large. So the larger of both bounds it. Where the waveform is known
between the points, a cell is divided by its values, and no interpolation adds uncertainty.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from taction.system.array_types import Bools, Floats, Indices, Ints
from taction.verification.readings.trace import CELLS, PARTS, CubicCells, Trace

LARGEST_ERROR = 1e200  # V: that of a record of which nothing is known
CUBIC = 4  # points: more would magnify rounding where the steps grow from tiny steps
FEWEST_POINTS = 8
INSIDE = (0.25, 0.5, 0.75)  # of an interval: where the cubic is compared
NUDGE = 1e-4  # of a part: step of the differences that are slopes of a known waveform
SAME = 1e-10  # of the largest error: maxima by less apart are one
BENT = 2.0  # times the largest second difference: no cubic exceeds its samples by more

Curve = Callable[[Floats, Indices], Floats]


def lagrange(time: Floats, y: Floats, at: Floats, points: int) -> Floats:
    """Interpolate samples y (P, K) at instants (Q,), s, by the polynomial through nearest points.

    So many `points`, an even number, at most P: 2 are the chord, 4 the cubic.
    """
    first = time.searchsorted(at, side="right") - points // 2
    first = np.minimum(np.maximum(first, 0), time.size - points)
    nodes = [time[first + j] for j in range(points)]
    away = [at - node for node in nodes]
    values: Floats = np.zeros((at.size, y.shape[1]))
    for j, node in enumerate(nodes):
        others = [m for m in range(points) if m != j]
        above, below = away[others[0]], node - nodes[others[0]]
        for m in others[1:]:
            above, below = above * away[m], below * (node - nodes[m])
        values += (above / below)[:, None] * y.take(first + j, axis=0)
    return values


@dataclass(frozen=True, slots=True, eq=False)
class Rest:
    """Where channels come to rest after their record, by other knowledge than the record.

    `values` (N,) are reached at the end of time; after the record no channel is further than `left`
    from them.
    """

    values: Floats
    left: float


class RecordTrace(Trace):
    """A record of one board as a trace.

    `time` (P,): s, P at least 4.
    `errors` (K, P): distances from the targets.
    `error`: bound of the error of every sample.
    `rest`: of the errors.
    `curve`: errors of channels (Q,) at instants (Q,), s.
    """

    def __init__(
        self,
        time: Floats,
        errors: Floats,
        error: float = 0.0,
        rest: Rest | None = None,
        curve: Curve | None = None,
    ) -> None:
        self.begin, self.error, self.rest, self.curve = float(time[0]), error, rest, curve
        self.every, self.samples = time - time[0], errors
        self.channels, points = errors.shape
        self.stop, self.ends = float(self.every[-1]), errors[:, -1]
        self.bound = min(error, LARGEST_ERROR)
        self.end_bounds = np.full(self.channels, self.bound)
        self.level = SAME * float(np.abs(errors).max(initial=0.0))
        self._first = np.arange(0, points - 1, max(CELLS // max(self.channels, 1), PARTS))
        self.blocks = self.most = len(self._first)
        tops = [np.maximum.reduceat(sign * errors, self._first, axis=1) for sign in (1.0, -1.0)]
        bent = np.zeros_like(errors)
        np.abs(np.diff(errors, 2), out=bent[:, 1:-1])
        more = BENT * bent.max(axis=1, initial=0.0)[:, None]
        after = np.append(self._first[1:], points - 1)  # a block has the first sample of the next
        ends = np.stack([errors[:, after], -errors[:, after]])
        self._caps = np.maximum(np.stack(tops), ends) + more

    def cap(self, number: int) -> tuple[Floats, Floats]:
        """See `Trace`."""
        last = number == self.blocks
        cap = np.stack([self.ends, -self.ends]) if last else self._caps[:, :, number]
        return cap, self.end_bounds

    def block(self, number: int) -> CubicCells:
        """See `Trace`."""
        first, last = np.append(self._first, len(self.every) - 1)[number : number + 2]
        return self._cells(np.arange(first, last)[:, None], np.arange(self.channels))

    def _cells(self, interval: Ints, channel: Ints) -> CubicCells:
        """Return the cells of intervals and channels, which broadcast."""
        cubic = _Cubic.of(self.every, self.samples, interval, channel)
        begin, end = self.every[interval], self.every[interval + 1]
        left, right = self.samples[channel, interval], self.samples[channel, interval + 1]
        doubt, width = cubic.doubt(begin, end, left, right), end - begin
        rise, fall = (cubic.derivative(at, 1) * width for at in (begin, end))
        turns, most, change = *self._turns(interval, channel), right - left
        up, down = np.maximum(change, 0.0), np.minimum(change, 0.0)
        low, high = (np.where(turns, by, 3.0 * each) for by, each in ((-most, down), (most, up)))
        rise, fall = np.clip(rise, low, high), np.clip(fall, low, high)
        room = np.zeros_like(doubt) if self.curve is None else doubt
        known = self.bound + (doubt if self.curve is None else np.zeros_like(doubt))
        return CubicCells(begin, width, left, right, rise, fall, room, known)

    def _turns(self, interval: Ints, channel: Ints) -> tuple[Bools, Floats]:
        """Tell in which intervals there is a peak, or a trough, and how steep it is at most.

        The parabola through an extreme sample and its neighbours tells on which side that is.
        Elsewhere, and where a neighbour is as high, a cubic beyond the samples is that of a kink.
        """
        last, width = len(self.every) - 1, self.every[interval + 1] - self.every[interval]
        turns, steep = np.zeros((), np.bool_), np.full(1, np.inf)
        for end, out in ((interval, -1), (interval + 1, 1)):
            k = np.clip(end, 1, last - 1)
            before, here, beyond = (self.samples[channel, k + by] for by in (-1, 0, 1))
            near, far = self.every[k] - self.every[k - 1], self.every[k + 1] - self.every[k]
            up, down = (here - before) / near, (beyond - here) / far
            goes_on = (up * far + down * near) * up >= 0.0
            inner = k == end
            turns = turns | (inner & (up * down <= 0.0) & (goes_on == (out < 0)))
            steep = np.where(inner, np.minimum(steep, np.abs(up if out < 0 else down)), steep)
        return turns, 3.0 * steep * width

    def divide(self, begin: Floats, width: Floats, channel: Ints) -> CubicCells:
        """See `Trace`; without a curve the only part is the cell."""
        if self.curve is None:
            interval = np.searchsorted(self.every, begin, side="right") - 1
            return CubicCells(*(each[None] for each in self._cells(interval, channel)))
        part = width / PARTS
        times = begin + np.multiply.outer(np.arange(2 * PARTS + 1), 0.5 * part)
        times = np.minimum(times, self.stop)
        sooner = np.maximum(times - NUDGE * part, 0.0)
        later = np.minimum(times + NUDGE * part, self.stop)
        which = np.broadcast_to(channel, times.shape).ravel()
        before, here, after = (
            self.curve(self.begin + at.ravel(), which).reshape(times.shape)
            for at in (sooner, times, later)
        )
        apart = np.maximum(later - sooner, np.finfo(float).tiny)  # equal instants: no slope
        slope = part * ((after - before) / apart)[::2]
        room, sides = np.zeros_like(slope[:-1]), (here[:-2:2], here[2::2], slope[:-1], slope[1:])
        doubt = np.full_like(room, self.bound)
        cells = CubicCells(times[:-2:2], np.diff(times[::2], axis=0), *sides, room, doubt)
        middle = 0.5 * (cells.left + cells.right) + 0.125 * (cells.rise - cells.fall)
        return cells._replace(room=2.0 * np.abs(middle - here[1::2]))

    def highest(self, sign: float) -> tuple[Floats, Floats]:
        """See `Trace`; with where the channels come to rest after the record."""
        heights, doubt = super().highest(sign)
        if math.isinf(self.error):
            doubt = np.full(len(heights), math.inf)
        if self.rest is None:
            return heights, doubt
        last = sign * self.rest.values
        top = np.maximum(heights + doubt, last + self.rest.left + self.error)
        heights = np.maximum(heights, last)
        return heights, np.maximum(doubt, top - heights)


@dataclass(frozen=True, slots=True, eq=False)
class _Cubic:
    """Cubics through four points each: instants t, the second value, and divided differences."""

    t: tuple[Floats, ...]
    value: Floats
    first: Floats
    second: Floats
    third: Floats

    @classmethod
    def of(cls, time: Floats, y: Floats, interval: Ints, channel: Ints) -> _Cubic:
        """Return those through the points nearest to intervals, of channels that match them."""
        begin = np.clip(interval - 1, 0, len(time) - 4)
        t0, t1, t2, t3 = t = tuple(time[begin + k] for k in range(4))
        y0, y1, y2, y3 = (y[channel, begin + k] for k in range(4))
        # Newton's divided differences, from the middle pair outwards.
        d12 = (y2 - y1) / (t2 - t1)
        d012 = (d12 - (y1 - y0) / (t1 - t0)) / (t2 - t0)
        d123 = ((y3 - y2) / (t3 - t2) - d12) / (t3 - t1)
        return cls(t, y1, d12, d012, (d123 - d012) / (t3 - t0))

    def derivative(self, at: Floats, order: int) -> Floats:
        """Return values at instants, s, or the time derivative."""
        a, b, c = (at - t for t in self.t[:3])
        if order == 0:
            return self.value + b * (self.first + c * (self.second + a * self.third))
        found = (b + c) * self.second + (b * c + a * c + a * b) * self.third
        return np.asarray(self.first + found)

    def doubt(self, begin: Floats, end: Floats, left: Floats, right: Floats) -> Floats:
        """Bound the error in intervals with these ends and samples.

        What lies between two samples is at most as far from them as they are from the target.
        """
        found, (t0, t1, t2, t3) = np.zeros_like(left), self.t
        for part in INSIDE:
            at = begin + part * (end - begin)
            outer = np.maximum(np.abs(at - t0), np.abs(at - t3))
            bent = np.abs(self.derivative(at, 0) - left - part * (right - left))
            more = np.abs((at - t1) * (at - t2) * self.third) * outer
            found = np.maximum(found, np.maximum(more, 0.25 * bent))
        return np.minimum(found, np.maximum(np.abs(left), np.abs(right)))
