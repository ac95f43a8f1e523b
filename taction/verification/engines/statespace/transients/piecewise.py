"""Transients of boards of piecewise linear amplifiers: exact between the switches.

The right-hand side of a board with a continuous g is Lipschitz continuous, so one solution passes
through every state: it neither slides along a break nor chatters there, and nothing is looked for.
Only an amplifier that drives its own input without any delay, by a gain above 1, makes the
equations ambiguous, as a Schmitt trigger's are; each `ActiveSet` refuses that in words.

The error of a switch's instant has no first-order effect, as both pieces move alike at the break.
So the errors of the states (rounding of the modes, of the equilibria, the slack of the breaks) pass
the switches unchanged, and follow the product of the pieces' matrix exponentials.
"""

from __future__ import annotations

import functools
import time as clock
from collections.abc import Iterable

import numpy as np

from taction.netlist_gen.analysis import Transient
from taction.system.array_types import EPS, Floats, Indices
from taction.system.errors import DivergesError, EngineError
from taction.system.frozen import frozen
from taction.system.quantities import show
from taction.system.waveforms import Cost, Waveforms
from taction.verification.engines.statespace.linearised.board import LinearBoard, initial_unknowns
from taction.verification.engines.statespace.transients.record_times import ESCAPED, record_times
from taction.verification.engines.statespace.transients.switching import (
    ActiveSet,
    Piece,
    Segments,
    breaks_of,
    same_board,
)

METHOD = "exact in pieces"
MOST_SWITCHES = 2000
WIDEST = 8  # columns of the errors for each state, above which they are added up
RETURNED = 1e-6  # of the largest state: two switches at the same point of a cycle
FOLLOWED = 100  # switches after the end of an unstable board's record, to find its limit cycle
LATER = 30.0  # times the record of an unstable board
ROOM = 1e-3  # of the largest state: the least extent of a cycle


def is_piecewise(board: LinearBoard) -> bool:
    """Whether all amplifiers of a small board are piecewise linear: then it is solved exactly."""
    return not board.descriptor.is_large and breaks_of(board.descriptor.devices) is not None


@frozen
class LimitCycle:
    """A transient that repeats itself.

    Attributes
    ----------
    begin, period : float
        s.
    switches : int
        In one period.
    multiplier : float
        By which a disturbance changes in one period, beside a shift in time: below 1 the cycle is
        stable.
    """

    begin: float
    period: float
    switches: int
    multiplier: float


@frozen(eq=False, slots=False)
class PiecewiseCurve:
    """Voltages of the reported nodes over time, piece by piece.

    Attributes
    ----------
    pieces : tuple of Piece
        In the order of time.
    stop : float
        End of the last piece, s.
    escaped : bool
        Whether the board left every bound there.
    """

    pieces: tuple[Piece, ...]
    stop: float
    escaped: bool

    @functools.cached_property
    def begins(self) -> Floats:
        """When each piece begins, s."""
        return np.array([piece.begin for piece in self.pieces])

    def _each(self, times: Floats) -> Iterable[tuple[Piece, Indices]]:
        where = np.maximum(np.searchsorted(self.begins, times, side="right") - 1, 0)
        for k in np.unique(where).tolist():
            yield self.pieces[k], np.flatnonzero(where == k)

    def at(self, times: Floats) -> Floats:
        """Return the voltages of all nodes, V, (P, K)."""
        values = np.empty((len(times), len(self.pieces[0].nodes)))
        for piece, some in self._each(times):
            values[some] = piece.outputs(times[some] - piece.begin)
        return values

    def bounds(self, times: Floats) -> Floats:
        """Bound the errors of `at`, V, (P, K)."""
        values = np.empty((len(times), len(self.pieces[0].nodes)))
        for piece, some in self._each(times):
            values[some] = piece.bounds(times[some] - piece.begin)[:, piece.count :]
        return values

    def __call__(self, times: Floats, columns: Indices) -> Floats:
        """Return voltages (Q,)."""
        instants, place = np.unique(times, return_inverse=True)
        return np.asarray(self.at(instants)[place, columns])

    @property
    def lengths(self) -> Floats:
        """How long each piece lasts, s."""
        return np.diff(np.append(self.begins, self.stop))

    def limit_cycle(self) -> LimitCycle | None:
        """Return the cycle in which the transient ends, or None."""
        last = len(self.pieces) - 1
        x, key = self.pieces[last].x, self.pieces[last].active.segments
        size = max(float(np.abs(piece.x).max(initial=0.0)) for piece in self.pieces)
        for k in range(last - 1, -1, -1):
            piece = self.pieces[k]
            if piece.active.segments != key or np.abs(piece.x - x).max() > RETURNED * size:
                continue
            inner = self.pieces[k:last]
            extent = max(float(np.abs(each.x - x).max()) for each in inner)
            if extent < ROOM * size:
                return None
            product = np.eye(len(x))
            for each, length in zip(inner, self.lengths[k:last].tolist(), strict=True):
                product = each.transition(length) @ product
            factors = np.sort(np.abs(np.linalg.eigvals(product)))[::-1]
            shift = int(np.argmin(np.abs(factors - 1.0)))  # of a shift in time
            others = np.delete(factors, shift)
            period = float(self.begins[last] - self.begins[k])
            return LimitCycle(float(self.begins[k]), period, last - k, float(others[0]))
        return None


