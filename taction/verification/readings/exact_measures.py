"""Measurements of a stable linear board on its exact solution, without a sampled record.

Definitions and readings are those of `measure`. The solution is known for all time, so
nothing depends on the length or the points of a record, and every uncertainty follows from the
bound of the solution's own error.

The grid of its trace has segments of equal cells. In each of them the fastest mode above `detail`
sets the width; slower ones outlive it. Between two instants a mode ``share e^(p t)`` differs from
the cubic through its values and slopes by at most ``|share| e^(Re p t)`` times the lesser of
``|p h|^4 / 384`` and ``2 + 0.3 |p h|``.
"""

from __future__ import annotations

import bisect
import functools
import math
from dataclasses import dataclass
from typing import Literal

import numpy as np

from taction.system.array_types import EPS, Complexes, Floats, Ints
from taction.system.errors import EngineError
from taction.system.reading_definitions import FAINT, FOUND, SETTLING_BAND
from taction.verification.engines.statespace.linearised.linear_board import LinearBoard
from taction.verification.engines.statespace.linearised.time_scales import RINGS
from taction.verification.engines.statespace.transients.exact import (
    Exact,
    exact_solution,
    real_sums,
)
from taction.verification.readings.measurements import STILL, Measurements, channel_measure, summary
from taction.verification.readings.readings import Reading, Step, read
from taction.verification.readings.ringing import Mode
from taction.verification.readings.settling import ChannelState, Settlement
from taction.verification.readings.trace import PARTS, Asked, CubicCells, Trace

DETAIL = 1e-6  # of the settling band: the grid resolves modes above it
SHORT = "the channel never reaches the levels of its step"
FINENESS = 0.5  # width times |p| of the fastest mode of a segment: 13 points a period
NOISE = 0.1  # of the error bound: a rise by less does not matter to a maximum
DEAD = 3.0  # a cubic misses at most so many times the amplitude of a mode that has no points
CELLS, BLOCKS = 512, 96  # of a block, and so many blocks are looked at in one search
STRIDE = 4  # cells that have the same bounds

Piece = tuple[float, float, int]
"""Begin of equal cells, their width, s, and their number."""


