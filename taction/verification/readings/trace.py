"""Crossings and peaks of a trace: one search each for records and for exact solutions.

A trace has the errors of channels at points, and between two points, and after the last one, an
upper bound of each channel and of its negative. A search looks only at intervals whose bound
reaches the level, or the highest value so far: it divides those that may hide a ringing, and
refines the instant on the trace itself in the others. So no instant is left out.

The traces of many boards are one after the other in the same arrays, so that a search is one array
operation over all boards, channels and levels.
"""

from __future__ import annotations

import functools
from abc import ABC, abstractmethod
from collections.abc import Iterator
from itertools import pairwise
from typing import NamedTuple

import numpy as np

from taction.system.array_types import EPS, Bools, Floats, Ints

PIECES = 64  # largest number of pieces of a refined interval
FEW = 4  # most pieces where a bound alone may exclude them: it falls by the fourth power
ITERATIONS = 60  # of a root
CONVERGED = 1e-8  # of an interval: last step of a root
ROUNDS = 200  # largest number of rounds of one search
AHEAD = 4  # so many doublings of the intervals that one round of a search divides
TOGETHER = 512  # peaks of a board whose intervals one round of a search divides


class Crossings(NamedTuple):
    """Instants and uncertainties of many crossings, s, of one shape; NaN for no crossing."""

    time: Floats
    uncertainty: Floats


