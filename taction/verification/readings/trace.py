"""Crossings and peaks of a trace: one search each for records and for exact solutions.

A trace has the errors of channels, their distances from the targets, in cells: between the ends of
a cell stands the cubic of its values and slopes. What the cubic may miss is bounded: its `room`
falls as a cell is divided, its `doubt` does not. A search looks only at cells in which the cubic
and these bounds reach the level, the outermost first, and divides them; so no instant is left out.
The cells come in blocks, which are made when a search reaches them.
"""

from __future__ import annotations

import functools
import math
from abc import ABC, abstractmethod
from collections.abc import Iterator
from typing import NamedTuple

import numpy as np

from taction.system.array_types import Floats, Ints

CELLS = 1 << 15  # cells times channels of a block
PARTS = 8  # of a cell that is divided
BLOCKS = 12  # so many blocks of an exact solution are looked at in one search
ROUNDS = 200  # largest number of cells that a search divides
FINE = 1e-7  # of a level: with less room a cell is not divided
DEEPEST = 8  # so often a cell is divided
SMALLEST = 1e-9  # of a cell: what is left of it counts as nothing
NARROWED = 17  # so often the place of a crossing in its cell is narrowed to a `PARTS`-th
FEW, TOGETHER = 4, 512  # first candidates of a search, and those that are divided at once


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

    def tops(self, sign: Floats | float) -> tuple[Floats, Floats]:
        """Return where in the cells ``sign * cubic`` is largest, 0 to 1, and how large, V."""
        left, right, rise, fall = (sign * part for part in self[2:6])
        square, cube = 3.0 * (right - left) - 2.0 * rise - fall, rise + fall - 2.0 * (right - left)
        root = np.sqrt(np.maximum(square**2 - 3.0 * cube * rise, 0.0))
        with np.errstate(divide="ignore", invalid="ignore"):
            at = np.fmin(np.fmax(rise / (root - square), 0.0), 1.0)
        height = left + at * (rise + at * (square + at * cube))
        ends = np.maximum(left, right)
        return np.where(height > ends, at, right >= left), np.maximum(height, ends)

    def at(self, x: Floats) -> Floats:
        """Return the cubics at places of the cells, 0 to 1."""
        rise, fall, delta = self.rise, self.fall, self.right - self.left
        square, cube = 3.0 * delta - 2.0 * rise - fall, rise + fall - 2.0 * delta
        return np.asarray(self.left + x * (rise + x * (square + x * cube)))

    def chosen(self, part: Ints) -> CubicCells:
        """Return one part of each of the divided cells, (Q,)."""
        return CubicCells(*(each[part, np.arange(len(part))] for each in self))


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

    def reached(self, number: int, side: int, channel: int, shift: float) -> float:
        """Return the bound of a channel in a block, shifted by its error, V."""
        cap, doubt = self.cap(number)
        return float(cap[side, channel] + shift * doubt[channel])

    @abstractmethod
    def divide(self, begin: Floats, width: Floats, channel: Ints) -> CubicCells:
        """Return the equal parts of pieces of cells (Q,), which belong to channels, (PARTS, Q)."""

    def last_block(self, side: int, channel: int, shift: float, level: float) -> int:
        """Return a block behind which a channel stays below a level."""
        return self.blocks - 1

    def last_outside(self, levels: Floats, shifts: Floats) -> Crossings:
        """Find the last instants (J, K) with ``|error|`` above `levels` (J,).

        For each level the trace is shifted outwards by `shifts` (J,) times its bound. NaN for a
        channel that never is above.
        """
        shape = (2, len(levels), self.channels)
        side, j, channel = (part.ravel() for part in np.indices(shape))
        found = self._search(side, channel, levels[j], shifts[j], last=True)
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
        found = self._search(side, rows[r], level, shifts[j], last=False)
        return Crossings(*(part.reshape(shape) for part in found))

    def _search(
        self, side: Ints, channel: Ints, level: Floats, shift: Floats, *, last: bool
    ) -> Crossings:
        """Find the last, or first, instants at which ``e`` (side 0) or ``-e`` (1) is above levels.

        All are (Q,). Infinite uncertainty for an instant that the number of blocks, or of
        divisions, leaves open.
        """
        asked = zip(side.tolist(), channel.tolist(), level.tolist(), shift.tolist(), strict=True)
        queues = [self._candidates(*each, last=last) for each in asked]
        time, doubt, begin, width = np.full((4, len(side)), np.nan)
        left = np.arange(len(side))
        for turn in range(ROUNDS + 1):
            for q in left[np.isnan(begin[left])].tolist():
                begin[q], width[q] = next(queues[q], (math.nan, 0.0))
            open_, ends = np.isinf(width[left]) | (turn == ROUNDS), width[left] == 0.0
            doubt[left[open_]], done = math.inf, open_ | ends
            time[left[done]] = begin[left[done]]
            left = left[~done & ~np.isnan(begin[left])]
            if not left.size:
                break
            piece, sign = (begin[left], width[left], channel[left]), 1.0 - 2.0 * side[left]
            doubt[left] = width[left] * float(PARTS) ** -NARROWED
            found = self._within(*piece, sign, level[left], shift[left], last=last)
            time[left], begin[left], width[left] = found
            left = left[np.isnan(time[left])]
        return Crossings(time, np.fmax(doubt, np.spacing(np.nan_to_num(time))))

    def _candidates(
        self, side: int, channel: int, level: float, shift: float, *, last: bool
    ) -> Iterator[tuple[float, float]]:
        """Yield begin and width of the cells that may be above a level, s, the outermost first.

        A width of 0 is an end of the trace that is above, an infinite one says that others may be.
        """
        numbers = range(self.blocks)
        end = (1.0 - 2.0 * side) * self.ends[channel] + shift * self.end_bounds[channel]
        if last:
            left = self.reached(self.blocks, side, channel, shift) > level
            if end > level or (shift > 0.0 and left):
                yield self.stop, (0.0 if end > level else math.inf)
            numbers = range(self.last_block(side, channel, shift, level), -1, -1)
        for tried, number in enumerate(numbers):
            reached = self.reached(number, side, channel, shift) > level
            if tried == self.most:
                if reached:
                    yield (0.0 if last else self.stop), math.inf
                return
            if reached:
                cells, tops, doubts = self._topped(number)
                places = np.flatnonzero(tops[side, channel] + shift * doubts[channel] > level)
                places = places[::-1] if last else places
                starts = [0, *range(FEW, len(places), TOGETHER)]
                for first, end_ in zip(starts, [*starts[1:], len(places)], strict=True):
                    begin, width = (x[places[first:end_], 0] for x in (cells.begin, cells.width))
                    if first:  # most of so many are not above in truth
                        parts = self.divide(begin, width, np.full(len(begin), channel))
                        top = parts.tops(1.0 - 2.0 * side)[1] + parts.room + shift * parts.doubt
                        begin, width = (x[(top > level).any(axis=0)] for x in (begin, width))
                    yield from zip(begin.tolist(), width.tolist(), strict=True)
        if not last and end > level:
            yield self.stop, 0.0

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

    def _within(
        self,
        begin: Floats,
        width: Floats,
        channel: Ints,
        sign: Floats,
        level: Floats,
        shift: Floats,
        *,
        last: bool,
    ) -> tuple[Floats, Floats, Floats]:
        """Find the outermost instants at which pieces of cells (Q,) are above levels.

        Returns the instants, NaN without one, and begin and width of what is left to be looked at;
        a begin of NaN says that nothing is.
        """
        found, rest = np.empty((len(CubicCells._fields), len(begin))), np.arange(len(begin))
        found[:2], barrier = (begin, width), np.full(len(begin), np.nan)
        for turn in range(DEEPEST):
            pieces = np.stack([*found[:2, rest], channel[rest]])  # several levels may ask for one
            asked, which = np.unique(pieces, axis=1, return_inverse=True)
            parts = self.divide(asked[0], asked[1], asked[2].astype(np.int64))
            parts = CubicCells(*(each[:, which] for each in parts))
            fine = (parts.room <= FINE * np.abs(level[rest])) | (turn == DEEPEST - 1)
            room = np.where(fine, shift[rest] * parts.room, parts.room)
            above = parts.tops(sign[rest])[1] + room + shift[rest] * parts.doubt > level[rest]
            pick = above.argmax(axis=0)
            if last:
                pick = len(above) - 1 - above[::-1].argmax(axis=0)
            nothing = ~above.any(axis=0)
            barrier[rest[nothing]] = (found[0] if last else found[0] + found[1])[rest[nothing]]
            found[:, rest] = parts.chosen(pick)
            rest = rest[~nothing & ~fine[pick, np.arange(len(pick))]]
            if not rest.size:
                break
        cells = CubicCells(*found)
        edges = _edges(cells, sign, level - shift * (cells.room + cells.doubt), last)
        time = cells.begin + cells.width * edges
        time[~np.isnan(barrier)] = np.nan
        left = barrier - begin if last else begin + width - barrier
        begin = np.where(left > SMALLEST * width, begin if last else barrier, np.nan)
        return time, begin, left

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
        for k, values in enumerate((cells.left - cells.room, -cells.left - cells.room)):
            at = values.argmax(axis=0)
            there = values[at, channels], doubts[channels, at], cells.begin[at, 0]
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
            parts, sign = self.divide(begin, width, channel), np.where(side, -1.0, 1.0)
            x, height = parts.tops(sign)
            fine = (parts.room <= self.level) | (turn == DEEPEST - 1)
            values = np.where(fine, height, sign * parts.left)
            for each in zip(values, parts.doubt, parts.begin + x * parts.width, strict=True):
                _raise(found, side, channel, *each)
            more = ~fine & (height + parts.room > found[0][side, channel] + self.level)
            bound = np.where(more, -math.inf, height + parts.room + parts.doubt)
            np.maximum.at(reach, (side, channel), bound.max(axis=0, initial=-math.inf))
            part, q = np.nonzero(more)
            if not part.size:
                break
            begin, width = parts.begin[part, q], parts.width[part, q]
            side, channel = side[q], channel[q]


def _raise(
    found: Floats, side: Ints, channel: Ints, height: Floats, doubt: Floats, time: Floats
) -> None:
    """Put heights (Q,) with their doubts and instants in the place of lower ones."""
    order = np.argsort(height)
    order = order[height[order] > found[0][side[order], channel[order]]]
    found[:, side[order], channel[order]] = np.stack([height, doubt, time])[:, order]


def _edges(cells: CubicCells, sign: Floats, level: Floats, last: bool) -> Floats:
    """Return where ``sign * cubic`` of cells (Q,) is last, or first, above levels, 0 to 1."""
    top, places = cells.tops(sign)[0], np.arange(PARTS + 1)[:, None] / PARTS
    low, high = (top + 0.0, np.ones(len(top))) if last else (np.zeros(len(top)), top + 0.0)
    every = np.arange(len(top))
    for _ in range(NARROWED):
        x = low + (high - low) * places
        up = sign * cells.at(x) > level
        # The last place that is above and the next one, or the first one and that before.
        k = PARTS - up[::-1].argmax(axis=0) if last else up.argmax(axis=0) - 1
        low, high = x[np.maximum(k, 0), every], x[np.minimum(k + 1, PARTS), every]
    return low if last else high
