"""Sampled records as traces, with the values between the points interpolated or known.

Between two points of a record is the cubic through the four nearest ones. Its distance from the two
parabolas that leave out one outer point shows the third derivative, and a quarter of that from the
chord the second; for a sinusoid of six points a period or more, one of the two is large wherever
the error of the cubic is large. So the larger of both bounds it, and is an uncertainty like the
error of the samples. Where the waveform is known between the points, the cubic only shows where a
crossing or a peak is, and no interpolation adds uncertainty.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from taction.system.array_types import Bools, Floats, Indices, Ints
from taction.verification.readings.trace import PIECES, Trace, cubic_ranges

LARGEST_ERROR = 1e200  # V: that of a record of which nothing is known
CUBIC = 4  # points: more would magnify rounding where the steps grow from tiny steps
FEWEST_POINTS = 8
BLOCK = 32  # samples that a search looks at together until it needs each
INSIDE = (0.25, 0.5, 0.75)  # of an interval: where the cubic is compared
NUDGE = 1e-4  # of an interval: step of the differences that are slopes of a known waveform

Curve = Callable[[Floats, Indices], Floats]


def lagrange(time: Floats, y: Floats, at: Floats, points: int) -> Floats:
    """Interpolate by the polynomial through the nearest points.

    `time` (P,): strictly increasing, s; P is at least `points`.
    `y` (P, K): samples.
    `at` (Q,): instants inside the record, s.
    `points`: points in the stencil, even: 2 is the chord, 4 the cubic.

    Returns
    -------
    ndarray (Q, K)
        Values at `at`.
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
    `errors` (N, P): distances from the targets.
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
        self.count, (self.channels, points) = 1, errors.shape
        self.ends, self.end_bounds = errors[:, -1], np.full(self.channels, error)
        self.noise = self.level = np.zeros(1)
        self.wanted = np.ones((1, self.channels), dtype=np.bool_)
        bent = np.zeros_like(errors)
        np.abs(np.diff(errors, 2), out=bent[:, 1:-1])
        self.kept = np.append(np.arange(0, points - 1, BLOCK), points - 1)
        self._bent = self._largest(bent)
        tops = self._largest(self.samples), self._largest(-self.samples)
        self._caps = np.stack(tops, axis=1) + self._bent[:, None]
        self._build()

    def _largest(self, values: Floats) -> Floats:
        """Return the largest of the values (N, P) in each block, its ends included; (blocks, N)."""
        inside = np.maximum.reduceat(values[:, :-1], self.kept[:-1], axis=1)
        return np.maximum(inside, values[:, self.kept[1:]]).T

    def _build(self) -> None:
        """Set points and intervals: those that are `kept`, and in place of others their blocks.

        A peak between samples is above its highest one by less than this is above its neighbours.
        """
        self.time, self.errors = self.every[self.kept], self.samples[:, self.kept].T
        points, gap = len(self.kept), np.append(np.diff(self.kept), 1)
        self.board, self.resolved = np.zeros(points, np.int64), gap == 1
        self.bounds = np.full(self.errors.shape, min(self.error, LARGEST_ERROR))
        self.peaks = np.full((points, 2, self.channels), np.nan)
        self.caps = np.stack([self.errors, -self.errors], axis=1)
        self.reach = self.bounds.copy()
        self.locate()
        coarse = np.flatnonzero(~self.resolved)
        self.caps[coarse] = self._caps[self.kept[coarse] // BLOCK]
        self.reach[coarse] += self._bent[self.kept[coarse] // BLOCK]
        fine = np.flatnonzero(self.resolved[:-1])
        cubic = _Cubic.of(
            self.every, self.samples, self.kept[fine][:, None], np.arange(self.channels)
        )
        begin, end = self.time[fine, None], self.time[fine + 1, None]
        left, right = self.errors[fine], self.errors[fine + 1]
        slopes = cubic.derivative(begin, 1), cubic.derivative(end, 1)
        tops = np.stack(cubic_ranges(left, right, *slopes, end - begin), axis=1)
        ends = np.stack([np.maximum(left, right), np.maximum(-left, -right)], axis=1)
        self.caps[fine] = np.minimum(tops, ends + self._room(self.kept[fine]))
        doubt = cubic.doubt(begin, end, left, right)
        if self.curve is None:
            self.reach[fine] += doubt
        else:
            self.caps[fine] += doubt[:, None]

    def _room(self, k: Ints) -> Floats:
        """Bound how far ``e``, or ``-e``, is above the samples in intervals (Q,): (Q, 2, N).

        The parabola through a local maximum of the samples and its neighbours tells on which side
        the peak is: above each end by less than this is above its neighbours. Elsewhere, and where
        only one end is above its neighbours, a cubic beyond the samples is that of a kink.
        """
        last = len(self.every) - 1
        places = np.stack([np.maximum(k - 1, 0), k, k + 1, np.minimum(k + 2, last)])
        gaps = np.diff(self.every[places], axis=0)[:, :, None] ** 2
        rises, found = np.diff(self.samples.T[places], axis=0), list[Floats]()
        for sign in (1.0, -1.0):
            up, across, down = sign * rises
            right = (k > 0)[:, None] & (up >= 0.0) & (across <= 0.0)
            right &= up * gaps[1] >= -across * gaps[0]
            left = (k + 2 <= last)[:, None] & (across >= 0.0) & (down <= 0.0)
            left &= across * gaps[2] < -down * gaps[1]
            room = np.minimum(up - across, across - down)
            found.append(np.where(right | left, np.maximum(room, 0.0), 0.0))
        return np.stack(found, axis=1)

    def refine(self, places: Ints, most: int = PIECES) -> Bools:
        """See `Trace`: the samples of a block take its place."""
        coarse = self.kept[places[~self.resolved[places]]]
        new = (coarse[:, None] + np.arange(BLOCK)).ravel()
        new = np.setdiff1d(new[new < len(self.every)], self.kept)
        if new.size:
            self.kept = np.union1d(self.kept, new)
            self._build()
        return np.array([bool(new.size)])

    def sums(self, times: Floats, board: Ints, channel: Ints, order: int) -> tuple[Floats, Floats]:
        """See `Trace`."""
        k = np.searchsorted(self.every, times, side="right") - 1
        k = np.clip(k, 0, len(self.every) - 2)
        if self.curve is None:
            cubic = _Cubic.of(self.every, self.samples, k, channel)
            return cubic.derivative(times, order), cubic.derivative(times, order + 1)
        step = NUDGE * (self.every[k + 1] - self.every[k])
        at = np.clip(times, step, self.every[-1] - step)
        before, here, after = (
            self.curve(self.begin + at + by, channel) for by in (-step, 0.0 * step, step)
        )
        slope = (after - before) / (2.0 * step)
        if order:
            return slope, (after - 2.0 * here + before) / step**2
        return self.curve(self.begin + times, channel), slope

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
        """Return values at instants, s, or the first or the second time derivative."""
        a, b, c = (at - t for t in self.t[:3])
        if order == 0:
            return self.value + b * (self.first + c * (self.second + a * self.third))
        if order == 1:
            found = (b + c) * self.second + (b * c + a * c + a * b) * self.third
            return np.asarray(self.first + found)
        return 2.0 * (self.second + (a + b + c) * self.third)

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
