"""Sampled records whose values between the points are known, too.

The points of a record only show where a crossing or a peak is. The instant or the height is then
refined on the waveform itself, so that no interpolation adds to the uncertainty.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from taction.system.array_types import Floats, Indices
from taction.verification.readings.crossings import Crossings
from taction.verification.readings.sampled_signal import SampledSignal

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
        level = np.repeat(np.maximum(levels - shifts * self.error, 0.0), count)
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
        level = (levels[:, None] - shifts[:, None] * (self.error / np.abs(steps))).ravel()
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
        before, here, after = y[:, :-2], y[:, 1:-1], y[:, 2:]
        room = 2.0 * here - before - after
        top = (here >= before) & (here >= after) & (here + room >= heights[:, None])
        channel, k = np.nonzero(top)
        if not channel.size:
            return heights, doubts
        first, last = time[k][:, None], time[k + 2][:, None]
        middle, half = time[k + 1][:, None], np.maximum(last - first, 0.0)
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
