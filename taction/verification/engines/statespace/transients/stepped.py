"""Transients of boards without an exact solution: with amplifiers, or with many unknowns.

The reported voltage of an amplifier's output is g of its interpolated input, so that a small
voltage keeps its relative accuracy.
"""

from __future__ import annotations

import math
import time as clock
from collections.abc import Hashable, Iterable, Sequence
from copy import copy
from dataclasses import dataclass, field, replace
from typing import Any
from weakref import WeakKeyDictionary

import numpy as np

from taction.netlist_gen.analysis import Transient
from taction.netlist_gen.board.circuit import Circuit
from taction.system.array_types import EPS, Floats, Indices, Ints
from taction.system.errors import DivergesError, EngineError
from taction.system.quantities import show
from taction.system.waveforms import Cost, Waveforms
from taction.verification.engines.statespace.equations.alike import of_one_kind
from taction.verification.engines.statespace.equations.amplifier_gains import OPAMP_KINDS
from taction.verification.engines.statespace.linearised.board import LinearBoard, initial_unknowns
from taction.verification.engines.statespace.linearised.modes import Modes
from taction.verification.engines.statespace.transients.dense import Dense
from taction.verification.engines.statespace.transients.integrator import Present, RadauIntegrator
from taction.verification.engines.statespace.transients.radau import NODES, STAGES, TABLE
from taction.verification.engines.statespace.transients.record_times import ESCAPED, record_times
from taction.verification.engines.statespace.transients.small_steps import (
    SmallBoards,
    StateBoard,
    is_basis,
)
from taction.verification.engines.statespace.transients.steps import Amplifiers, Boards
from taction.verification.engines.statespace.transients.straight_pieces import (
    LimitCycle,
    limit_cycle,
)
from taction.verification.engines.statespace.transients.structured_steps import StructuredBoard

METHOD = "Radau IIA"
TOLERANCE = 1e-9  # of a step, in step amplitudes
FLOOR = 1e-3  # of the board's largest voltage: the least voltage to which errors are relative
REPEATED = 1.0 / 16.0  # of the tolerance: what a second run leaves of its iterations
FOLLOWED, LATER = 100, 30.0  # switches, times the record: how far a limit cycle is looked for
FINER = 2.0**-STAGES  # of the tolerance: that of half the steps
# Of the coefficients of a board, relative. Between straight pieces no amplifier makes a slow mode
# faster, so the rounding of all its life adds up.
ROUNDED = {False: EPS, True: 4.0 * EPS}
FIRST = 2.0**-16  # of the record: the first step tried
BETWEEN = 2e-8  # of the step amplitude: error of a cubic between points of a record
MOVE = 0.02  # of the step amplitude: largest change between two points
FEWEST, MOST_PARTS = 200.0, 1000.0  # points of a record, and of a step
# Fourth derivatives of the Legendre polynomials of ``2 theta - 1``, at their largest.
BENDS = np.array([
    0.0 if n < 4 else math.factorial(n + 4) / (24.0 * math.factorial(n - 4))
    for n in range(STAGES + 1)
])  # fmt: skip
BESIDE = 1e-3  # the same as `TOLERANCE` of nodes that are watched beside, in their own amplitudes


