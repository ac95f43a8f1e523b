"""Errors of exact transients on grids of instants that resolve what a search asks for.

The grid is logarithmic in time where a ringing persists: with a point in every period it could have
any number of points. Between two points a bound holds: the cubic through values and slopes, and
what each mode may add to it, by its fourth derivative or its envelope. The time after the last
point is an interval like any other, bounded by what is left of all modes. A search divides only the
intervals that may hold what it looks for, so the memory is bounded.

The numbers of many boards stand in the same arrays, so that each step of a search is some array
operations over all boards. Sums over modes are products of each board's own matrices.
"""

from __future__ import annotations

import functools
import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from taction.system.array_types import EPS, Bools, Complexes, Floats, Ints
from taction.verification.engines.statespace.transients.exact import Exact
from taction.verification.readings.trace import PIECES, Trace, cubic_ranges, each_board

FINENESS = 0.25  # step times |p| of the fastest mode of a resolved interval: 25 points a period
PER_OCTAVE = 32  # over ln 2: the step is at most this part of the time
SEEN = 2.0  # width times |p| up to which a chord bounds a mode better than its envelope
LONGER = 1.1  # times the end of the grid: the least next end
EARLY = 4.0 ** -np.arange(13, 1, -1)  # of the fastest mode's time constant: the first instants
NOISE = 0.1  # of the error bound: smaller amplitudes are not followed
BLOCK = 1 << 18  # modes times instants that are evaluated together
MOST = 2_000_000  # points times channels of a board: no refinement above it
SLACK = 0.05  # of the smaller slope times the width, where an interval rises and then falls: the
# tangents meet at most so far above the ends, and a resolved cubic's top errs by 0.0013 of that


@dataclass(frozen=True, eq=False)
class Course:
    """The way of one board's channels ``u = sign V`` to their targets, ``e = u - target``."""

    solution: Exact  # solution of a stable board, whose nodes are the channels
    # `signs`, `target`: (N,): signs of the channels, and their reference steady state, V.
    signs: Floats
    target: Floats
    target_error: float  # error of the target, V, which adds to the bounds of the solution
    detail: float  # amplitude of a mode below which the first grid does not resolve it, V
    # Error that a maximum may have where several intervals may hold it, V; rounding if smaller.
    level: float = 0.0

    @functools.cached_property
    def ends(self) -> Floats:
        """Errors at the end of time, V, (N,)."""
        return np.asarray(self.solution.final * self.signs - self.target)

    @functools.cached_property
    def noise(self) -> float:
        """Amplitude that is not followed, V."""
        largest = float(np.abs([self.solution.start, self.solution.final]).max(initial=0.0))
        return NOISE * (self.solution.error + self.target_error + EPS * largest)


