"""Errors of exact transients on grids of instants that resolve what a search asks for.

The grid (`Course`) is logarithmic in time where a ringing persists: with a point in every period it
could have any number of points. Between two points a bound holds: the cubic through values and
slopes, and what each mode may add to it, by its fourth derivative or its envelope. The time after
the last point is an interval like any other, bounded by what is left of all modes. A search divides
only the intervals that may hold what it looks for, so the memory is bounded.
"""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from taction.system.array_types import Bools, Floats, Ints
from taction.verification.readings.course import FINENESS, Course, Courses
from taction.verification.readings.trace import PIECES, Trace, cubic_ranges

MOST = 2_000_000  # points times channels of a board: no refinement above it
SLACK = 0.05  # of the smaller slope times the width, where an interval rises and then falls: the
# tangents meet at most so far above the ends, and a resolved cubic's top errs by 0.0013 of that


class ExactTrace(Trace):
    """The channels of boards with exact solutions; the boards have equally many channels.

    `slopes` (P, N) are those of the errors, V/s.
    """

    slopes: Floats

    def __init__(self, *courses: Course) -> None:
        found = self.courses = Courses(courses)
        self.count, self.channels = found.count, found.channels
        self.ends, self.end_bounds = found.ends.ravel(), found.end_bounds.ravel()
        self.noise, self.level = found.noise, found.level
        self.wanted = np.ones((self.count, self.channels), dtype=np.bool_)
        self.time, self.board = found.first_grids()
        self.resolved = np.zeros(len(self.time), dtype=np.bool_)
        self._place(self._evaluate(self.time, self.board))
        self._bound(np.arange(len(self.time)))

    def sums(self, times: Floats, board: Ints, channel: Ints, order: int) -> tuple[Floats, Floats]:
        """See `Trace`."""
        return self.courses.sums(times, board, channel, order)

    def _place(self, columns: Floats) -> None:
        """Set the values of all points and intervals, (P, 8, N); find where each board is."""
        self._columns = columns
        self.errors, self.slopes, self.bounds, self.reach = (columns[:, k] for k in range(4))
        self.caps, self.peaks = columns[:, 4:6], columns[:, 6:8]
        self.locate()

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
        """See `Trace`.

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