class _SwitchedRun:
    """The switches of one transient."""

    def __init__(self, board: LinearBoard, nodes: tuple[str, ...]) -> None:
        self.descriptor = same_board(board.descriptor)
        found = breaks_of(self.descriptor.devices)
        if found is None:
            raise EngineError("not all amplifiers are piecewise linear")
        self.breaks, self.nodes = found, nodes
        self._known: dict[Segments, ActiveSet] = {}

    def active(self, segments: Segments) -> ActiveSet:
        """Return an active set; each is linearised once."""
        if segments not in self._known:
            self._known[segments] = ActiveSet.of(self.descriptor, self.breaks, segments)
        return self._known[segments]

    def start(self, z: Floats, *, bounded: bool) -> Piece:
        """Return the first piece from unknowns (size,) just before the strain."""
        inputs, seen = z[self.descriptor.devices.input], set[Segments]()
        while True:
            segments = self._segments(inputs)
            if segments in seen:
                raise EngineError(
                    "the amplifiers have no unique start: one drives its own input without delay"
                )
            seen.add(segments)
            active = self.active(segments)
            x = active.space.state_of(z)
            errors = np.diag(EPS * np.abs(x)) if bounded else np.zeros((len(x), 0))
            piece = Piece.of(active, 0.0, x, errors, self.nodes)
            inputs = piece.at(np.zeros(1))[0, : piece.count]
            slack = piece.slack
            if np.all((inputs >= active.low - slack) & (inputs <= active.high + slack)):
                return piece

    def _segments(self, inputs: Floats) -> Segments:
        pairs = zip(self.breaks, inputs.tolist(), strict=True)
        return tuple(int(np.searchsorted(breaks, y, side="right")) for breaks, y in pairs)

    def after(self, piece: Piece, length: float) -> Piece:
        """Return the piece that follows a switch."""
        who, steps = piece.passing(length)
        segments = list(piece.active.segments)
        for k, step in zip(who.tolist(), steps.tolist(), strict=True):
            segments[k] += step
        active = self.active(tuple(segments))
        x, errors = piece.state_at(length)
        z = piece.active.unknowns(x)
        if errors.shape[1] > WIDEST * len(x):
            errors = np.diag(np.abs(errors).sum(axis=1))
        through = active.charge @ piece.active.space.C
        begin, x = piece.begin + length, active.space.state_of(z)
        return Piece.of(active, begin, x, through @ errors, self.nodes, piece.slack)


