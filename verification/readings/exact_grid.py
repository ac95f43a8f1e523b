"""An exact transient on a grid of instants, with an upper bound between any two of them.

A grid that resolves every period of a ringing can have any number of points. This grid is
logarithmic in time (`PER_OCTAVE`) where ringing persists. An interval that does not resolve some
modes is bounded by the other modes and by the envelopes of those; the end of time is an interval,
too, bounded by what is left of all modes. A reading refines only intervals on which it depends
(see `exact_crossings`), so the grid never runs out and its memory is bounded.
"""

from __future__ import annotations

import math

import numpy as np

from taction.system.array_types import Bools, Floats, Ints
from taction.verification.engines.statespace.linearised.time_scales import UNRESOLVED
from taction.verification.engines.statespace.transients.exact import Exact
from taction.verification.engines.statespace.transients.matrix_exponential import Exponentials

FINENESS = 0.25  # step times |p| of the fastest mode of a resolved interval: 25 points a period
PER_OCTAVE = 256  # over ln 2: the step is at most this part of the time
PIECES = 64  # largest number of pieces of a refined interval
MOST = 2_000_000  # points times channels: no refinement above it
SLACK = 0.1  # of the height of the tangents above the ends; a cubic's top errs by 0.0013 of it
BISECTIONS, ITERATIONS = 18, 60  # of a first root, by a cubic, and of a root
CONVERGED = 1e-8  # of an interval: last step of a root
LONGER = 1.1  # times the end of the grid: the least next end
NOISE = 0.1  # of the error bound: smaller amplitudes are not followed
EPS = float(np.finfo(np.float64).eps)


