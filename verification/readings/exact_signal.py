"""Crossings and peaks of an exact transient, by bounds and root finding on the solution itself.

The grid of instants is logarithmic in time (`PER_OCTAVE`) where a ringing persists: with a point in
every period it could have any number of points. Between two points a bound holds: the modes that
the interval resolves, and the envelopes of all others. The time after the last point is an
interval like any other, bounded by what is left of all modes. A search divides only the interval
that may hold the crossing or the peak, until it resolves the ringing, and then refines the instant
on the continuous solution. So no instant is left out, and the memory is bounded.
"""

from __future__ import annotations

import functools
import math

import numpy as np

from taction.system.array_types import EPS, Bools, Floats, Ints
from taction.verification.engines.statespace.transients.exact import Exact
from taction.verification.readings.crossings import Crossings

FINENESS = 0.25  # step times |p| of the fastest mode of a resolved interval: 25 points a period
PER_OCTAVE = 256  # over ln 2: the step is at most this part of the time
PIECES = 64  # largest number of pieces of a refined interval
MOST = 2_000_000  # points times channels: no refinement above it
SLACK = 0.1  # of the height of the tangents above the ends; a cubic's top errs by 0.0013 of it
BISECTIONS, ITERATIONS = 9, 60  # of a first root, by a cubic, and of a root
CONVERGED = 1e-8  # of an interval: last step of a root
LONGER = 1.1  # times the end of the grid: the least next end
NOISE = 0.1  # of the error bound: smaller amplitudes are not followed


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
        self.rates, self.speeds, self.share = flow.rates, flow.speeds, flow.share * signs
        self.weight: Floats = np.abs(self.share)
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
            lives = np.log(level / self.weight.max(axis=1, initial=0.0)) / self.rates
        lives = np.maximum(lives, 0.0)
        order = np.argsort(lives)
        rates = np.append(self.speeds[order], 0.0)
        return lives[order], np.maximum.accumulate(rates[::-1])[::-1]

    def _rate(self, times: Floats) -> Floats:
        """Return |p| of the fastest mode above the noise at `times` (Q,), 1/s."""
        return np.asarray(self.fastest[np.searchsorted(self.lost, times, side="right")])

    def _first_grid(self, detail: float) -> Floats:
        """Return instants that resolve modes above `detail`, at least `PER_OCTAVE` to an octave."""
        lives, rates = self._fastest(detail)
        shortest = 1.0 / float(self.speeds.max(initial=1.0))
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
        return np.asarray(np.exp(self.rates * time) @ self.weight)

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
        begin, end = self.time[places], self.time[places + 1]
        width = (end - begin)[:, None]
        seen, basis = self.speeds * width <= FINENESS, self.solution.flow.basis
        size = np.exp(self.rates * begin[:, None])
        still = [
            (shape * seen).real @ self.share.real - (shape * seen).imag @ self.share.imag
            for shape in (basis(begin), basis(end))
        ]
        bend = np.where(seen, (self.speeds * width) ** 2 / 8.0, 1.0)
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
        number = pieces - 1
        which = np.repeat(np.arange(len(inner)), number)
        nth = np.arange(len(which)) - np.repeat(np.cumsum(number) - number, number) + 1
        added = [self.time[inner][which] + (width / pieces)[which] * nth]
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


ROUNDS = 200  # largest number of rounds of one search
TOGETHER = 32  # intervals that a search for a maximum divides in one round


