"""Sampled records as signals, with the values between the points interpolated or known.

Where the waveform is known between the points, they only show where a crossing or a peak is; its
instant or height is then refined on the waveform itself, and no interpolation adds uncertainty.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from taction.system.array_types import Floats, Indices
from taction.verification.readings.crossings import (
    Crossings,
    first_crossings,
    highest,
    last_crossings,
    maxima,
)

UNKNOWN_ERROR = 1e200  # V
CUBIC = 4  # points: more would magnify rounding where the steps grow from tiny steps


def lagrange(time: Floats, y: Floats, at: Floats, points: int) -> Floats:
    """Interpolate by the polynomial through the nearest points.

    Parameters
    ----------
    time : ndarray (P,)
        Strictly increasing, s; P is at least `points`.
    y : ndarray (P, K)
        Samples.
    at : ndarray (Q,)
        Instants inside the record, s.
    points : int
        Points in the stencil, even: 2 is the chord, 4 the cubic.

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


FEWEST_POINTS = 8


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
        moved = np.maximum(levels - shifts * self._finite_error, 0.0)
        channels = len(self.errors)
        both, every = np.concatenate([self.errors, -self.errors]), np.repeat(moved, 2 * channels)
        at, doubt = last_crossings(self.time, both, every.reshape(-1, 2 * channels))
        (up, down), (doubt_up, doubt_down) = (np.hsplit(part, 2) for part in (at, doubt))
        later = np.fmax(up, down)
        doubt = np.where(later == down, doubt_down, doubt_up)
        return Crossings(later - self.time[0], np.fmax(doubt, self._rounding))

    def first_reached(
        self, rows: Indices, steps: Floats, levels: Floats, shifts: Floats
    ) -> Crossings:
        """See `Signal`; the levels are shifted instead of the samples."""
        moved = levels[:, None] - shifts[:, None] * (self._finite_error / np.abs(steps))
        progress = 1 + self.errors[rows] / steps[:, None]
        at, doubt = first_crossings(self.time, progress, moved)
        return Crossings(at, np.fmax(doubt, self._rounding))

    def _peaks(self, sign: float) -> tuple[Floats, Floats]:
        """Return the maxima of ``sign * error`` and their uncertainty, (N,) each."""
        return highest(self.time, sign * self.errors)

    @property
    def _finite_error(self) -> float:
        """The error, V; of an unknown one a voltage so large that 0 times it is still 0."""
        return min(self.error, UNKNOWN_ERROR)

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


Curve = Callable[[Floats, Indices], Floats]