class Trace(ABC):
    """Errors of the channels of some boards over time, distances from their targets.

    A channel of a board has a row of its own: ``board * N + channel``.
    """

    # `time`, `board`: (P,): s, from 0, and to which board it belongs. Interval k lies between the
    # points k and k + 1, the last one of a board (`tail`) after all its points.
    time: Floats
    board: Ints
    # `errors`, `bounds`: (P, N): V; bounds on the error of the errors, V.
    errors: Floats
    bounds: Floats
    # `caps`, `peaks`: (P, 2, N): upper bounds of ``e`` and of ``-e`` in each interval, V; and where
    # the bound is the height of a peak, its instant, s, else NaN.
    caps: Floats
    peaks: Floats
    reach: Floats  # (P, N): largest of the bounds in each interval, V
    resolved: Bools  # (P,): whether the points show every peak that matters in the interval
    # `ends`, `end_bounds`: (rows,): errors where the trace ends or comes to rest, V, and their
    # bounds.
    ends: Floats
    end_bounds: Floats
    # `noise`, `level`: rises that do not matter to a maximum, V: of a resolved, and of any
    # interval.
    noise: Floats
    level: Floats
    # `count`, `channels`: number of boards, and of the channels of each.
    count: int
    channels: int
    wanted: Bools  # the channels of which maxima are searched; all by default

    @abstractmethod
    def sums(self, times: Floats, board: Ints, channel: Ints, order: int) -> tuple[Floats, Floats]:
        """Return derivatives of two orders from `order` of one channel at each time, (Q,)."""

    @abstractmethod
    def refine(self, places: Ints, most: int = PIECES) -> Bools:
        """Divide the intervals at `places`; return which boards have new points."""

    def locate(self) -> None:
        """Set `first`, the first point of each board, and `tail`."""
        self.first = np.searchsorted(self.board, np.arange(self.count))
        self.tail = np.append(self.board[1:] != self.board[:-1], True)

    def last_outside(self, levels: Floats, shifts: Floats) -> Crossings:
        """Find the last instants (J, rows) with ``|error|`` above `levels`.

        The levels are those of all rows (J,), or of each (J, rows). For each level the trace is
        shifted outwards by `shifts` (J,) times its bound. NaN for a row that never is above.
        """
        shape = (2, len(levels), len(self.ends))
        side, j, row = (part.ravel() for part in np.indices(shape))
        level = np.broadcast_to(levels.reshape(len(levels), -1), shape[1:])[j, row]
        found = _TimeSearch(self, side, row, level, shifts[j], last=True).run()
        (up, down), (doubt_up, doubt_down) = (part.reshape(shape) for part in found)
        later = np.fmax(up, down)
        return Crossings(later, np.where(later == down, doubt_down, doubt_up))

    def first_reached(self, rows: Ints, steps: Floats, levels: Floats, shifts: Floats) -> Crossings:
        """Find when ``1 + error / step`` first exceeds `levels` (J,), in `rows` (R,).

        For each level the trace is shifted in the direction of the step by `shifts` (J,) times its
        bound. Shape (J, R); NaN for a level that is never exceeded.
        """
        shape = (len(levels), len(rows))
        j, r = (part.ravel() for part in np.indices(shape))
        level, side = (levels[j] - 1.0) * np.abs(steps[r]), (steps[r] < 0.0).astype(np.int64)
        found = _TimeSearch(self, side, rows[r], level, shifts[j], last=False).run()
        return Crossings(*(part.reshape(shape) for part in found))

    def highest(self, sign: float) -> tuple[Floats, Floats]:
        """Return the maximum of ``sign * error`` of every row and its uncertainty, (rows,)."""
        heights, doubts = self._highest
        side = int(sign < 0.0)
        return heights[side], doubts[side]

    @functools.cached_property
    def _highest(self) -> tuple[Floats, Floats]:
        """The maxima of ``e`` and of ``-e`` and their uncertainties, (2, rows) each."""
        count = self.count
        ends = self.ends.reshape(count, -1)
        best = np.stack([ends, -ends], axis=1)
        open_boards = np.ones(count, dtype=np.bool_)
        for _ in range(ROUNDS):
            tops = np.maximum.reduceat(self.errors, self.first)
            lows = np.minimum.reduceat(self.errors, self.first)
            best = np.maximum(best, np.stack([tops, -lows], axis=1))
            open_rows = (self.wanted & open_boards[:, None])[:, None]
            least = np.where(open_rows, self.noise[:, None, None] + best, np.inf)
            place, side, channel = np.nonzero(self.caps > least[self.board])
            board, fine = self.board[place], self.resolved[place]
            if fine.any():
                heights = self.peak(side[fine], place[fine], channel[fine])[1]
                np.maximum.at(best, (board[fine], side[fine], channel[fine]), heights)
            above = self.caps[place, side, channel] - best[board, side, channel]
            above -= self.level[board]
            coarse = np.flatnonzero(~fine & (above > 0.0))
            coarse = coarse[np.lexsort((-above[coarse], board[coarse]))]
            owner = board[coarse]
            widest = coarse[np.arange(len(owner)) - np.searchsorted(owner, owner) < TOGETHER]
            open_boards = self.refine(place[widest], FEW) if widest.size else open_boards & False
            if not open_boards.any():
                break
        reach = self.reach[:, None]
        reached, lowest = np.maximum.reduceat(self.caps + reach, self.first), np.empty_like(best)
        for k, some in each_board(self.board, count):
            highest = self.caps[some].argmax(axis=0)[None]
            lowest[k] = np.take_along_axis(reach[some], highest, axis=0)[0]
        doubt = np.maximum(reached - best, lowest)
        return best.swapaxes(0, 1).reshape(2, -1), doubt.swapaxes(0, 1).reshape(2, -1)

    def peak(self, side: Ints, k: Ints, n: Ints) -> tuple[Floats, Floats]:
        """Return instants and heights of the peaks of channels n in the resolved intervals k.

        The heights replace the bounds of the intervals.
        """
        new = np.flatnonzero(np.isnan(self.peaks[k, side, n]))
        if new.size:
            s, place, channel = side[new], k[new], n[new]
            row, sign = self.board[place] * self.channels + channel, 1.0 - 2.0 * s
            at = self.roots(row, np.zeros(len(new)), self.time[place], self.time[place + 1], 1)
            height = sign * self.value(row, at)
            for end in (place, place + 1):
                height = np.maximum(height, sign * self.errors[end, channel])
            self.caps[place, s, channel], self.peaks[place, s, channel] = height, at
        return self.peaks[k, side, n], self.caps[k, side, n]

    def _chosen(self, times: Floats, row: Ints, order: int) -> tuple[Floats, Floats]:
        """Return the derivatives of two orders from `order` of one row at each time, (Q,)."""
        return self.sums(times, *np.divmod(row, self.channels), order)

    def value(self, row: Ints, times: Floats) -> Floats:
        """Return the error of one row at each instant, (Q,)."""
        return self._chosen(times, row, 0)[0]

    def roots(self, row: Ints, level: Floats, low: Floats, high: Floats, order: int) -> Floats:
        """Solve ``e = level``, or ``e' = level`` with `order` 1, between `low` and `high`; (Q,).

        Newton's method from the cubic of time over value, kept between the ends by bisection; the
        nearer end where rounding hides a change of sign.
        """
        width, count = high - low, len(row)
        if not count:
            return low

        def evaluate(t: Floats, some: Ints) -> tuple[Floats, Floats]:
            value, slope = self._chosen(t, row[some], order)
            return value - level[some], slope

        value, slope = evaluate(np.concatenate([low, high]), np.tile(np.arange(count), 2))
        left, right = value.reshape(2, -1)
        same = left * right >= 0.0
        with np.errstate(divide="ignore", invalid="ignore"):
            part = left / (left - right)
            first, last = (right - left) / (width * slope.reshape(2, -1))
            bent = part + part * (1.0 - part) * ((1.0 - part) * (first - 1.0) + part * (1.0 - last))
        t = low + width * np.where((bent > 0.0) & (bent < 1.0), bent, 0.5)
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