class ExactGrid:
    """Errors of the channels, ``e = sign V - target``, on a grid.

    Attributes
    ----------
    time : ndarray (P,)
        s, from 0. Interval k lies between the points k and k + 1, the last one after all points.
    errors, slopes, bounds : ndarray (P, N)
        V and V/s; bounds on the error of the errors, V.
    caps : ndarray (2, P, N)
        Upper bounds of ``e`` and of ``-e`` in each interval, V.
    resolved : ndarray (P,)
        Whether the points show every mode that matters in the interval.
    ends : ndarray (N,)
        Errors at the end of time, V.
    """

    def __init__(
        self, solution: Exact, signs: Floats, target: Floats, target_error: float, detail: float
    ) -> None:
        """Make the first grid; parameters as `exact_crossings.ExactSignal`."""
        self.solution, self.signs, self.target = solution, signs, target
        self.target_error = target_error
        largest = float(np.abs([solution.start, solution.final]).max(initial=0.0))
        self.noise = NOISE * (solution.error + target_error + EPS * largest)
        self.ends: Floats = solution.final * signs - target
        flow = solution.flow
        self.modal = isinstance(flow, Exponentials)
        if isinstance(flow, Exponentials):
            self.poles, self.share = flow.poles, flow.share * signs
            self.weight: Floats = np.abs(self.share)
        else:
            self.poles = solution.poles
            step = float(np.abs(solution.final - solution.start).max(initial=detail))
            self.weight = np.full((len(self.poles), len(signs)), UNRESOLVED * step)
        self.lost, self.fastest = self._fastest(self.noise)
        self.time = self._first_grid(detail)
        self.errors, self.slopes, self.bounds = self._evaluate(self.time)
        self.caps: Floats = np.empty((2, *self.errors.shape))
        self.resolved: Bools = np.zeros(len(self.time), dtype=np.bool_)
        self._bound(np.arange(len(self.time)))

    def _fastest(self, level: float) -> tuple[Floats, Floats]:
        """Return instants (m,) at which modes fall below `level`, and the fastest |p| before each.

        The last rate, of the time after all instants, is 0.
        """
        with np.errstate(divide="ignore"):
            lives = np.log(level / self.weight.max(axis=1, initial=0.0)) / self.poles.real
        lives = np.maximum(lives, 0.0)
        order = np.argsort(lives)
        rates = np.append(np.abs(self.poles)[order], 0.0)
        return lives[order], np.maximum.accumulate(rates[::-1])[::-1]

    def _rate(self, times: Floats) -> Floats:
        """Return |p| of the fastest mode above the noise at `times` (Q,), 1/s."""
        return np.asarray(self.fastest[np.searchsorted(self.lost, times, side="right")])

    def _first_grid(self, detail: float) -> Floats:
        """Return instants that resolve modes above `detail`, at least `PER_OCTAVE` to an octave."""
        lives, rates = self._fastest(detail)
        shortest = 1.0 / float(np.abs(self.poles).max(initial=1.0))
        parts, t = [np.zeros(1)], 0.0
        for end, rate in zip(lives.tolist(), rates.tolist(), strict=False):
            if end <= t:
                continue
            step = FINENESS / rate
            even = min(max(PER_OCTAVE * step, t), end)
            parts.append(np.linspace(t, even, math.ceil((even - t) / step) + 1)[1:])
            if end > even:
                parts.append(self._octaves(even, end))
            t = end
        return np.concatenate([*parts, [shortest]]) if t == 0.0 else np.concatenate(parts)

    def _octaves(self, begin: float, end: float) -> Floats:
        """Return instants in geometric progression after `begin` up to `end`, s."""
        count = math.ceil(PER_OCTAVE * math.log(end / begin))
        return np.geomspace(begin, end, count + 1)[1:]

    def _evaluate(self, times: Floats) -> tuple[Floats, Floats, Floats]:
        """Return errors, slopes and bounds at `times`, (Q, N) each."""
        values, slopes = self.solution.flow.pair(times)
        bounds = self.solution.bounds(times) + self.target_error
        return values * self.signs + self.ends, slopes * self.signs, bounds

    def remainder(self, time: float) -> Floats:
        """Return a bound (N,) on what the modes have left after `time`, V."""
        return np.asarray(np.exp(self.poles.real * time) @ self.weight)

    @property
    def reach(self) -> Floats:
        """Largest of the bounds at both ends of each interval, (P, N)."""
        after = np.concatenate([self.bounds[1:], self.bounds[-1:]])
        return np.asarray(np.maximum(self.bounds, after))

    def _bound(self, places: Ints) -> None:
        """Bound the intervals at `places`."""
        last = len(self.time) - 1
        if places[-1] == last:
            left = self.remainder(float(self.time[last]))
            self.caps[:, last] = self.ends + left, left - self.ends
            places = places[:-1]
        width = self.time[places + 1] - self.time[places]
        self.resolved[places] = self._rate(self.time[places]) * width <= FINENESS
        here, after = self.errors[places], self.errors[places + 1]
        rise, fall = self.slopes[places], self.slopes[places + 1]
        for side, sign in enumerate((1.0, -1.0)):
            self.caps[side, places] = _tops(
                sign * here, sign * after, sign * rise, sign * fall, width
            )
        coarse = places[~self.resolved[places]]
        if coarse.size:
            self.caps[:, coarse] = self._envelopes(coarse)

    def _envelopes(self, places: Ints) -> Floats:
        """Bound intervals by the modes that they resolve and the envelopes of the others."""
        if not self.modal:
            return np.full((2, len(places), len(self.ends)), np.inf)
        begin, end = self.time[places], self.time[places + 1]
        width = (end - begin)[:, None]
        seen = np.abs(self.poles) * width <= FINENESS
        size = np.exp(self.poles.real * begin[:, None])
        still = [
            (np.exp(np.outer(t, self.poles)) * seen).real @ self.share.real
            - (np.exp(np.outer(t, self.poles)) * seen).imag @ self.share.imag
            for t in (begin, end)
        ]
        bend = np.where(seen, (np.abs(self.poles) * width) ** 2 / 8.0, 1.0)
        room = (size * bend) @ self.weight
        high = np.maximum(*still) + self.ends + room
        return np.stack([high, room - np.minimum(*still) - self.ends])

    def refine(self, places: Ints) -> bool:
        """Divide the intervals at `places`; return False if the grid would be too large.

        The last interval is divided where all modes are within the noise.
        """
        last = len(self.time) - 1
        inner = places[places < last]
        width = self.time[inner + 1] - self.time[inner]
        pieces = np.ceil(self._rate(self.time[inner]) * width / FINENESS)
        pieces = np.clip(pieces, 2, PIECES).astype(np.int64)
        added = [
            np.linspace(begin, begin + span, count + 1)[1:-1]
            for begin, span, count in zip(self.time[inner], width, pieces.tolist(), strict=True)
        ]
        if places[-1] == last:
            begin = float(self.time[last])
            added.append(self._octaves(begin, max(LONGER * begin, float(self.lost[-1]))))
        new = np.concatenate(added)
        if (len(self.time) + len(new)) * len(self.ends) > MOST:
            return False
        changed = np.concatenate([self.time[places], new])
        order = np.argsort(np.concatenate([self.time, new]), kind="stable")
        old = self.errors, self.slopes, self.bounds
        pairs = zip(old, self._evaluate(new), strict=True)
        self.errors, self.slopes, self.bounds = (np.concatenate(pair)[order] for pair in pairs)
        room = np.empty((2, len(new), len(self.ends)))
        self.caps = np.concatenate([self.caps, room], axis=1)[:, order]
        self.resolved = np.append(self.resolved, np.zeros(len(new), dtype=np.bool_))[order]
        self.time = np.concatenate([self.time, new])[order]
        self._bound(np.unique(np.searchsorted(self.time, changed)))
        return True

    def value(self, channel: Ints, times: Floats) -> Floats:
        """Return the error of one channel at each instant, (Q,)."""
        value, _ = self.solution.flow.chosen(times, channel, 0)
        return np.asarray(self.signs[channel] * value + self.ends[channel])

    def roots(self, channel: Ints, level: Floats, low: Floats, high: Floats, order: int) -> Floats:
        """Solve ``e = level``, or ``e' = level`` with `order` 1, between `low` and `high`; (Q,).

        Newton's method, kept between the ends by bisection; the nearer end where rounding hides a
        change of sign.
        """
        sign, shift = self.signs[channel], level - (0.0 if order else self.ends[channel])
        width, count = high - low, len(channel)

        def evaluate(t: Floats, some: Ints) -> tuple[Floats, Floats]:
            value, slope = self.solution.flow.chosen(t, channel[some], order)
            return sign[some] * value - shift[some], sign[some] * slope

        value, slope = evaluate(np.concatenate([low, high]), np.tile(np.arange(count), 2))
        left, right = value.reshape(2, -1)
        t = low + width * _cubic_root(left, right, *slope.reshape(2, -1) * width)
        same = left * right >= 0.0
        t = np.where(same, np.where(np.abs(right) < np.abs(left), high, low), t)
        low, high, active = low.copy(), high.copy(), np.flatnonzero(~same)
        for _ in range(ITERATIONS):
            if not active.size:
                break
            now = t[active]
            value, slope = evaluate(now, active)
            before = np.sign(value) == np.sign(left[active])
            low[active] = np.where(before, now, low[active])
            high[active] = np.where(before, high[active], now)
            with np.errstate(divide="ignore", invalid="ignore"):
                step = now - value / slope
            inside = (step >= low[active]) & (step <= high[active])
            t[active] = np.where(inside, step, 0.5 * (low[active] + high[active]))
            # Newton's method squares the relative error: the next step would be rounding.
            moved = np.abs(t[active] - now)
            active = active[moved > np.maximum(CONVERGED * width[active], 2.0 * np.spacing(now))]
        return t