class ExactTrace(Trace):
    """The channels of boards with exact solutions; the boards have equally many channels, N.

    `slopes` (P, N) are those of the errors, V/s. Instants (Q,) belong each to a board; where a
    function divides them by boards, the boards rise.
    """

    slopes: Floats

    def __init__(self, *courses: Course) -> None:
        flows = [course.solution.flow for course in courses]
        self.count, self.channels = len(courses), len(courses[0].signs)
        self.rest = np.array([course.ends for course in courses])  # (boards, N)
        bounds = [course.solution.rest_error + course.target_error for course in courses]
        self.ends, self.end_bounds = self.rest.ravel(), np.array(bounds).ravel()
        self.noise = np.array([course.noise for course in courses])
        self.level = np.maximum([course.level for course in courses], self.noise)
        self.wanted = np.ones((self.count, self.channels), dtype=np.bool_)
        # Of the modes, (m, boards), and their shares of the channels, (boards, N, m).
        self._poles = _stacked([flow.poles for flow in flows])
        self._powers = _stacked([flow.powers for flow in flows])
        self._scales = _stacked([flow.scales for flow in flows])
        self._rates = _stacked([flow.rates for flow in flows])
        self._speeds = _stacked([flow.speeds for flow in flows])
        parts = [flow.share * c.signs for flow, c in zip(flows, courses, strict=True)]
        self._shares = self._with_derivatives(_stacked(parts))
        self._weight = np.abs(self._shares[0])
        self._largest = np.ascontiguousarray(self._weight.max(axis=1, initial=0.0).T)
        self._lost = self._lives(self.noise)
        rates, lag, vague, omitted = zip(*(flow.bound_terms for flow in flows), strict=True)
        self._bound_rates, self._lag, self._vague = map(_stacked, (rates, lag, vague))
        self._omitted = np.array(omitted) + np.array(bounds)
        detail = np.array([course.detail for course in courses])
        self.time, self.board = self._first_grid(self._lives(detail).T)
        self.resolved = np.zeros(len(self.time), dtype=np.bool_)
        self._place(self._columns_at(self.time, self.board))
        self._bound(np.arange(len(self.time)))

    def _with_derivatives(self, share: Complexes) -> list[Complexes]:
        """Return the shares of the values and of two time derivatives, (boards, N, m) each."""
        found, poles, scales = [share], self._poles.T[:, None], self._scales.T[:, None]
        for _ in range(2):
            after = np.zeros_like(share)
            after[:, :, :-1] = np.where(self._powers.T[:, None, 1:] > 0, found[-1][:, :, 1:], 0.0)
            found.append(found[-1] * poles + scales * after)
        return found

    def _lives(self, level: Floats) -> Floats:
        """Return instants at which modes fall below a `level` (boards,), s, (m, boards)."""
        with np.errstate(divide="ignore", invalid="ignore"):
            lives = np.log(level / self._largest) / self._rates
        return np.where(self._largest > 0.0, np.maximum(lives, 0.0), 0.0)

    def _first_grid(self, lives: Floats) -> tuple[Floats, Ints]:
        """Return instants that resolve modes which end after `lives` (boards, m), and their boards.

        There are at least `PER_OCTAVE` to an octave. From rest on all modes nearly cancel, and what
        is left may turn well before any of them.
        """
        every, order = np.arange(self.count), np.argsort(lives, axis=1)
        lives = np.take_along_axis(lives, order, axis=1)
        rates = np.take_along_axis(self._speeds.T, order, axis=1)
        rates = np.maximum.accumulate(rates[:, ::-1], axis=1)[:, ::-1]  # of modes that live on
        before = np.concatenate([np.zeros((self.count, 1)), lives], axis=1)[:, :-1]
        board, mode = np.nonzero(lives > before)
        begin, end, step = before[board, mode], lives[board, mode], FINENESS / rates[board, mode]
        even = np.minimum(np.maximum(PER_OCTAVE * step, begin), end)
        counts = np.ceil([(even - begin) / step, PER_OCTAVE * np.log(end / even)]).T
        counts = counts.astype(np.int64)
        grid = _between(np.stack([begin, even, end], axis=1), counts)
        shortest = 1.0 / self._speeds.max(axis=0, initial=1.0)
        empty = np.setdiff1d(every, board)
        parts = [np.zeros(self.count), np.outer(shortest, EARLY).ravel(), shortest[empty], grid]
        owners = [every, np.repeat(every, len(EARLY)), empty, np.repeat(board, counts.sum(axis=1))]
        time, owner = np.concatenate(parts), np.concatenate(owners)
        order = np.lexsort((time, owner))
        time, owner = time[order], owner[order]
        new = np.append(True, (time[1:] != time[:-1]) | (owner[1:] != owner[:-1]))
        return time[new], owner[new]

    def _basis(self, times: Floats, board: Ints) -> Complexes:
        """Return the terms with shares of 1 at `times` (Q,), (m, Q)."""
        basis: Complexes = np.exp(self._poles[:, board] * times)
        for k in range(1, int(self._powers.max(initial=0)) + 1):
            rows = np.flatnonzero((self._powers >= k).any(axis=1))
            grown = self._scales[np.ix_(rows, board)] * times / k
            basis[rows] *= np.where(self._powers[np.ix_(rows, board)] >= k, grown, 1.0)
        return basis

    def _sums(
        self,
        board: Ints,
        terms: Callable[[slice], Complexes | Floats],
        *weights: Complexes | Floats,
    ) -> Floats:
        """Return the real parts of sums over terms with each of `weights` (boards, N, m).

        `terms` returns those of a part of the instants, (m, Q). Shape (weights, Q, N).
        """
        found = np.empty((len(weights), len(board), self.channels))
        length = max(BLOCK // max(len(self._rates), 1), 1)
        for first in range(0, len(board), length):
            part = slice(first, first + length)
            values = terms(part)
            for k, some in each_board(board[part], self.count):
                a = values[:, some].T
                for sums, weight in zip(found[:, part], weights, strict=True):
                    b = weight[k].T
                    sums[some] = a.real @ b.real
                    if np.iscomplexobj(a) and np.iscomplexobj(b):
                        sums[some] -= a.imag @ b.imag
        return found

    def evaluate(self, times: Floats, board: Ints) -> tuple[Floats, Floats]:
        """Return errors and slopes at `times`, (Q, N) each."""

        def basis(some: slice) -> Complexes:
            return self._basis(times[some], board[some])

        values, slopes = self._sums(board, basis, *self._shares[:2])
        return values + self.rest[board], slopes

    def error_bounds(self, times: Floats, board: Ints) -> Floats:
        """Return bounds on the error of the errors at `times`, V, (Q, N)."""

        def left(some: slice) -> Floats:
            return np.asarray(np.exp(self._bound_rates[:, board[some]] * times[some]))

        late, vague = self._sums(board, left, self._lag, self._vague)
        return np.asarray(self._omitted[board] + times[:, None] * late + vague)

    def sums(self, times: Floats, board: Ints, channel: Ints, order: int) -> tuple[Floats, Floats]:
        """See `Trace`."""
        basis = self._basis(times, board)
        first, second = (
            np.einsum("mq,qm->q", basis, self._shares[order + k][board, channel]).real
            for k in range(2)
        )
        return (first, second) if order else (first + self.rest[board, channel], second)

    def _rate(self, times: Floats, board: Ints) -> Floats:
        """Return |p| of the fastest mode above the noise at `times` (Q,), 1/s."""
        heard = self._lost[:, board] > times
        return np.asarray(np.where(heard, self._speeds[:, board], 0.0).max(axis=0, initial=0.0))

    def remainder(self, times: Floats, board: Ints) -> Floats:
        """Return bounds on what the modes have left after `times`, V, (Q, N)."""

        def left(some: slice) -> Floats:
            return np.asarray(np.exp(self._rates[:, board[some]] * times[some]))

        return np.asarray(self._sums(board, left, self._weight)[0])

    def room(self, begin: Floats, width: Floats, board: Ints) -> Floats:
        """Bound what lies between the channels and the cubics through values and slopes, V, (Q, N).

        The intervals (Q,) have a `width` each, s. Of a mode slower than the width the fourth
        derivative counts, of a faster one its envelope and the cubic through it.
        """

        def bent(some: slice) -> Floats:
            of = board[some]
            angle, size = self._speeds[:, of] * width[some], self._rates[:, of] * begin[some]
            return np.asarray(np.exp(size) * np.minimum(angle**4 / 384.0, 2.0 + 0.3 * angle))

        return np.asarray(self._sums(board, bent, self._weight)[0])

    def envelopes(self, begin: Floats, width: Floats, board: Ints) -> Floats:
        """Bound ``e`` and ``-e`` in intervals (Q,) by chords of slow modes and envelopes of others.

        Returns the bounds, V, (Q, 2, N).
        """

        def angle(some: slice) -> Floats:
            return np.asarray(self._speeds[:, board[some]] * width[some])

        def bent(some: slice) -> Floats:
            size = np.exp(self._rates[:, board[some]] * begin[some])
            return np.asarray(size * np.where(angle(some) <= SEEN, angle(some) ** 2 / 8.0, 1.0))

        def slow_modes(times: Floats) -> Floats:
            def slow(some: slice) -> Complexes:
                return np.asarray(self._basis(times[some], board[some]) * (angle(some) <= SEEN))

            return np.asarray(self._sums(board, slow, self._shares[0])[0] + self.rest[board])

        ends = slow_modes(begin), slow_modes(begin + width)
        (room,) = self._sums(board, bent, self._weight)
        return np.stack([np.maximum(*ends) + room, room - np.minimum(*ends)], axis=1)

    def _place(self, columns: Floats) -> None:
        """Set the values of all points and intervals, (P, 8, N); find where each board is."""
        self._columns = columns
        self.errors, self.slopes, self.bounds, self.reach = (columns[:, k] for k in range(4))
        self.caps, self.peaks = columns[:, 4:6], columns[:, 6:8]
        self.locate()

    def _columns_at(self, times: Floats, board: Ints) -> Floats:
        """Return errors, slopes and bounds at `times` of rising boards, then room: (Q, 8, N)."""
        columns = np.empty((len(times), 8, self.channels))
        columns[:, 0], columns[:, 1] = self.evaluate(times, board)
        columns[:, 2] = self.error_bounds(times, board)
        return columns

    def _bound(self, places: Ints) -> None:
        """Bound the intervals at `places`."""
        self.peaks[places] = np.nan
        last = self.tail[places]
        self.reach[places] = np.maximum(self.bounds[places], self.bounds[places + ~last])
        if last.any():
            at = places[last]
            left, end = self.remainder(self.time[at], self.board[at]), self.rest[self.board[at]]
            self.caps[at] = np.stack([end + left, left - end], axis=1)
        places = places[~last]
        width = self.time[places + 1] - self.time[places]
        angle = self._rate(self.time[places], self.board[places]) * width
        fine = self.resolved[places] = angle <= FINENESS
        rise, fall = self.slopes[places], self.slopes[places + 1]
        ends = self.errors[places], self.errors[places + 1], rise, fall
        self.caps[places] = np.stack(cubic_ranges(*ends, width[:, None]), axis=1)
        turn = np.stack([np.minimum(rise, -fall), np.minimum(-rise, fall)], axis=1)[fine]
        self.caps[places[fine]] += SLACK * np.maximum(turn, 0.0) * width[fine, None, None]
        coarse, fast = ~fine, angle > SEEN
        at, loud = places[coarse], places[fast]
        self.caps[at] += self.room(self.time[at], width[coarse], self.board[at])[:, None]
        envelopes = self.envelopes(self.time[loud], width[fast], self.board[loud])
        self.caps[loud] = np.minimum(self.caps[loud], envelopes)

    def refine(self, places: Ints, most: int = PIECES) -> Bools:
        """See `Trace`.

        The last interval of a board is divided where a mode is above the noise. A board has no new
        points if its grid would be too large, or if there is nothing left to find.
        """
        places = np.unique(places)
        last, board = self.tail[places], self.board[places]
        left = np.full((len(places), self.channels), np.inf)
        left[last] = self.remainder(self.time[places[last]], board[last])
        places = places[left.max(axis=1, initial=0.0) > self.noise[board]]
        last = self.tail[places]
        inner, ends = places[~last], places[last].tolist()
        width = self.time[inner + 1] - self.time[inner]
        pieces = self._rate(self.time[inner], self.board[inner])
        pieces = np.ceil(pieces * width / FINENESS)
        pieces = np.clip(pieces, 2, most).astype(np.int64)
        number = pieces - 1
        which = np.repeat(np.arange(len(inner)), number)
        nth = np.arange(len(which)) - np.repeat(np.cumsum(number) - number, number) + 1
        beyond = [self._later(int(self.board[k]), float(self.time[k])) for k in ends]
        new = np.concatenate([self.time[inner][which] + (width / pieces)[which] * nth, *beyond])
        into = np.concatenate([inner[which], np.repeat(places[last], list(map(len, beyond)))])
        added = np.bincount(self.board[into], minlength=self.count)
        size = added + np.bincount(self.board, minlength=self.count)
        divided: Bools = (added > 0) & (size * self.channels <= MOST)
        if divided.any():
            kept = np.flatnonzero(divided[self.board[into]])
            kept = kept[np.argsort(into[kept], kind="stable")]
            self._insert(places[divided[self.board[places]]], new[kept], into[kept])
        return divided

    def _later(self, k: int, begin: float) -> Floats:
        """Return instants after the last of a grid of board k, until all its modes are noise, s."""
        left = float(self.remainder(np.array([begin]), np.array([k])).max(initial=0.0))
        slowest = float(self._rates[0, k])
        end = begin + math.log(max(left / float(self.noise[k]), 1.0)) / -slowest
        end = LONGER * max(begin, end)
        count = math.ceil(PER_OCTAVE * math.log(end / begin))
        return _between(np.array([[begin, begin, end]]), np.array([[0, count]]))

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
        self._place(with_new(self._columns, self._columns_at(new, owner)))
        before = np.searchsorted(into, places)  # points that stand before each of the places
        self._bound(np.sort(np.concatenate([places + before, into + 1 + np.arange(len(new))])))


def _stacked(parts: Sequence[NDArray[Any]]) -> NDArray[Any]:
    """Return arrays of the boards as one, with zeros behind each.

    Of arrays (m_k,) that is (m, boards), of arrays (m_k, N) it is (boards, N, m).
    """
    counts = np.array([len(part) for part in parts])
    inside = np.arange(counts.max()) < counts[:, None]
    found = np.zeros((*inside.shape, *parts[0].shape[1:]), parts[0].dtype)
    found[inside] = np.concatenate(parts)
    return np.ascontiguousarray(found.T if found.ndim == 2 else found.swapaxes(1, 2))


def _between(ends: Floats, counts: Ints) -> Floats:
    """Return instants of pieces of time, s, one after the other, each without its begin.

    From the first of its `ends` (Q, 3) to the second a piece has so many even steps as the first of
    its `counts` (Q, 2), from there to the third so many steps in geometric progression as the
    second.
    """
    count = counts.ravel()
    which = np.repeat(np.arange(len(count)), count)
    last = np.cumsum(count)
    share = (np.arange(len(which)) + 1 - (last - count)[which]) / count[which]
    begin, end = ends[:, :2].ravel()[which], ends[:, 1:].ravel()[which]
    curved = which % 2 == 1
    found = begin + (end - begin) * share
    found[curved] = begin[curved] * (end[curved] / begin[curved]) ** share[curved]
    found[last[count > 0] - 1] = ends[:, 1:].ravel()[count > 0]
    return found