def each_board(board: Ints, count: int) -> Iterator[tuple[int, slice]]:
    """Yield the boards of a rising list, and where each stands in it."""
    begins = np.searchsorted(board, np.arange(count + 1)).tolist()
    for k, (begin, end) in enumerate(pairwise(begins)):
        if begin < end:
            yield k, slice(begin, end)


def cubic_ranges(
    here: Floats, after: Floats, rise: Floats, fall: Floats, width: Floats
) -> tuple[Floats, Floats]:
    """Return the largest values (Q, N) of cubics and of their negatives.

    The cubics have values and slopes at the ends of intervals of a `width` (Q, 1).

    Examples
    --------
    >>> parabola = np.zeros((1, 1)), np.zeros((1, 1)), np.ones((1, 1)), -np.ones((1, 1))
    >>> [abs(values).tolist() for values in cubic_ranges(*parabola, np.ones((1, 1)))]
    [[[0.25]], [[0.0]]]
    """
    first, last, delta = rise * width, fall * width, after - here
    square, cube = 3.0 * delta - 2.0 * first - last, first + last - 2.0 * delta
    root = np.sqrt(np.maximum(square**2 - 3.0 * cube * first, 0.0))
    tops = []
    for sign in (1.0, -1.0):
        with np.errstate(divide="ignore", invalid="ignore"):
            at = np.fmin(np.fmax(first / (sign * root - square), 0.0), 1.0)
        peak = sign * (here + at * (first + at * (square + at * cube)))
        tops.append(np.maximum(np.maximum(sign * here, sign * after), peak))
    high, low = tops
    return high, low