class ExactTrace(Trace):
    """The channels ``u = sign V`` of a stable linear board as distances from their targets.

    `solution`: of the board; its nodes are the channels.
    `signs`, `target`: (K,): signs of the channels, and their reference steady state, V.
    `target_error`: error of the target, V, which adds to the bounds of the solution.
    `detail`: amplitude of a mode below which the grid does not resolve it, V.
    `level`: error that a maximum may have, V.
    """

    most = BLOCKS

    def __init__(
        self,
        solution: Exact,
        signs: Floats,
        target: Floats,
        target_error: float,
        detail: float,
        level: float = 0.0,
    ) -> None:
        flow = self.flow = solution.flow
        share, slopes = flow.share * signs, flow.derived() * signs
        self.both: Complexes = np.array([share.T, slopes.T])  # of values and slopes, (2, K, m)
        self.size, self.channels = np.abs(share), len(signs)
        self.largest = self.size.max(axis=1, initial=0.0)
        self.ends = np.asarray(solution.final * signs - target)
        self.end_bounds = solution.rest_error + target_error
        largest = float(np.abs([solution.start, solution.final]).max(initial=0.0))
        self.level = max(level, NOISE * (solution.error + target_error + EPS * largest))
        self.detail, self._caps = detail, dict[int, tuple[Floats, Floats]]()
        self._plan()

    def _plan(self) -> None:
        """Lay out the segments in blocks; a long segment has blocks of its own."""
        rates, speeds = self.flow.rates, self.flow.speeds
        loud = self.largest > self.detail
        death = np.log(self.largest[loud] / self.detail) / np.abs(rates[loud])
        order, begin = np.argsort(death), 0.0
        death, fastest = death[order], np.maximum.accumulate(speeds[loud][order][::-1])[::-1]
        # First block, number of blocks, and their pieces.
        self.runs: list[tuple[int, int, list[Piece]]] = []
        self.blocks, k, room = 0, 0, 0
        while k < len(death):
            last = max(k, int(np.searchsorted(-fastest, -0.5 * fastest[k])) - 1)
            length, k, speed = float(death[last]) - begin, last + 1, float(fastest[k])
            count = math.ceil(length * speed / FINENESS)
            if not count:
                continue
            piece = begin, length / count, count
            begin += length
            if count <= room:
                self.runs[-1][2].append(piece)
                room -= count
                continue
            number = -(-count // CELLS)
            self.runs.append((self.blocks, number, [piece]))
            self.blocks, room = self.blocks + number, CELLS - count
        self.stop = begin

    def _pieces(self, number: int) -> list[Piece]:
        """Return the pieces of a block."""
        nth = bisect.bisect_right(self.runs, number, key=lambda run: run[0]) - 1
        first, blocks, pieces = self.runs[nth]
        if blocks == 1:
            return pieces
        ((begin, width, count),), done = pieces, (number - first) * CELLS
        return [(begin + width * done, width, min(CELLS, count - done))]

    def block(self, number: int) -> CubicCells:
        """See `Trace`."""
        parts = [self._segment(*piece) for piece in self._pieces(number)]
        return CubicCells(*map(np.concatenate, zip(*parts, strict=True)))

    def _segment(self, begin: float, width: float, count: int) -> CubicCells:
        """Return equal cells, from the modes that are above `detail` at their begin."""
        flow, times = self.flow, begin + width * np.arange(count + 1.0)
        weight = self.largest * np.exp(flow.rates * begin)
        live = weight > self.detail
        dead = DEAD * (np.exp(flow.rates[~live] * begin) @ self.size[~live])
        row = math.isqrt(count) + 1
        basis = flow.on_grids(times[::row], np.array([width]), row, live)
        basis = basis.reshape(-1, basis.shape[2])[: len(times)]
        values, slopes = real_sums(basis, self.both[:, :, live])
        missed = _missed(width * flow.speeds[live])
        some = times[:-1:STRIDE]  # what bounds the cells there bounds those up to the next, too
        room = np.exp(np.outer(some, flow.rates[live])) @ (missed[:, None] * self.size[live]) + dead
        doubt = self._doubt(some, some + STRIDE * width)
        room, doubt = (np.repeat(each, STRIDE, axis=0)[:count] for each in (room, doubt))
        values, slopes = values + self.ends, slopes * width
        sides = values[:-1], values[1:], slopes[:-1], slopes[1:]
        return CubicCells(times[:-1, None], np.full((count, 1), width), *sides, room, doubt)

    def _doubt(self, begin: Floats, end: Floats) -> Floats:
        """Bound the error of the values between instants (P,), V, (P, K)."""
        rates, lag, vague, omitted = self.flow.bound_terms
        left = np.exp(np.outer(begin, rates))
        return np.asarray(end[:, None] * (left @ lag) + left @ vague + omitted + self.end_bounds)

    def cap(self, number: int) -> tuple[Floats, Floats]:
        """See `Trace`; the bounds hold from the block on."""
        if number not in self._caps:
            begin = self.stop if number >= self.blocks else self._pieces(number)[0][0]
            left = np.exp(self.flow.rates * begin) @ self.size
            rates, lag, vague, omitted = self.flow.bound_terms
            latest = np.maximum(begin, 1.0 / np.abs(rates))  # where ``t e^(r t)`` is largest
            doubt = (latest * np.exp(rates * latest)) @ lag + np.exp(rates * begin) @ vague
            caps = np.stack([left + self.ends, left - self.ends])
            self._caps[number] = caps, doubt + omitted + self.end_bounds
        return self._caps[number]

    def last_blocks(self, asked: Asked) -> Ints:
        """See `Trace`; by bisection, because the caps fall."""
        low, high = np.zeros(len(asked.side), np.int64), np.full(len(asked.side), self.blocks)
        while (left := np.flatnonzero(low < high)).size:
            middle = (low + high) // 2
            some = left[middle[left] == middle[left[0]]]
            later = self.reached(int(middle[left[0]]), asked.chosen(some))
            low[some], high[some] = np.where(
                later, (middle[some] + 1, high[some]), (low[some], middle[some])
            )
        return low - 1

    def divide(self, begin: Floats, width: Floats, channel: Ints) -> CubicCells:
        """See `Trace`."""
        flow, part = self.flow, width / PARTS
        times = begin + np.multiply.outer(np.arange(PARTS + 1), part)
        live = flow.slowest(float(begin.min()))
        basis = flow.on_grids(begin, part, PARTS + 1, live)
        share = self.both[:, channel, live].transpose(1, 0, 2)
        values, slopes = real_sums(basis, share).transpose(2, 1, 0)
        values, slopes = values + self.ends[channel], slopes * part
        size = np.exp(np.outer(begin, flow.rates)) * self.size[:, channel].T
        missed = _missed(np.outer(part, flow.speeds))
        room = np.broadcast_to((size * missed).sum(axis=1), (PARTS, len(begin)))
        doubt = self._doubt(begin, begin + width)[np.arange(len(begin)), channel]
        doubt = np.broadcast_to(doubt, room.shape)
        sides = values[:-1], values[1:], slopes[:-1], slopes[1:]
        return CubicCells(times[:-1], np.broadcast_to(part, room.shape), *sides, room, doubt)


def _missed(angle: Floats) -> Floats:
    """Bound what the cubic of a mode of size 1 misses; `angle` is its |p| times the width."""
    return np.minimum(angle**4 / 384.0, 2.0 + 0.3 * angle)


@dataclass(frozen=True, eq=False)
class ExactResponse:
    """The step response of a linear board, to be measured."""

    board: LinearBoard  # a board without behavioural amplifiers
    target: Floats  # (N,): reference steady state of u, V
    # (N,): u before the step, V; the default is the start of the solution.
    start: Floats | None = None
    # `initial`, `band`: as in `taction.netlist_gen.analysis.Transient` and `measurements.measure`.
    initial: Literal["zero", "rest"] = "zero"
    band: float = SETTLING_BAND
    target_error: float = 0.0  # bound of the error of a channel's distance from `target`, V
    # Error that an excursion may have, fraction of A; with 0 only that of rounding.
    level: float = FOUND

    @functools.cached_property
    def signs(self) -> Floats:
        """Signs of the channels, (N,)."""
        return np.array([output.sign for output in self.board.circuit.outputs])

    @functools.cached_property
    def solution(self) -> Exact:
        """The solution; EngineError as `exact_solution`, and of a board that is not stable."""
        solution = exact_solution(self.board, initial=self.initial)
        if not np.all(solution.poles.real < 0.0):
            raise EngineError("the board is not stable: its transient has no end to measure")
        return solution

    @functools.cached_property
    def step(self) -> Step:
        """The step of the channels."""
        begin = self.solution.start * self.signs if self.start is None else self.start
        return Step(begin, self.target)

    @functools.cached_property
    def tolerance(self) -> float:
        """Half the width of the settling band, V."""
        off = float(np.abs(self.solution.final * self.signs - self.target).max(initial=0.0))
        return self.band * (self.step.amplitude or off or 1.0)

    @functools.cached_property
    def trace(self) -> ExactTrace:
        """The way of the channels to their targets."""
        detail, level = DETAIL * self.tolerance, self.level * self.step.amplitude
        error = self.target_error
        return ExactTrace(self.solution, self.signs, self.target, error, detail, level)

    def measured(self) -> Measurements:
        """Measure the step response; EngineError as `solution`."""
        nothing_lost = np.zeros(len(self.target), dtype=np.bool_)
        step, bounds = self.step, self.solution.rest_error + self.target_error
        readings = read(self.trace, step, self.tolerance, nothing_lost)
        modes, channels = _modes(self.solution, step.amplitude), []
        finals = (self.solution.final * self.signs).tolist()
        for n, (final, reading) in enumerate(zip(finals, readings["settling_time"], strict=True)):
            off, bound = float(self.trace.ends[n]), float(bounds[n])
            settlement = STILL
            if step.amplitude:
                settlement = _settlement(off, self.tolerance, bound, reading)
            channels.append(channel_measure(n, final, step, readings, settlement, modes, SHORT))
        return summary(step.amplitude, self.band, modes, channels)


def _settlement(off: float, tolerance: float, bound: float, reading: Reading | None) -> Settlement:
    """Return whether a channel that comes to rest `off` its target, V, settles."""
    if abs(off) > tolerance + bound:
        reason = f"the final value and the reference solution disagree by {off!r} V"
        return Settlement(ChannelState.NOT_SETTLED, None, reason)
    if reading is None or not math.isfinite(reading.uncertainty):
        reason = (
            f"the final value is {off!r} V off, known to ±{bound:.2g} V: at the edge of the band"
        )
        return Settlement(ChannelState.UNDECIDED, None, reason)
    return Settlement(ChannelState.SETTLED, reading, "")


def _modes(solution: Exact, amplitude: float) -> tuple[Mode, ...]:
    """Return the ringing modes, strongest first, with amplitudes at t = 0 and no uncertainty."""
    modes, flow = [], solution.flow
    begin = flow.powers == 0
    for pole, row in zip(flow.poles[begin].tolist(), np.abs(flow.share[begin]), strict=True):
        strong = float(row.max(initial=0.0)) > FAINT * amplitude
        if strong and pole.imag > 0.0 and -pole.real < RINGS * abs(pole):
            modes.append(Mode(pole.imag / (2.0 * math.pi), pole.real, tuple(row.tolist())))
    return tuple(sorted(modes, key=lambda mode: -max(mode.channels)))
