"""Crossings and peaks of a trace: one search each for records and for exact solutions.

A trace has the errors of channels, their distances from the targets, in cells: between the ends of
a cell stands the cubic of its values and slopes. What the cubic may miss is bounded: its `room`
falls as a cell is divided, its `doubt` does not. A search looks only at cells in which the cubic
and these bounds reach the level, the outermost first, and divides them; so no instant is left out.
The cells come in blocks, which are made when a search reaches them.
"""

from __future__ import annotations

import functools
import itertools
import math
from abc import ABC, abstractmethod
from typing import NamedTuple

import numpy as np

from taction.system.array_types import Bools, Floats, Ints

CELLS = 1 << 15  # cells times channels of a block of a record
PARTS = 8  # of a cell that is divided
FINE = 1e-7  # of a level: with less room a cell is not divided
DEEPEST = 8  # so often a cell is divided
PIECES = 128  # of cells for each level, on average, up to which they are divided again
NARROW, STEPS = 1e-13, 40  # of a cell: how well a crossing is placed in it, and most steps to it
NEWTON = 3  # so many of Newton in each of them
FEW, TOGETHER = 3, 512  # first cells of a search, one at a time, and those that follow, at once


class Crossings(NamedTuple):
    """Instants and uncertainties of many crossings, s, of one shape; NaN for no crossing."""

    time: Floats
    uncertainty: Floats


class CubicCells(NamedTuple):
    """Cells of equal shape, with a cubic each: of a block (P, K), or parts of cells (PARTS, Q)."""

    begin: Floats  # s, like `width`: (P, 1) or (PARTS, Q)
    width: Floats
    left: Floats  # values at the ends, V
    right: Floats
    rise: Floats  # slopes at the ends times the width, V
    fall: Floats
    room: Floats  # bounds on what the cubic misses, V
    doubt: Floats  # bounds on the errors of the values, V

    def powers(self, sign: Floats | float = 1.0) -> tuple[Floats, Floats, Floats, Floats]:
        """Return the coefficients of ``sign * cubic`` over the place in the cells, 0 to 1, V."""
        left, right, rise, fall = (sign * part for part in self[2:6])
        bent = right - left - rise
        return left, rise, 3.0 * bent + rise - fall, fall - rise - 2.0 * bent

    def tops(self, sign: Floats | float) -> tuple[Floats, Floats]:
        """Return where in the cells ``sign * cubic`` is largest, 0 to 1, and how large, V."""
        left, rise, square, cube = self.powers(sign)
        right = sign * self.right
        root = np.sqrt(np.maximum(square**2 - 3.0 * cube * rise, 0.0))
        with np.errstate(divide="ignore", invalid="ignore"):
            at = np.fmin(np.fmax(rise / (root - square), 0.0), 1.0)
        height = left + at * (rise + at * (square + at * cube))
        ends = np.maximum(left, right)
        return np.where(height > ends, at, right >= left), np.maximum(height, ends)


class Asked(NamedTuple):
    """Levels, V, that ``e`` (side 0) or ``-e`` (1) of channels may exceed, (Q,).

    To each belongs by how much of its bound, -1 to 1, the trace is shifted towards the level.
    """

    side: Ints
    channel: Ints
    level: Floats
    shift: Floats

    def chosen(self, some: Ints) -> Asked:
        """Return some of these."""
        side, channel, level, shift = self
        return Asked(side[some], channel[some], level[some], shift[some])

    @property
    def sign(self) -> Floats:
        """1 for ``e``, -1 for ``-e``."""
        return np.where(self.side, -1.0, 1.0)