WIDER = 2.0  # times the uncertainty of a crossing: half the first bracket around it
STEPS = 40  # largest number of steps to a root; each at least halves its bracket
CONVERGED = 1e-9  # of the first bracket: last step to a root
AROUND = np.linspace(-1.0, 1.0, 17)  # instants of one search for a peak, in half brackets
ROUNDS = 5  # of a search for a peak; each shrinks its bracket to an eighth


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class ContinuousSignal(SampledSignal):
    """A `SampledSignal` with a `curve`: errors of channels (Q,) at instants (Q,), s."""

    curve: Curve

    def last_outside(self, levels: Floats, shifts: Floats) -> Crossings:
        """See `Signal`."""
        found, begin = SampledSignal.last_outside(self, levels, shifts), float(self.time[0])
        count = len(self.errors)
        level = np.repeat(np.maximum(levels - shifts * self._finite_error, 0.0), count)
        channel = np.tile(np.arange(count), len(levels))

        def excess(t: Floats, q: Indices) -> Floats:
            return np.asarray(np.abs(self.curve(t, channel[q])) - level[q])

        at, doubt = self._refined(Crossings(found.time + begin, found.uncertainty), excess)
        return Crossings(at - begin, doubt)

    def first_reached(
        self, rows: Indices, steps: Floats, levels: Floats, shifts: Floats
    ) -> Crossings:
        """See `Signal`."""
        found = SampledSignal.first_reached(self, rows, steps, levels, shifts)
        level = (levels[:, None] - shifts[:, None] * (self._finite_error / np.abs(steps))).ravel()
        channel, step = np.tile(rows, len(levels)), np.tile(steps, len(levels))

        def excess(t: Floats, q: Indices) -> Floats:
            return np.asarray(1.0 + self.curve(t, channel[q]) / step[q] - level[q])

        return self._refined(found, excess)

    def _refined(self, found: Crossings, excess: Curve) -> Crossings:
        """Refine crossings, at which `excess` of instants and places (Q,) changes sign.

        A crossing stays as it is where the samples do not say in which interval it lies, or where
        no change of sign is near.
        """
        at, doubt = found.time.ravel().copy(), found.uncertainty.ravel().copy()
        after = np.clip(np.searchsorted(self.time, at), 1, self.time.size - 1)
        gap = self.time[after] - self.time[after - 1]
        places = np.flatnonzero((doubt > 0.0) & (doubt <= gap) & ~np.isnan(at))
        if not places.size:
            return found
        reach = WIDER * doubt[places]
        low, high = (np.clip(at[places] + s * reach, *self.time[[0, -1]]) for s in (-1.0, 1.0))
        f_low, f_high = excess(low, places), excess(high, places)
        bracketed = np.sign(f_low) * np.sign(f_high) < 0.0
        ends = [part[bracketed] for part in (low, high, f_low, f_high)]
        places = places[bracketed]
        at[places], doubt[places] = _roots(lambda t, q: excess(t, places[q]), *ends)
        doubt[places] = np.maximum(doubt[places], self._rounding)
        shape = found.time.shape
        return Crossings(at.reshape(shape), doubt.reshape(shape))

    def _peaks(self, sign: float) -> tuple[Floats, Floats]:
        """Return the maxima of ``sign * error`` and their uncertainty, (N,) each.

        Every peak that may be the highest is searched: between its neighbours a smooth peak is
        above its highest sample by less than this sample is above the neighbours.
        """
        y, time = sign * self.errors, self.time
        heights = y.max(axis=1)
        doubts = np.spacing(np.abs(heights))
        channel, k = maxima(y, np.full(len(y), -np.inf))
        here = y[channel, k]
        room = 2.0 * here - y[channel, k - 1] - y[channel, k + 1]
        channel, k = (part[here + room >= heights[channel]] for part in (channel, k))
        if not channel.size:
            return heights, doubts
        first, last = time[k - 1][:, None], time[k + 1][:, None]
        middle, half = time[k][:, None], np.maximum(last - first, 0.0)
        columns = np.repeat(channel, AROUND.size)
        for _ in range(ROUNDS):
            t = np.clip(middle + half * AROUND, first, last)
            value = sign * self.curve(t.ravel(), columns).reshape(t.shape)
            best = value.argmax(axis=1)[:, None]
            middle, half = np.take_along_axis(t, best, axis=1), half / 8.0
        height = value.max(axis=1)
        beside = [np.take_along_axis(value, np.clip(best + s, 0, 16), axis=1) for s in (-1, 1)]
        doubt = height - np.minimum(*beside)[:, 0]
        np.maximum.at(heights, channel, height)
        np.maximum.at(doubts, channel, doubt)
        return heights, doubts


def _roots(
    excess: Curve, low: Floats, high: Floats, f_low: Floats, f_high: Floats
) -> tuple[Floats, Floats]:
    """Return roots between `low` and `high` (Q,), where `excess` changes sign, and their errors.

    Ridders's method: an exponential factor straightens the function, then a secant follows.
    """
    at, error = low.copy(), high - low
    enough = np.maximum(CONVERGED * error, 2.0 * np.spacing(np.abs(high)))
    active = np.arange(low.size)
    for _ in range(STEPS):
        if not active.size:
            break
        a, b, fa, fb = low[active], high[active], f_low[active], f_high[active]
        middle = 0.5 * (a + b)
        fm = excess(middle, active)
        root = np.sqrt(fm**2 - fa * fb)
        new = np.clip(middle + (middle - a) * np.sign(fa) * fm / root, a, b)
        fn = excess(new, active)
        points, values = np.array([a, middle, new, b]), np.array([fa, fm, fn, fb])
        order = points.argsort(axis=0)
        points, values = (np.take_along_axis(part, order, axis=0) for part in (points, values))
        change, every = (np.sign(values) != np.sign(fa)).argmax(axis=0), np.arange(a.size)
        low[active], f_low[active] = points[change - 1, every], values[change - 1, every]
        high[active], f_high[active] = points[change, every], values[change, every]
        moved = np.minimum(np.abs(new - at[active]), high[active] - low[active])
        at[active], error[active] = new, np.where(fn == 0.0, 0.0, moved)
        active = active[error[active] > enough[active]]
    return at, error