def solve_pieces(
    board: LinearBoard,
    analysis: Transient,
    nodes: tuple[str, ...],
    stop: float,
    *,
    bounded: bool = True,
) -> PiecewiseCurve:
    """Follow a transient from switch to switch up to `stop`, s.

    Without `bounded` the errors are not followed, and the transient ends after `FOLLOWED` switches.

    Raises
    ------
    EngineError
        An active set has no state space or no equilibrium, or there are more than `MOST_SWITCHES`
        switches.
    """
    run = _SwitchedRun(board, nodes)
    unknowns = initial_unknowns(board, analysis.initial, analysis.voltages)
    devices = board.descriptor.devices
    known = np.concatenate([board.equilibrium.values, unknowns, devices.u_scale, devices.v_scale])
    limit = ESCAPED * (float(np.abs(known).max()) or 1.0)
    piece, pieces = run.start(unknowns, bounded=bounded), list[Piece]()
    for _ in range(MOST_SWITCHES if bounded else FOLLOWED):
        pieces.append(piece)
        left = stop - piece.begin
        escape = _escape(piece, left, limit)
        length = piece.ends(left if escape is None else escape)
        if length is None or piece.begin + length >= stop:
            end = stop if escape is None else piece.begin + escape
            return PiecewiseCurve(tuple(pieces), end, escape is not None)
        piece = run.after(piece, length)
    if not bounded:
        return PiecewiseCurve(tuple(pieces), piece.begin, False)
    raise EngineError(
        f"the amplifiers switch more than {MOST_SWITCHES} times before {show(piece.begin, 's')} of"
        f" {show(stop, 's')}; a shorter analysis.stop ends the record earlier"
    )


def _escape(piece: Piece, left: float, limit: float) -> float | None:
    """Return when a growing piece certainly exceeds `limit`, V, if that is before `left`, s."""
    grows = np.flatnonzero(piece.flow.rates > 0.0)
    if not grows.size:
        return None
    times = np.linspace(0.0, left, 2049)
    with np.errstate(over="ignore", invalid="ignore"):
        size = np.abs(piece.at(times)).max(axis=1)
    beyond = np.flatnonzero(~(size <= limit))
    return float(times[beyond[0]]) if beyond.size else None


def simulate(
    board: LinearBoard,
    analysis: Transient,
    *,
    nodes: Iterable[str] | None = None,
    times: Floats | None = None,
) -> Waveforms:
    """Simulate a transient; parameters as `simulate.simulate`.

    Raises
    ------
    DivergesError
        The board diverges before the last of `times`; the exception has the record.
    EngineError
        As `solve_pieces`.
    """
    began, stop = clock.perf_counter(), analysis.stop if times is None else float(times[-1])
    curve = solve_pieces(board, analysis, board.reported(nodes), stop)
    instants = record_times(analysis, curve.stop, times)
    flags: tuple[str, ...] = ()
    if curve.escaped:
        flags = (f"the board diverges: it leaves every bound at {show(curve.stop, 's')}",)
    cycle = None if curve.escaped else _cycle(board, analysis, curve)
    if cycle is not None:
        flags += (describe(cycle),)
    values = curve.at(instants)
    with np.errstate(invalid="ignore", over="ignore"):
        rounding = float(np.nan_to_num(curve.bounds(instants), nan=np.inf).max(initial=0.0))
    cost = Cost(clock.perf_counter() - began, len(instants), len(curve.pieces))
    record = Waveforms(
        instants, board.reported(nodes), values, "statespace", cost, flags, rounding,
        curve=curve, method=METHOD,
    )  # fmt: skip
    if curve.escaped and times is not None:
        raise DivergesError(flags[0], record)
    return record


def _cycle(board: LinearBoard, analysis: Transient, curve: PiecewiseCurve) -> LimitCycle | None:
    """Return the limit cycle of a transient, also one that an unstable board reaches later."""
    found = curve.limit_cycle()
    if found is None and board.state_space.modes.poles[0].real > 0.0:
        later = LATER * curve.stop
        curve = solve_pieces(board, analysis, curve.pieces[0].nodes, later, bounded=False)
        found = None if curve.escaped else curve.limit_cycle()
    return found


def describe(cycle: LimitCycle) -> str:
    """Return a sentence about a limit cycle."""
    sure = "stable" if cycle.multiplier < 1.0 else "unstable"
    return (
        f"a {sure} limit cycle from {show(cycle.begin, 's')} on: period"
        f" {show(cycle.period, 's')}, {cycle.switches} switches a period; a disturbance becomes"
        f" {cycle.multiplier:.3g} times as large in a period"
    )