class ExactSignal:
    """Errors of the channels ``u = sign V`` of an exact solution, a `readings.Signal`.

    Parameters
    ----------
    solution : Exact
        Solution of a stable board, whose nodes are the channels.
    signs, target : ndarray (N,)
        Signs of the channels, and their reference steady state, V.
    target_error : float
        Error of the target, V, which adds to the bounds of the solution.
    detail : float
        Amplitude of a mode below which the first grid does not resolve it, V.
    level : float
        Error that a maximum may have where several intervals may hold it, V; rounding if smaller.
    """

    def __init__(
        self,
        solution: Exact,
        signs: Floats,
        target: Floats,
        target_error: float,
        detail: float,
        level: float = 0.0,
    ) -> None:
        self.grid = ExactGrid(solution, signs, target, target_error, detail)
        self.ends, self.level = self.grid.ends, max(level, self.grid.noise)
        # (instant, height) by side (0: of e, 1: of -e), channel, and instant before
        self.peaks: dict[tuple[int, int, float], tuple[float, float]] = {}

    @property
    def end_bounds(self) -> Floats:
        """See `Signal`."""
        return np.asarray(self.grid.solution.rest_error + self.grid.target_error)

    def last_outside(self, levels: Floats, shifts: Floats) -> Crossings:
        """See `Signal`."""
        shape = (2, len(levels), len(self.ends))
        side, j, channel = (part.ravel() for part in np.indices(shape))
        found = _Search(self, side, channel, levels[j], shifts[j], last=True).run()
        (up, down), (doubt_up, doubt_down) = (part.reshape(shape) for part in found)
        later = np.fmax(up, down)
        return Crossings(later, np.where(later == down, doubt_down, doubt_up))

    def first_reached(self, rows: Ints, steps: Floats, levels: Floats, shifts: Floats) -> Crossings:
        """See `Signal`."""
        shape = (len(levels), len(rows))
        j, r = (part.ravel() for part in np.indices(shape))
        level, side = (levels[j] - 1.0) * np.abs(steps[r]), (steps[r] < 0.0).astype(np.int64)
        found = _Search(self, side, rows[r], level, shifts[j], last=False).run()
        return Crossings(*(part.reshape(shape) for part in found))

    def highest(self, sign: float) -> tuple[Floats, Floats]:
        """See `Signal`."""
        heights, doubts = self._highest
        side = int(sign < 0.0)
        return heights[side], doubts[side]

    @functools.cached_property
    def _highest(self) -> tuple[Floats, Floats]:
        """The maxima of ``e`` and of ``-e`` and their uncertainties, (2, N) each."""
        grid, best = self.grid, np.stack([self.ends, -self.ends])
        for _ in range(ROUNDS):
            best = np.maximum(best, [grid.errors.max(axis=0), -grid.errors.min(axis=0)])
            side, place, channel = np.nonzero(grid.caps > best[:, None] + grid.noise)
            fine = grid.resolved[place]
            if fine.any():
                heights = self.peak(side[fine], place[fine], channel[fine])[1]
                np.maximum.at(best, (side[fine], channel[fine]), heights)
            above = grid.caps[side, place, channel] - best[side, channel] - self.level
            coarse = np.flatnonzero(~fine & (above > 0.0))
            widest = coarse[np.argsort(-above[coarse])[:TOGETHER]]
            if not (widest.size and self.refine(place[widest])):
                break
        reach = grid.reach
        reached = (grid.caps + reach).max(axis=1)
        lowest = np.take_along_axis(reach, grid.caps.argmax(axis=1), axis=0)
        return best, np.maximum(reached - best, lowest)

    def peak(self, side: Ints, k: Ints, n: Ints) -> tuple[Floats, Floats]:
        """Return instants and heights of the peaks of channels n in the resolved intervals k.

        The heights replace the bounds of the intervals.
        """
        grid = self.grid
        keys = list(zip(side.tolist(), n.tolist(), grid.time[k].tolist(), strict=True))
        new = np.array([i for i, key in enumerate(keys) if key not in self.peaks], dtype=np.int64)
        if new.size:
            place, channel, sign = k[new], n[new], 1.0 - 2.0 * side[new]
            at = grid.roots(channel, np.zeros(len(new)), grid.time[place], grid.time[place + 1], 1)
            height = sign * grid.value(channel, at)
            for end in (place, place + 1):
                height = np.maximum(height, sign * grid.errors[end, channel])
            grid.caps[side[new], place, channel] = height
            found = zip(at.tolist(), height.tolist(), strict=True)
            self.peaks |= zip([keys[i] for i in new.tolist()], found, strict=True)
        instants, heights = np.array([self.peaks[key] for key in keys]).T
        return instants, heights

    def refine(self, places: Ints) -> bool:
        """Divide intervals; return False if none of them can be divided further."""
        last = len(self.grid.time) - 1
        left = self.grid.remainder(float(self.grid.time[last])).max(initial=0.0)
        places = np.unique(places if left > self.grid.noise else places[places < last])
        return places.size > 0 and self.grid.refine(places)


