"""Crossings and peaks of exact transients, by bounds and root finding on the solutions themselves.

The grid of instants (`Course`) is logarithmic in time where a ringing persists: with a point in
every period it could have any number of points. Between two points a bound holds: the cubic through
values and slopes, and what each mode may add to it, by its fourth derivative or its envelope. The
time after the last point is an interval like any other, bounded by what is left of all modes. A
search divides only the interval that may hold the crossing or the peak, until it resolves the
ringing, and then refines the instant on the continuous solution. So no instant is left out, and the
memory is bounded.

The grids of many boards are one after the other in the same arrays, so that a search is one array
operation over all boards, channels and levels.
"""

from __future__ import annotations

import functools
from collections.abc import Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from taction.system.array_types import EPS, Bools, Floats, Ints
from taction.verification.readings.course import FINENESS, Course, Courses
from taction.verification.readings.crossings import Crossings
from taction.verification.readings.cubics import SLACK, cubic_ranges

PIECES = 64  # largest number of pieces of a refined interval
FEW = 4  # most pieces where a bound alone may exclude them: it falls by the fourth power
MOST = 2_000_000  # points times channels of a board: no refinement above it
ITERATIONS = 60  # of a root
CONVERGED = 1e-8  # of an interval: last step of a root


class ExactGrid:
    """Errors of the channels of some boards, each on a grid of its own, one after the other.

    A channel of a board has a row of its own: ``board * N + channel``.

    Attributes
    ----------
    time, board : ndarray (P,)
        s, from 0, and to which of the `courses` it belongs. Interval k lies between the points
        k and k + 1, the last one of a board (`tail`) after all its points.
    errors, slopes, bounds : ndarray (P, N)
        V and V/s; bounds on the error of the errors, V.
    caps, peaks : ndarray (P, 2, N)
        Upper bounds of ``e`` and of ``-e`` in each interval, V; and where the bound is the height
        of a peak, its instant, s, else NaN.
    reach : ndarray (P, N)
        Largest of the bounds at both ends of each interval, V.
    resolved : ndarray (P,)
        Whether the points show every mode that matters in the interval.
    ends : ndarray (rows,)
        Errors at the end of time, V.
    """

    def __init__(self, courses: Sequence[Course]) -> None:
        self.courses = Courses(courses)
        self.channels, self.ends = self.courses.channels, self.courses.ends.ravel()
        self.time, self.board = self.courses.first_grids()
        self.resolved: Bools = np.zeros(len(self.time), dtype=np.bool_)
        self._place(self._evaluate(self.time, self.board))
        self._bound(np.arange(len(self.time)))

    def _place(self, columns: Floats) -> None:
        """Set the values of all points and intervals, (P, 8, N); find where each board is."""
        self._columns = columns
        self.errors, self.slopes, self.bounds, self.reach = (columns[:, k] for k in range(4))
        self.caps, self.peaks = columns[:, 4:6], columns[:, 6:8]
        self.first = np.searchsorted(self.board, np.arange(self.courses.count))
        self.tail = np.append(self.board[1:] != self.board[:-1], True)

    def _evaluate(self, times: Floats, board: Ints) -> Floats:
        """Return errors, slopes and bounds at `times` of rising boards, then room: (Q, 8, N)."""
        columns = np.empty((len(times), 8, self.channels))
        columns[:, 0], columns[:, 1] = self.courses.evaluate(times, board)
        columns[:, 2] = self.courses.bounds(times, board)
        return columns

    def largest(self, values: Floats) -> Floats:
        """Return the largest values of each board, (boards, N), of points or intervals (P, N)."""
        return np.asarray(np.maximum.reduceat(values, self.first))

    def _bound(self, places: Ints) -> None:
        """Bound the intervals at `places`."""
        self.peaks[places] = np.nan
        last = self.tail[places]
        self.reach[places] = np.maximum(self.bounds[places], self.bounds[places + ~last])
        if last.any():
            at = places[last]
            left = self.courses.remainder(self.time[at], self.board[at])
            end = self.courses.ends[self.board[at]]
            self.caps[at] = np.stack([end + left, left - end], axis=1)
        places = places[~last]
        width = self.time[places + 1] - self.time[places]
        rate = self.courses.rate(self.time[places], self.board[places])
        self.resolved[places] = rate * width <= FINENESS
        ends = self._ends(places)
        self.caps[places] = np.stack(cubic_ranges(*ends, width[:, None]), axis=1)
        fine, coarse = self.resolved[places], places[~self.resolved[places]]
        turn = np.stack([np.minimum(ends[2], -ends[3]), np.minimum(-ends[2], ends[3])], axis=1)
        turn = np.maximum(turn[fine], 0.0) * width[fine, None, None]
        self.caps[places[fine]] += SLACK * turn
        if not coarse.size:
            return
        begin, end, board = self.time[coarse], self.time[coarse + 1], self.board[coarse]
        room, rings = self.courses.room(begin, end - begin, board)
        self.caps[coarse] += room[:, None]
        bounds = self.courses.envelopes(begin[rings], end[rings], board[rings])
        loud = coarse[rings]
        self.caps[loud] = np.minimum(self.caps[loud], bounds)

    def _ends(self, places: Ints) -> tuple[Floats, Floats, Floats, Floats]:
        """Return errors at both ends of intervals, then slopes, (Q, N) each."""
        after = places + 1
        return self.errors[places], self.errors[after], self.slopes[places], self.slopes[after]

    def refine(self, places: Ints, most: int = PIECES) -> Bools:
        """Divide the intervals at `places`; return which boards have new points.

        The last interval of a board is divided where all modes are within the noise. A board has
        no new points if its grid would be too large, or if there is nothing left to find.
        """
        places = np.unique(places)
        places = places[self._are_divisible(places)]
        last = self.tail[places]
        inner, ends = places[~last], places[last].tolist()
        width = self.time[inner + 1] - self.time[inner]
        pieces = self.courses.rate(self.time[inner], self.board[inner])
        pieces = np.ceil(pieces * width / FINENESS)
        pieces = np.clip(pieces, 2, most).astype(np.int64)
        number = pieces - 1
        which = np.repeat(np.arange(len(inner)), number)
        nth = np.arange(len(which)) - np.repeat(np.cumsum(number) - number, number) + 1
        beyond = [self.courses.later(int(self.board[k]), float(self.time[k])) for k in ends]
        new = np.concatenate([self.time[inner][which] + (width / pieces)[which] * nth, *beyond])
        into = np.concatenate([inner[which], np.repeat(places[last], list(map(len, beyond)))])
        count = self.courses.count
        added = np.bincount(self.board[into], minlength=count)
        size = added + np.bincount(self.board, minlength=count)
        divided: Bools = (added > 0) & (size * self.channels <= MOST)
        if divided.any():
            kept = np.flatnonzero(divided[self.board[into]])
            kept = kept[np.argsort(into[kept], kind="stable")]
            self._insert(places[divided[self.board[places]]], new[kept], into[kept])
        return divided

    def _are_divisible(self, places: Ints) -> Bools:
        """Tell which intervals (Q,) can be divided: a last one if modes are above the noise."""
        found, board = ~self.tail[places], self.board[places]
        at = np.flatnonzero(~found)
        if not at.size:
            return found
        left = self.courses.remainder(self.time[places[at]], board[at]).max(axis=1, initial=0.0)
        found[at] = left > self.courses.noise[board[at]]
        return found

    def _insert(self, places: Ints, new: Floats, into: Ints) -> None:
        """Insert points `new` (Q,) that divide the intervals at `places`; `into` is that of each.

        Only the points between the first and the last of them are copied one by one.
        """
        owner, begin, end = self.board[into], int(into[0]) + 1, int(into[-1]) + 1

        def with_new(old: NDArray[Any], values: NDArray[Any]) -> NDArray[Any]:
            moved = np.insert(old[begin:end], into + 1 - begin, values, axis=0)
            return np.concatenate([old[:begin], moved, old[end:]])

        self.time, self.board = with_new(self.time, new), with_new(self.board, owner)
        self.resolved = with_new(self.resolved, np.zeros(len(new), dtype=np.bool_))
        self._place(with_new(self._columns, self._evaluate(new, owner)))
        before = np.searchsorted(into, places)  # points that stand before each of the places
        self._bound(np.sort(np.concatenate([places + before, into + 1 + np.arange(len(new))])))

    def _chosen(self, times: Floats, row: Ints, order: int) -> tuple[Floats, Floats]:
        """Return the derivatives of two orders from `order` of one row at each time, (Q,)."""
        return self.courses.sums(times, *np.divmod(row, self.channels), order)

    def value(self, row: Ints, times: Floats) -> Floats:
        """Return the error of one row at each instant, (Q,)."""
        return self._chosen(times, row, 0)[0]

    def roots(self, row: Ints, level: Floats, low: Floats, high: Floats, order: int) -> Floats:
        """Solve ``e = level``, or ``e' = level`` with `order` 1, between `low` and `high`; (Q,).

        Newton's method from the cubic of time over value, kept between the ends by bisection; the
        nearer end where rounding hides a change of sign.
        """
        width, count = high - low, len(row)

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