class ReportedOutputs:
    """Reported nodes: the output of an amplifier by its input, other nodes themselves.

    Nodes `beside` come after them; their errors count by `weights`, (R, others). Several boards
    report the same nodes; `resting` are theirs, V, (R, nodes).
    """

    def __init__(
        self, board: LinearBoard, nodes: tuple[str, ...], beside: tuple[str, ...] = ()
    ) -> None:
        devices, rest = board.descriptor.devices, board.equilibrium
        self.amplifiers, self.nodes, self.beside = Amplifiers(devices), nodes, beside
        device = {int(place): k for k, place in enumerate(devices.output)}
        source = [device.get(board.descriptor.place(name), -1) for name in nodes]
        self.source = np.array([*source, *[-1] * len(beside)], dtype=np.int64)
        others = [name for name, k in zip(nodes, source, strict=True) if k < 0]
        self.others = (*others, *beside)
        self.weights = np.ones((1, len(self.others)))
        self.resting = np.array([[rest[name] for name in (*nodes, *beside)]])
        self.linear = np.ones(devices.count, dtype=np.bool_)
        self.linear[self.source[self.source >= 0]] = False

    @classmethod
    def joined(cls, several: Sequence[ReportedOutputs]) -> ReportedOutputs:
        """Return those of several boards together."""
        found = copy(several[0])
        found.amplifiers = Amplifiers.joined([each.amplifiers for each in several])
        found.resting = np.concatenate([each.resting for each in several])
        found.weights = np.concatenate([each.weights for each in several])
        return found

    def part(self, rows: Ints) -> ReportedOutputs:
        """Return the same of some boards."""
        found = copy(self)
        found.amplifiers, found.resting = self.amplifiers.part(rows), self.resting[rows]
        found.weights = self.weights[rows]
        return found

    def volts(self, inputs: Floats) -> Floats:
        """Return reported volts for a volt of each watched voltage, at inputs (R, m, s); (R, W).

        The inputs of amplifiers that are not reported count as volts themselves.
        """
        slopes = np.abs(self.amplifiers.slopes(inputs)).max(axis=2, initial=0.0)
        # An input on a flat piece counts, too: it decides when the amplifier leaves the piece.
        slopes = np.maximum(slopes, self.amplifiers.steepest())
        seen = np.where(self.linear, np.maximum(self.amplifiers.steepest(), 1.0), slopes)
        if not self.others:
            return seen
        return np.concatenate([seen, self.weights], axis=1)

    def voltages(self, watched: Floats) -> Floats:
        """Return the voltages of the nodes for watched voltages (R, W), or (P, W) of one board."""
        m = self.amplifiers.count
        voltages = np.empty((len(watched), len(self.source)))
        by_input = self.source >= 0
        voltages[:, ~by_input] = watched[:, m:]
        outputs = self.amplifiers.outputs(watched[:, :m, None])[:, :, 0]
        voltages[:, by_input] = outputs[:, self.source[by_input]]
        return voltages

    def distance(self, watched: Floats) -> Floats:
        """Return the largest distance of a reported voltage from rest, V, (R,)."""
        away = np.abs(self.voltages(watched) - self.resting)[:, : len(self.nodes)]
        return np.asarray(away.max(axis=1, initial=0.0))


@dataclass(frozen=True, eq=False)
class SteppedRun:
    """One integration of a board, with what another one of it needs."""

    name: str  # of the board
    board: StateBoard | StructuredBoard
    modes: Modes | None  # of a board at its slopes at rest, where they are a basis for the steps
    reported: ReportedOutputs
    state: Floats
    start: Floats
    slopes: Floats
    tolerance: float  # of a step, V
    unit: float  # the step amplitude, V
    base: float  # s
    limit: float  # V
    stop: float  # s

    @classmethod
    def of(cls, task: Task) -> SteppedRun:
        """Prepare the integration of a task."""
        board, analysis, beside = task.board, task.analysis, task.beside
        nodes, tolerance, stop = board.reported(task.nodes), task.tolerance, task.stop
        reported = ReportedOutputs(board, nodes, beside)
        unknowns = initial_unknowns(board, analysis.initial, analysis.voltages)
        equations, slopes, modes = _equations(board, reported, unknowns)
        state, start = equations.start(equations.state(unknowns), reported.amplifiers)
        amplitude = float(reported.distance(start[None])[0])
        devices = board.descriptor.devices
        inner = np.array([kind in OPAMP_KINDS for kind in devices.kinds], dtype=np.bool_)
        sizes = np.maximum(np.abs(board.equilibrium.values), np.abs(unknowns))
        largest = max(
            float(np.delete(sizes, devices.output[inner]).max(initial=0.0)),
            float(np.abs(start).max(initial=0.0)),
            float(devices.u_scale[~inner].max(initial=0.0)),
        )
        unit = max(amplitude, FLOOR * largest) or 1.0
        if beside:
            away = np.abs(reported.voltages(start[None]) - reported.resting)[:, len(nodes) :]
            allowed = BESIDE * max(float(away.max()), FLOOR * largest)
            reported.weights[:, -len(beside) :] = min(tolerance * unit / allowed, 1.0)
        # Every mode has a part of the largest voltage: its rounding must not move an amplifier.
        finest = tolerance * float(devices.v_scale[~inner].min(initial=np.inf))
        if finest < EPS * largest and isinstance(equations, StateBoard):
            equations, modes = StateBoard(board.open_loop, reported.others, slopes), None
        return cls(
            board.circuit.name, equations, modes, reported, state, start, slopes, tolerance * unit,
            unit, stop * FIRST, ESCAPED * (largest or 1.0), stop,
        )  # fmt: skip

    def perturbed(self) -> SteppedRun:
        """Return the run of a board whose coefficients are moved by their rounding."""
        if isinstance(self.board, StructuredBoard):
            return self
        bent = self.reported.amplifiers.pieces is not None
        return replace(self, board=self.board.perturbed(ROUNDED[bent]))

    @property
    def kind(self) -> tuple[Hashable, ...]:
        """What boards have in common that are integrated together."""
        if isinstance(self.board, StructuredBoard):
            return (id(self),)
        devices, source = self.reported.amplifiers.kinds, tuple(self.reported.source.tolist())
        joined = None if self.modes is None else tuple(np.flatnonzero(~self.modes.alone).tolist())
        return devices, source, len(self.state), len(self.start), joined