def _cubic_root(here: Floats, after: Floats, first: Floats, last: Floats) -> Floats:
    """Return where cubics through values and slopes at 0 and 1 are zero, 0 to 1; (Q,)."""
    delta = after - here
    square, cube = 3.0 * delta - 2.0 * first - last, first + last - 2.0 * delta
    low, high = np.zeros(len(here)), np.ones(len(here))
    for _ in range(BISECTIONS):
        middle = 0.5 * (low + high)
        value = here + middle * (first + middle * (square + middle * cube))
        before = np.sign(value) == np.sign(here)
        low, high = np.where(before, middle, low), np.where(before, high, middle)
    return 0.5 * (low + high)


def _tops(here: Floats, after: Floats, rise: Floats, fall: Floats, width: Floats) -> Floats:
    """Return upper bounds (Q, N) of a signal in intervals, from values and slopes at their ends.

    Between a rising and a falling end: the top of the cubic through both, and `SLACK` of the height
    of the tangents' intersection above the ends.
    """
    top = np.maximum(here, after)
    row, column = np.nonzero((rise > 0.0) & (fall < 0.0))
    if row.size:
        y, span = here[row, column], width[row]
        first, last = rise[row, column] * span, fall[row, column] * span
        delta = after[row, column] - y
        square, cube = 3.0 * delta - 2.0 * first - last, first + last - 2.0 * delta
        root = np.sqrt(np.maximum(square**2 - 3.0 * cube * first, 0.0))
        at = np.clip(first / (root - square), 0.0, 1.0)
        peak = y + at * (first + at * (square + at * cube))
        meet = y + first * np.clip((delta - last) / (first - last), 0.0, 1.0)
        ends = top[row, column]
        top[row, column] = np.maximum(peak, ends) + SLACK * np.maximum(meet - ends, 0.0)
    return top