ROUNDS = 200  # largest number of rounds of one search
AHEAD = 4  # so many doublings of the intervals that one round of a search divides
TOGETHER = 512  # peaks of a board whose intervals one round of a search divides


class ExactSignal:
    """Errors of the channels of boards with exact solutions, a `readings.Signal`.

    The boards have equally many channels. The signal has the channels of all of them, those of the
    first board first. Maxima are searched of those that are `wanted` (boards, N).
    """

    def __init__(self, *courses: Course) -> None:
        self.grid = ExactGrid(courses)
        self.wanted = np.ones((len(courses), self.grid.channels), dtype=np.bool_)
        self.ends = self.grid.ends
        self.level = self.grid.courses.level

    @property
    def end_bounds(self) -> Floats:
        """See `Signal`."""
        return self.grid.courses.end_bounds.ravel()

    def last_outside(self, levels: Floats, shifts: Floats) -> Crossings:
        """See `Signal`."""
        shape = (2, len(levels), len(self.ends))
        side, j, row = (part.ravel() for part in np.indices(shape))
        level = np.broadcast_to(levels.reshape(len(levels), -1), shape[1:])[j, row]
        found = _TimeSearch(self.grid, side, row, level, shifts[j], last=True).run()
        (up, down), (doubt_up, doubt_down) = (part.reshape(shape) for part in found)
        later = np.fmax(up, down)
        return Crossings(later, np.where(later == down, doubt_down, doubt_up))

    def first_reached(self, rows: Ints, steps: Floats, levels: Floats, shifts: Floats) -> Crossings:
        """See `Signal`."""
        shape = (len(levels), len(rows))
        j, r = (part.ravel() for part in np.indices(shape))
        level, side = (levels[j] - 1.0) * np.abs(steps[r]), (steps[r] < 0.0).astype(np.int64)
        found = _TimeSearch(self.grid, side, rows[r], level, shifts[j], last=False).run()
        return Crossings(*(part.reshape(shape) for part in found))

    def highest(self, sign: float) -> tuple[Floats, Floats]:
        """See `Signal`."""
        heights, doubts = self._highest
        side = int(sign < 0.0)
        return heights[side], doubts[side]

    @functools.cached_property
    def _highest(self) -> tuple[Floats, Floats]:
        """The maxima of ``e`` and of ``-e`` and their uncertainties, (2, rows) each."""
        grid, count = self.grid, self.grid.courses.count
        ends = self.ends.reshape(count, -1)
        best = np.stack([ends, -ends], axis=1)
        open_boards = np.ones(count, dtype=np.bool_)
        for _ in range(ROUNDS):
            tops = np.maximum.reduceat(grid.errors, grid.first)
            lows = np.minimum.reduceat(grid.errors, grid.first)
            best = np.maximum(best, np.stack([tops, -lows], axis=1))
            open_rows = (self.wanted & open_boards[:, None])[:, None]
            least = np.where(open_rows, grid.courses.noise[:, None, None] + best, np.inf)
            place, side, channel = np.nonzero(grid.caps > least[grid.board])
            board, fine = grid.board[place], grid.resolved[place]
            if fine.any():
                heights = peak(grid, side[fine], place[fine], channel[fine])[1]
                np.maximum.at(best, (board[fine], side[fine], channel[fine]), heights)
            above = grid.caps[place, side, channel] - best[board, side, channel]
            above -= self.level[board]
            coarse = np.flatnonzero(~fine & (above > 0.0))
            coarse = coarse[np.lexsort((-above[coarse], board[coarse]))]
            owner = board[coarse]
            widest = coarse[np.arange(len(owner)) - np.searchsorted(owner, owner) < TOGETHER]
            open_boards = grid.refine(place[widest], FEW) if widest.size else open_boards & False
            if not open_boards.any():
                break
        reach = grid.reach[:, None]
        reached, lowest = np.maximum.reduceat(grid.caps + reach, grid.first), np.empty_like(best)
        for k, some in grid.courses.each(grid.board):
            highest = grid.caps[some].argmax(axis=0)[None]
            lowest[k] = np.take_along_axis(reach[some], highest, axis=0)[0]
        doubt = np.maximum(reached - best, lowest)
        return best.swapaxes(0, 1).reshape(2, -1), doubt.swapaxes(0, 1).reshape(2, -1)