def _equations(
    board: LinearBoard, reported: ReportedOutputs, unknowns: Floats
) -> tuple[StateBoard | StructuredBoard, Floats, Modes | None]:
    """Return the equations, the slopes of the first steps, and the modes to work in.

    The slopes are the smaller of start and rest.
    """
    slopes = board.equilibrium.slopes
    if board.descriptor.is_large:
        return StructuredBoard(board, reported.others), slopes, None
    inputs = unknowns[None, board.descriptor.devices.input, None]
    first = reported.amplifiers.slopes(inputs)[0, :, 0]
    least = np.where(np.abs(first) < np.abs(slopes), first, slopes)
    space, modes = board.open_loop, board.state_space.modes
    known = is_basis(modes) and space.states == board.state_space.states
    return StateBoard(space, reported.others, slopes), least, modes if known else None


def integrate(runs: Sequence[SteppedRun], whole: Sequence[Dense] = ()) -> list[Dense]:
    """Integrate boards up to their stops, those of one kind together, by half the steps of `whole`.

    Where amplifiers have straight pieces, steps end at other instants; those of a second run are at
    most half as long at each. An output has a `failure` where there is no solution.
    """
    found: dict[int, Dense] = {}
    for places in of_one_kind({place: run.kind for place, run in enumerate(runs)}):
        some, first = [runs[place] for place in places], [whole[k] for k in places if whole]
        bent = some[0].reported.amplifiers.pieces is not None
        work = _integrator(some, 1.0 if not whole else FINER if bent else REPEATED)
        if whole and not bent:
            outs = work.repeat([[level - 1 for level in x.levels for _ in "ab"] for x in first])
        else:
            work.caps = first
            outs = work.run(np.array([run.stop for run in some]))
        found.update(zip(places, outs, strict=True))
    return [found[place] for place in range(len(runs))]


def _integrator(runs: Sequence[SteppedRun], share: float) -> RadauIntegrator:
    """Return an integrator at the start of boards of one kind."""
    state = np.stack([run.state for run in runs])
    boards: Boards
    start: Any = state
    if isinstance(runs[0].board, StructuredBoard):
        boards = runs[0].board
    else:
        states = [run.board for run in runs if isinstance(run.board, StateBoard)]
        boards = small = SmallBoards(states, [run.modes for run in runs if run.modes is not None])
        start = small.state(state)
    present = Present(
        start,
        np.stack([run.start for run in runs]),
        np.stack([run.slopes for run in runs]),
        *np.array([(share * run.tolerance, run.unit, run.base, run.limit) for run in runs]).T,
    )
    return RadauIntegrator(boards, ReportedOutputs.joined([run.reported for run in runs]), present)