class _Search:
    """A search for the last, or the first, instants at which channels (Q,) are above levels (Q,).

    They are searches of ``e`` (side 0) or ``-e`` (side 1), shifted up by `shift` times its bound.
    """

    def __init__(
        self,
        signal: ExactSignal,
        side: Ints,
        channel: Ints,
        level: Floats,
        shift: Floats,
        *,
        last: bool,
    ) -> None:
        self.signal, self.grid, self.side, self.last = signal, signal.grid, side, last
        self.sign = 1.0 - 2.0 * side
        self.channel, self.level, self.shift = channel, level, shift

    def run(self) -> Crossings:
        """Return the instants.

        NaN for a channel that never is above; the last point for a channel that ends above and is
        searched for its last instant; infinite uncertainty for an instant that the rounding of the
        solution, or the size of the grid, leaves open.
        """
        grid = self.grid
        above, below, doubt, moved = np.full((4, len(self.channel)), np.nan)
        left = np.arange(len(self.channel))
        for _ in range(ROUNDS):
            left, k = self._candidates(left)
            if not left.size:
                break
            n, tail = self.channel[left], k == len(grid.time) - 1
            above[left] = self._above(left, k)
            below[left] = grid.time[np.minimum(k + self.last, len(grid.time) - 1)]
            moved[left] = self.shift[left] * grid.reach[k, n]
            coarse, done = ~grid.resolved[k], ~np.isnan(above[left])
            if self.last:
                off = self.sign[left] * self.signal.ends[n] + moved[left]
                ends = tail & (off > self.level[left])
                above[left[ends]], coarse, done = grid.time[-1], coarse & ~ends, done | ends
            if coarse.any() and not self.signal.refine(k[coarse]):
                doubt[left[coarse]] = np.inf
                above[left[coarse]] = grid.time[k[coarse]] if self.last else np.nan
                done |= coarse
            left = left[~done]
        between = np.flatnonzero(~np.isnan(above) & (above != below))
        low, high = np.sort([above[between], below[between]], axis=0)
        level = (self.sign * (self.level - moved))[between]
        above[between] = grid.roots(self.channel[between], level, low, high, 0)
        rounding = np.fmax(np.spacing(np.abs(above)), EPS * grid.time[1])
        return Crossings(above, np.fmax(doubt, rounding))

    def _candidates(self, left: Ints) -> tuple[Ints, Ints]:
        """Return the searches of `left` that have an interval above their level, and the interval.

        It is the last, or the first, of all such intervals.
        """
        n = self.channel[left]
        caps, reach = self.grid.caps, self.grid.reach
        bound = caps[self.side[left], :, n].T + self.shift[left] * reach[:, n]
        over = bound > self.level[left]
        end = len(over) - 1
        k = end - over[::-1].argmax(axis=0) if self.last else over.argmax(axis=0)
        found = over[k, np.arange(len(left))]
        return left[found], k[found]

    def _above(self, left: Ints, k: Ints) -> Floats:
        """Return instants in the resolved of intervals `k` at which the channels are above."""
        grid, n, limit = self.grid, self.channel[left], self.level[left]
        sign, shift = self.sign[left], self.shift[left]
        at = np.full(len(k), np.nan)
        points = (k,) if self.last else (np.minimum(k + 1, len(grid.time) - 1), k)
        for point in points:
            value = sign * grid.errors[point, n] + shift * grid.bounds[point, n]
            at = np.where(value > limit, grid.time[point], at)
        at[~grid.resolved[k]] = np.nan
        hidden = np.flatnonzero(grid.resolved[k] & np.isnan(at))
        if hidden.size:
            place, channel = k[hidden], n[hidden]
            instant, height = self.signal.peak(self.side[left[hidden]], place, channel)
            height = height + shift[hidden] * grid.reach[place, channel]
            at[hidden] = np.where(height > limit[hidden], instant, np.nan)
        return at