def peak(grid: ExactGrid, side: Ints, k: Ints, n: Ints) -> tuple[Floats, Floats]:
    """Return instants and heights of the peaks of channels n in the resolved intervals k.

    The heights replace the bounds of the intervals.
    """
    new = np.flatnonzero(np.isnan(grid.peaks[k, side, n]))
    if new.size:
        s, place, channel = side[new], k[new], n[new]
        row, sign = grid.board[place] * grid.channels + channel, 1.0 - 2.0 * s
        at = grid.roots(row, np.zeros(len(new)), grid.time[place], grid.time[place + 1], 1)
        height = sign * grid.value(row, at)
        for end in (place, place + 1):
            height = np.maximum(height, sign * grid.errors[end, channel])
        grid.caps[place, s, channel], grid.peaks[place, s, channel] = height, at
    return grid.peaks[k, side, n], grid.caps[k, side, n]


class _TimeSearch:
    """A search for the last, or the first, instants at which rows (Q,) are above levels (Q,).

    They are searches of ``e`` (side 0) or ``-e`` (side 1), shifted up by `shift` times its bound.
    """

    def __init__(
        self,
        grid: ExactGrid,
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
        for board, some in grid.courses.each(self.board[left]):
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
            instant, height = peak(grid, self.side[left[hidden]], place, channel)
            height = height + shift[hidden] * grid.reach[place, channel]
            at[hidden] = np.where(height > limit[hidden], instant, np.nan)
        return at