@dataclass(frozen=True, slots=True, eq=False)
class SteppedCurve:
    """Voltages of nodes (Q,) at instants (Q,), from the polynomials of the steps."""

    run: SteppedRun
    dense: Dense
    seconds: float  # that it cost
    halves: list[Dense] = field(default_factory=list)  # of half the steps, once it is known

    def at(self, times: Floats) -> Floats:
        """Return the voltages of all nodes, those beside the last, shape (P, nodes)."""
        return self.run.reported.voltages(self.dense.at(times))

    def __call__(self, times: Floats, columns: Indices) -> Floats:
        """Return voltages (Q,)."""
        instants, place = np.unique(times, return_inverse=True)
        return np.asarray(self.at(instants)[place, columns])

    def points(self) -> Floats:
        """Return instants between which a cubic through the reported voltages errs by `BETWEEN`, s.

        Every step is divided evenly. How often follows from the fourth derivatives of the voltages
        and from their changes in it, so that all that the steps resolve is seen at the instants.
        """
        reported, ends = self.run.reported, np.array(self.dense.ends)
        at_nodes = np.stack(self.dense.pieces) @ np.linalg.inv(TABLE.legendre).T  # (S, W, s + 1)
        flat = at_nodes.transpose(0, 2, 1).reshape(-1, at_nodes.shape[1])
        values = reported.voltages(flat)[:, : len(reported.nodes)]
        pieces = np.abs(TABLE.legendre @ values.reshape(len(at_nodes), NODES.size, -1))
        away = np.abs(values - reported.resting[:, : len(reported.nodes)])
        # As in the steps, growing voltages count by their size.
        unit = np.maximum(self.run.unit, away.reshape(len(at_nodes), -1).max(axis=1))
        bend = (pieces * BENDS[:, None]).sum(axis=1).max(axis=1)
        parts = (3.0 / 128.0 * bend / (BETWEEN * unit)) ** 0.25
        parts = np.maximum(parts, 2.0 * pieces[:, 1:].sum(axis=1).max(axis=1) / (MOVE * unit))
        parts = np.maximum(parts, FEWEST * np.diff(ends) / ends[-1])
        count = np.ceil(np.clip(parts, 2.0, MOST_PARTS)).astype(np.int64)
        step = np.repeat(np.arange(len(count)), count)
        share = (np.arange(len(step)) - np.repeat(np.cumsum(count) - count, count)) / count[step]
        found = np.append(ends[step] + share * np.diff(ends)[step], ends[-1])
        stop = min(self.run.stop, ends[-1])
        return np.append(found[found < stop * (1.0 - 1e-12)], stop)


def simulate(
    circuit: Circuit | LinearBoard,
    analysis: Transient,
    *,
    nodes: Iterable[str] | None = None,
    times: Floats | None = None,
    tolerance: float = TOLERANCE,
    beside: tuple[str, ...] = (),
    resolved: bool = False,
) -> Waveforms:
    """Simulate a transient by steps.

    Parameters
    ----------
    circuit, analysis, nodes, times
        See `simulate.simulate`; the error estimate controls the step.
    tolerance : float
        Of one step and of the solution within it, in step amplitudes.
    beside : tuple of str
        Further nodes that the curve of the record has, to `BESIDE`.
    resolved : bool
        Whether the record has the points of the solution instead, up to the last of `times`.

    Returns
    -------
    Waveforms
        The record of a board that diverges ends early, beyond any physical bound.

    Raises
    ------
    DivergesError
        The board diverges before the last of `times`; the exception has the record.
    EngineError
        No equilibrium, no state space, or the solution leaves the range of floats.
    """
    board = LinearBoard.of(circuit)
    (found,) = simulate_together([Task(board, analysis, nodes, times, tolerance, beside, resolved)])
    if isinstance(found, EngineError):
        raise found
    return found


@dataclass(frozen=True, slots=True, eq=False)
class Task:
    """What `simulate` gets."""

    board: LinearBoard
    analysis: Transient
    nodes: Iterable[str] | None = None
    times: Floats | None = None
    tolerance: float = TOLERANCE
    beside: tuple[str, ...] = ()
    resolved: bool = False

    @property
    def stop(self) -> float:
        """The end of the record, s."""
        last = self.analysis.stop if self.times is None else float(self.times[-1])
        same = math.isclose(last, self.analysis.stop, rel_tol=1e-12)
        return self.analysis.stop if same else last

    @property
    def key(self) -> Hashable:
        """What two tasks of a board have in common that need one integration."""
        start, nodes = self.analysis.initial, self.board.reported(self.nodes)
        voltages = tuple((self.analysis.voltages or {}).items())
        return start, voltages, nodes, self.beside, self.tolerance, self.stop

    def record(self, curve: SteppedCurve) -> Waveforms:
        """Return the record of an integration; errors as `simulate`."""
        run, dense = curve.run, curve.dense
        ended = min(dense.checked(run.name).ends[-1], self.stop)
        diverges = f"the board diverges: it passes {run.limit:.3g} V at {show(ended, 's')}"
        instants = record_times(self.analysis, ended, self.times)
        if self.resolved:
            instants = curve.points()
        flags = (diverges,) * dense.escaped
        cycle = None if dense.escaped else self._cycle(dense)
        waveforms = _record(curve, instants, flags if cycle is None else (*flags, str(cycle)))
        if self.times is not None and dense.escaped:
            raise DivergesError(diverges, waveforms)
        return waveforms

    def _cycle(self, dense: Dense) -> LimitCycle | None:
        """Return the cycle in which straight pieces end; an unstable board may reach it later."""
        if not dense.switches:
            return None
        found = limit_cycle(dense.switches)
        if found is None and self.board.state_space.modes.poles[0].real > 0.0:
            run = replace(SteppedRun.of(self), stop=LATER * self.stop)
            work = _integrator([run], 1.0)
            work.most_switches = FOLLOWED
            (later,) = work.run(np.array([run.stop]))
            found = None if later.escaped else limit_cycle(later.switches)
        return found