class Trace(ABC):
    """Errors of the channels of a board over time, which counts from 0."""

    channels: int
    blocks: int  # number of blocks of cells
    most: int  # so many of them are looked at in one search
    stop: float  # end of the last cell, s
    # `ends`, `end_bounds`: (K,): errors where the trace ends or comes to rest, and their bounds, V.
    ends: Floats
    end_bounds: Floats
    level: float  # a rise by less does not matter to a maximum, V

    @abstractmethod
    def block(self, number: int) -> CubicCells:
        """Return the cells of a block, (P, K)."""

    @abstractmethod
    def cap(self, number: int) -> tuple[Floats, Floats]:
        """Bound ``e`` and ``-e`` in a block, V, (2, K), but for their errors; and these, V, (K,).

        The last number stands for what follows.
        """

    def reached(self, number: int, asked: Asked) -> Bools:
        """Tell which levels the bounds of a block exceed, (Q,)."""
        cap, doubt = self.cap(number)
        channel = asked.channel
        return np.asarray(cap[asked.side, channel] + asked.shift * doubt[channel] > asked.level)

    @abstractmethod
    def divide(self, begin: Floats, width: Floats, channel: Ints) -> CubicCells:
        """Return the equal parts of pieces of cells (Q,), which belong to channels, (PARTS, Q)."""

    def last_blocks(self, asked: Asked) -> Ints:
        """Return blocks (Q,) behind which the channels stay below the levels."""
        return np.full(len(asked.side), self.blocks - 1)

    def last_outside(self, levels: Floats, shifts: Floats) -> Crossings:
        """Find the last instants (J, K) with ``|error|`` above `levels` (J,).

        For each level the trace is shifted outwards by `shifts` (J,) times its bound. NaN for a
        channel that never is above.
        """
        shape = (2, len(levels), self.channels)
        side, j, channel = (part.ravel() for part in np.indices(shape))
        found = self._search(Asked(side, channel, levels[j], shifts[j]), last=True)
        (up, down), doubts = (part.reshape(shape) for part in found)
        later = np.fmax(up, down)
        return Crossings(later, np.where(later == down, doubts[1], doubts[0]))

    def first_reached(self, rows: Ints, steps: Floats, levels: Floats, shifts: Floats) -> Crossings:
        """Find when ``1 + error / step`` first exceeds `levels` (J,), in channels `rows` (R,).

        For each level the trace is shifted in the direction of the step by `shifts` (J,) times its
        bound. Shape (J, R); NaN for a level that is never exceeded.
        """
        shape = (len(levels), len(rows))
        j, r = (part.ravel() for part in np.indices(shape))
        level, side = (levels[j] - 1.0) * np.abs(steps[r]), (steps[r] < 0.0).astype(np.int64)
        found = self._search(Asked(side, rows[r], level, shifts[j]), last=False)
        return Crossings(*(part.reshape(shape) for part in found))

    def _search(self, asked: Asked, *, last: bool) -> Crossings:
        """Find the last, or first, instants at which the trace is above levels, (Q,).

        Infinite uncertainty for an instant that the number of blocks leaves open.
        """
        time, doubt = np.full((2, len(asked.side)), np.nan)
        ends, bounds = self.ends[asked.channel], self.end_bounds[asked.channel]
        above = asked.sign * ends + asked.shift * bounds > asked.level
        start = np.zeros(len(time), np.int64)
        if last:
            open_ = (asked.shift > 0.0) & self.reached(self.blocks, asked)
            time[above | open_], doubt[above | open_] = self.stop, 0.0
            doubt[open_ & ~above], start = math.inf, self.last_blocks(asked)
        number, step = start.copy(), -1 if last else 1
        found = np.full((len(CubicCells._fields), len(time)), np.nan)  # cells
        left = np.flatnonzero(np.isnan(time))
        while (left := left[(number[left] >= 0) & (number[left] < self.blocks)]).size:
            now = step * int((step * number[left]).min())
            here = left[number[left] == now]
            many = abs(now - start[here]) == self.most
            reached = self.reached(now, asked.chosen(here))
            lost, some = here[reached & many], here[reached & ~many]
            time[lost], doubt[lost] = 0.0 if last else self.stop, math.inf
            self._in_block(now, asked, some, found, last=last)
            number[here] = np.where(many, -1, number[here] + step)
            left = left[np.isnan(time[left]) & np.isnan(found[0, left])]
        if not last:
            at_end = np.isnan(time) & above & np.isnan(found[0])
            time[at_end], doubt[at_end] = self.stop, 0.0
        some = np.flatnonzero(~np.isnan(found[0]))
        cells, ask = CubicCells(*found[:, some]), asked.chosen(some)
        level = ask.level - ask.shift * (cells.room + cells.doubt)
        time[some], doubt[some] = _edges(cells, ask.sign, level, last=last)
        return Crossings(time, np.fmax(doubt, np.spacing(np.nan_to_num(time))))

    def _in_block(
        self, number: int, asked: Asked, left: Ints, found: Floats, *, last: bool
    ) -> None:
        """Find the outermost cells in a block in which the trace is above some of the levels."""
        cells, tops, doubts = self._topped(number)
        ask = asked.chosen(left)
        reach = tops[ask.side, ask.channel]
        if np.any(ask.shift):
            reach += ask.shift[:, None] * doubts[ask.channel]
        order = slice(None, None, -1 if last else 1)
        maybe = (reach > ask.level[:, None])[:, order]  # the outermost first
        begin, width = cells.begin[order, 0], cells.width[order, 0]
        row = np.arange(len(left))
        for turn in itertools.count():
            place = maybe[row].argmax(axis=1)
            some = maybe[row, place]
            many, place = row, place = row[some], place[some]
            if not row.size:
                return
            if turn >= FEW:
                which, place = np.nonzero(maybe[row])
                few = np.arange(len(which)) - np.searchsorted(which, which) < TOGETHER
                many, place = row[which[few]], place[few]
            maybe[many, place] = False
            self._in_pieces(asked, left[many], begin[place], width[place], found, last=last)
            row = row[np.isnan(found[0, left[row]])]

    def _in_pieces(
        self, asked: Asked, row: Ints, begin: Floats, width: Floats, found: Floats, *, last: bool
    ) -> None:
        """Find the outermost parts of pieces of cells in which the trace is above levels.

        `row` (pieces,), which grows, has the place in `asked` of each; those of one place begin
        with the outermost. Each turn divides the pieces in which a level may be exceeded, but none
        behind a point that is above it. Room that is left after the last one is in the uncertainty.
        """
        order, count = slice(None, None, -1 if last else 1), len(asked.side)
        for turn in range(DEEPEST):
            pieces = begin + 1j * asked.channel[row]
            _, one, which = np.unique(pieces, return_index=True, return_inverse=True)
            divided = self.divide(begin[one], width[one], asked.channel[row[one]])
            parts = CubicCells(*(each[order, which].T.ravel() for each in divided))
            row = np.repeat(row, len(divided.begin))
            ask = asked.chosen(row)
            sign, shifted = ask.sign, ask.level - ask.shift * parts.doubt
            ends = turn == DEEPEST - 1 or (turn > 0 and len(begin) > PIECES * count)
            fine = (parts.room <= FINE * np.abs(ask.level)) | ends
            room = np.where(fine, ask.shift * parts.room, parts.room)
            above = parts.tops(sign)[1] + room > shifted
            least = np.maximum(sign * parts.left, sign * parts.right) - parts.room
            sure = least > ask.level - np.minimum(ask.shift, 0.0) * parts.doubt  # also with less
            place, first = np.arange(len(row)), np.full(count, len(row))
            np.minimum.at(first, row[sure], place[sure])
            above &= place <= first[row]
            coarse = np.zeros(count, np.bool_)
            coarse[row[above & ~fine]] = True
            known = np.flatnonzero(above & ~coarse[row])[::-1]  # the last one written counts
            found[:, row[known]] = np.stack(parts)[:, known]
            again = above & coarse[row]
            row, begin, width = row[again], parts.begin[again], parts.width[again]
            if not row.size:
                return

    def _topped(self, number: int) -> tuple[CubicCells, Floats, Floats]:
        """Return the cells of a block, bounds on ``e`` and ``-e`` but for the doubt, and the doubt.

        The bounds are (2, K, P), the doubt (K, P).
        """
        if number not in self._made:
            cells = self.block(number)
            tops = [(cells.tops(sign)[1] + cells.room).T for sign in (1.0, -1.0)]
            self._made[number] = (
                cells,
                np.ascontiguousarray(tops),
                np.ascontiguousarray(cells.doubt.T),
            )
        return self._made[number]

    @functools.cached_property
    def _made(self) -> dict[int, tuple[CubicCells, Floats, Floats]]:
        return {}

    def highest(self, sign: float) -> tuple[Floats, Floats]:
        """Return the maximum of ``sign * error`` of every channel and its uncertainty, (K,)."""
        heights, doubts, _ = self.peaks
        side = int(sign < 0.0)
        return heights[side], doubts[side]

    @functools.cached_property
    def peaks(self) -> tuple[Floats, Floats, Floats]:
        """The maxima of ``e`` and of ``-e``, their uncertainties, and their instants, (2, K)."""
        found = np.full((3, 2, self.channels), math.inf)
        found[:2] = [self.ends, -self.ends], [self.end_bounds] * 2
        best, reach = found[0], found[0] + found[1]
        every = range(min(self.blocks, self.most))
        for number in every:
            cap, doubt = self.cap(number)
            if np.any(cap > best + self.level):
                self._climb(found, reach, number)
            else:
                np.maximum(reach, cap + doubt, out=reach)
        reach = np.maximum(reach, sum(self.cap(len(every))))
        return best, np.maximum(reach - best, found[1]), found[2]

    def _climb(self, found: Floats, reach: Floats, number: int) -> None:
        """Raise maxima, with their doubts and instants, and bounds on them by those of a block."""
        cells, tops, doubts = self._topped(number)
        channels = np.arange(self.channels)
        low = tops - 2.0 * cells.room.T  # which the trace reaches in the cell
        for k, at in enumerate(low.argmax(axis=2)):
            there = low[k, channels, at], doubts[channels, at], cells.begin[at, 0]
            _raise(found, np.full(self.channels, k), channels, *there)
        maybe = tops > found[0][:, :, None] + self.level
        side, channel, place = np.nonzero(maybe)
        order = np.argsort(-tops[maybe])[: 8 * TOGETHER]
        side, channel, place = side[order], channel[order], place[order]
        others = tops + doubts
        others[side, channel, place] = -math.inf
        np.maximum(reach, others.max(axis=2), out=reach)
        begin, width = cells.begin[place, 0], cells.width[place, 0]
        for turn in range(DEEPEST):
            if not channel.size:
                break
            divided = self.divide(begin, width, channel)
            side, channel = (np.tile(each, len(divided.begin)) for each in (side, channel))
            parts, sign = CubicCells(*map(np.ravel, divided)), np.where(side, -1.0, 1.0)
            x, height = parts.tops(sign)
            fine = (parts.room <= self.level) | (turn == DEEPEST - 1)
            values = np.where(fine, height, sign * parts.left)
            _raise(found, side, channel, values, parts.doubt, parts.begin + x * parts.width)
            more = ~fine & (height + parts.room > found[0][side, channel] + self.level)
            bound = np.where(more, -math.inf, height + parts.room + parts.doubt)
            np.maximum.at(reach, (side, channel), bound)
            begin, width = parts.begin[more], parts.width[more]
            side, channel = side[more], channel[more]