class _TimeSearch:
    """A search for the last, or the first, instants at which rows (Q,) are above levels (Q,).

    They are searches of ``e`` (side 0) or ``-e`` (side 1), shifted up by `shift` times its bound.
    """

    def __init__(
        self,
        grid: Trace,
        side: Ints,
        row: Ints,
        level: Floats,
        shift: Floats,
        *,
        last: bool,
    ) -> None:
        self.grid, self.side, self.row, self.last = grid, side, row, last
        self.sign = 1.0 - 2.0 * side
        self.board, self.channel = np.divmod(row, grid.channels)
        self.level, self.shift = level, shift

    def run(self) -> Crossings:
        """Return the instants.

        NaN for a row that never is above; the last point for a row that ends above and is searched
        for its last instant; infinite uncertainty for an instant that the rounding of the solution,
        or the size of the grid, leaves open.
        """
        grid = self.grid
        above, below, doubt, moved = np.full((4, len(self.row)), np.nan)
        left = np.argsort(self.board, kind="stable")
        for turn in range(ROUNDS):
            left, k = self._candidates(left)
            if not left.size:
                break
            begin, tail = grid.time[k], grid.tail[k]
            above[left] = self._above(left, k)
            below[left] = grid.time[k + (self.last & ~tail)]
            moved[left] = self.shift[left] * grid.reach[k, self.channel[left]]
            coarse, done = ~grid.resolved[k], ~np.isnan(above[left])
            if self.last:
                off = self.sign[left] * grid.ends[self.row[left]] + moved[left]
                ends = tail & (off > self.level[left])
                above[left[ends]], coarse, done = begin[ends], coarse & ~ends, done | ends
            if coarse.any():
                divided = grid.refine(self._around(k[coarse], turn))
                stuck = coarse & ~divided[self.board[left]]
                doubt[left[stuck]] = np.inf
                above[left[stuck]] = begin[stuck] if self.last else np.nan
                done |= stuck
            left = left[~done]
        between = np.flatnonzero(~np.isnan(above) & (above != below))
        low, high = np.sort([above[between], below[between]], axis=0)
        level = (self.sign * (self.level - moved))[between]
        above[between] = grid.roots(self.row[between], level, low, high, 0)
        shortest = EPS * grid.time[grid.first + 1][self.board]
        return Crossings(above, np.fmax(doubt, np.fmax(np.spacing(np.abs(above)), shortest)))

    def _around(self, k: Ints, turn: int) -> Ints:
        """Return the intervals k, after the first turns with the coarse ones that follow them."""
        grid, steps = self.grid, np.arange(1 << min(turn, AHEAD))
        around = np.clip(np.unique(k)[:, None] + (-steps if self.last else steps), 0, None)
        around = np.minimum(around, len(grid.time) - 1)
        wanted = (grid.board[around] == grid.board[around[:, :1]]) & ~grid.resolved[around]
        wanted[:, 1:] &= ~grid.tail[around[:, 1:]]
        return np.asarray(around[wanted])

    def _candidates(self, left: Ints) -> tuple[Ints, Ints]:
        """Return the searches of `left` that have an interval above their level, and the interval.

        It is the last, or the first, of all such intervals.
        """
        grid, kept, places = self.grid, [left[:0]], [left[:0]]
        ends = np.append(grid.first, len(grid.time))
        for board, some in each_board(self.board[left], grid.count):
            searches, begin = left[some], int(ends[board])
            part = slice(begin, int(ends[board + 1]))
            n, shift = self.channel[searches], self.shift[searches, None]
            bound = grid.caps[part][:, self.side[searches], n].T + shift * grid.reach[part].T[n]
            over = bound > self.level[searches, None]
            end = over.shape[1] - 1
            k = end - over[:, ::-1].argmax(axis=1) if self.last else over.argmax(axis=1)
            found = over[np.arange(len(k)), k]
            kept.append(searches[found])
            places.append(begin + k[found])
        return np.concatenate(kept), np.concatenate(places)

    def _above(self, left: Ints, k: Ints) -> Floats:
        """Return instants in the resolved of intervals `k` at which the rows are above."""
        grid, n, limit = self.grid, self.channel[left], self.level[left]
        sign, shift = self.sign[left], self.shift[left]
        at = np.full(len(k), np.nan)
        points = (k,) if self.last else (k + ~grid.tail[k], k)
        for point in points:
            value = sign * grid.errors[point, n] + shift * grid.bounds[point, n]
            at = np.where(value > limit, grid.time[point], at)
        at[~grid.resolved[k]] = np.nan
        hidden = np.flatnonzero(grid.resolved[k] & np.isnan(at))
        if hidden.size:
            place, channel = k[hidden], n[hidden]
            instant, height = grid.peak(self.side[left[hidden]], place, channel)
            height = height + shift[hidden] * grid.reach[place, channel]
            at[hidden] = np.where(height > limit[hidden], instant, np.nan)
        return at