def simulate_together(
    tasks: Sequence[Task], *, halves: bool = False
) -> list[Waveforms | EngineError]:
    """Simulate several boards, those of one kind by the same array operations.

    Each record is that of `simulate`, or the error that it raises. With `halves` the runs of
    `halved` are integrated, too.
    """
    began = clock.perf_counter()
    found: dict[int, Waveforms | EngineError] = {}
    runs: dict[int, SteppedRun] = {}
    for place, task in enumerate(tasks):
        known = _CURVES.setdefault(task.board, {})
        try:
            if task.key not in known:
                runs[place] = SteppedRun.of(task)
        except EngineError as error:
            found[place] = error
    outs = integrate(list(runs.values()))
    seconds = (clock.perf_counter() - began) / max(len(runs), 1)
    for (place, run), dense in zip(runs.items(), outs, strict=True):
        _CURVES[tasks[place].board][tasks[place].key] = SteppedCurve(run, dense, seconds)
    for place, task in enumerate(tasks):
        if place not in found:
            try:
                found[place] = task.record(_CURVES[task.board][task.key])
            except EngineError as error:
                found[place] = error
    if halves:
        curves = [x.curve for x in found.values() if isinstance(x, Waveforms)]
        _halve([curve for curve in curves if isinstance(curve, SteppedCurve)])
    return [found[place] for place in range(len(tasks))]


_CURVES: WeakKeyDictionary[LinearBoard, dict[Hashable, SteppedCurve]] = WeakKeyDictionary()
"""Integrations of boards that are in use, by the keys of their tasks."""


def _record(curve: SteppedCurve, instants: Floats, flags: tuple[str, ...]) -> Waveforms:
    run, dense = curve.run, curve.dense
    values = curve.at(instants)[:, : len(run.reported.nodes)]
    if not np.all(np.isfinite(values)):
        raise EngineError("an amplifier left the range of floats between two steps")
    if dense.coarse:
        flags += (
            f"rounding leaves up to {dense.rounding:.3g} V, in a step more than its tolerance",
        )
    cost = Cost(curve.seconds, dense.steps, dense.factorisations)
    return Waveforms(
        instants, run.reported.nodes, values, "statespace", cost, flags, dense.rounding,
        curve=curve, method=METHOD,
    )  # fmt: skip


def _halve(curves: Sequence[SteppedCurve]) -> None:
    """Integrate the runs of `curves` again with every step halved and the coefficients moved."""
    runs = [curve.run.perturbed() for curve in curves]
    outs = integrate(runs, [curve.dense for curve in curves])
    for curve, dense in zip(curves, outs, strict=True):
        curve.halves.append(dense)


def halved(first: Waveforms, *, resolved: bool = False) -> Waveforms:
    """Repeat a run of `simulate`, or of this, with every step halved, at the same instants.

    With `resolved` the instants are those that the new run resolves.

    A run with a smaller tolerance would take many of the same steps, since their lengths are powers
    of two, and the difference of the two runs would not show their error. Nor does it show the
    change of modes that are too fast for both runs, which `rounding` of this one includes. The cost
    is that of both.

    Raises
    ------
    EngineError
        The first run is not one of the integrator's, or half a step is not found.
    """
    began, curve = clock.perf_counter(), first.curve
    if not isinstance(curve, SteppedCurve):
        raise EngineError("the first run is not one of the integrator's")
    if not curve.halves:
        _halve([curve])
    dense = curve.halves[0].checked(curve.run.name)
    seconds = first.cost.seconds + clock.perf_counter() - began
    better = SteppedCurve(curve.run.perturbed(), dense, seconds)
    found = _record(better, better.points() if resolved else first.time, ())
    return replace(
        found, flags=first.flags, rounding=found.rounding + dense.unresolved(curve.dense)
    )