def _raise(
    found: Floats, side: Ints, channel: Ints, height: Floats, doubt: Floats, time: Floats
) -> None:
    """Put heights (Q,) with their doubts and instants in the place of lower ones."""
    order = np.argsort(height)
    order = order[height[order] > found[0][side[order], channel[order]]]
    found[:, side[order], channel[order]] = np.stack([height, doubt, time])[:, order]


def _edges(cells: CubicCells, sign: Floats, level: Floats, *, last: bool) -> tuple[Floats, Floats]:
    """Return when ``sign * cubic`` of cells (Q,) is last, or first, above levels, and bounds, s.

    Places count from the outer end of a cell to the maximum of the cubic, 0 to 1. The first step
    compares equal places; the others such beside a zero by Newton's steps, and the middle.
    """
    outer, every = 1.0 if last else 0.0, np.arange(len(sign))
    inward, (a, b, c, d) = cells.tops(sign)[0] - outer, cells.powers(sign)
    places = np.linspace(0.0, 1.0, PARTS + 1)[:, None] * np.ones(len(sign))
    for _ in range(STEPS):
        x = outer + inward * places
        over = a - level + x * (b + x * (c + x * d))
        k = (over[:-1] > 0.0).argmax(axis=0)
        k[over[k, every] <= 0.0] = len(over) - 1  # the maximum, but for rounding
        before = np.maximum(k - 1, 0)
        low, high = places[before, every], places[k, every]
        below, above = over[before, every], np.maximum(over[k, every], 0.0)
        wide = high - low
        if not np.any(wide > NARROW):
            break
        zero = low + wide * below / np.where(wide > 0.0, below - above, 1.0)
        for _ in range(NEWTON):
            x, before = outer + inward * zero, zero
            value, slope = a - level + x * (b + x * (c + x * d)), b + x * (2.0 * c + 3.0 * x * d)
            with np.errstate(divide="ignore", invalid="ignore"):
                zero = np.fmin(np.fmax(before - value / (inward * slope), low), high)
        by = np.abs(zero - before)
        by = np.maximum(by * np.minimum(8.0 * by, 1.0), 0.3 * NARROW)
        inner = np.sort([zero - by, zero + by, 0.5 * (low + high)], axis=0)
        places = np.stack([low, *np.clip(inner, low, high), high])
    return cells.begin + cells.width * (outer + inward * high), cells.width * np.abs(inward) * wide
