"""Transients by the method that suits the board: exact, by patterns, or else by steps.

Boards with amplifiers, and many with many unknowns, have no exact solution. By steps, the reported
voltage of an amplifier's output is g of its interpolated input, so that a small voltage keeps its
relative accuracy.
"""

from __future__ import annotations

import math
import time as clock
from collections.abc import Hashable, Iterable
from dataclasses import dataclass, replace

import numpy as np

from taction.netlist_gen.analysis import Transient
from taction.netlist_gen.board.circuit import Circuit
from taction.system.array_types import EPS, Cost, Floats, Indices, Waveforms
from taction.system.errors import DivergesError, EngineError
from taction.system.quantities import show
from taction.verification.engines.statespace.linearised.find_modes import refined_modes
from taction.verification.engines.statespace.linearised.linear_board import (
    LinearBoard,
    initial_unknowns,
)
from taction.verification.engines.statespace.transients import reduced_transient
from taction.verification.engines.statespace.transients.exact import (
    exact_solution,
    is_exact,
    record_times,
)
from taction.verification.engines.statespace.transients.radau import ESCAPED, STAGES, TABLE, Dense
from taction.verification.engines.statespace.transients.radau_integrator import Integration
from taction.verification.engines.statespace.transients.step_systems import (
    ModalBoard,
    StateBoard,
    StructuredBoard,
    is_basis,
)

METHOD = "Radau IIA"
LARGE_TOLERANCE = 1e-5  # of the outputs of a large linear board, in step amplitudes
TOLERANCE = 1e-9  # of a step, in step amplitudes
FLOOR = 1e-3  # of the board's largest voltage: the least voltage to which errors are relative
# Times the tolerance of a board with straight pieces: where these meet, the error of half a step is
# not much smaller.
BENT = 1e-2
REPEATED = 1.0 / 16.0  # of the tolerance: what a run with half the steps leaves of its iterations
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

    Nodes `beside` come after them; their errors count by `weights`, (others,). `resting` are the
    voltages of all nodes at rest, V.
    """

    def __init__(
        self, board: LinearBoard, nodes: tuple[str, ...], beside: tuple[str, ...] = ()
    ) -> None:
        devices, rest = board.descriptor.devices, board.equilibrium
        self.devices, self.nodes = devices, nodes
        device = {int(place): k for k, place in enumerate(devices.output)}
        source = [device.get(board.descriptor.place(name), -1) for name in nodes]
        self.source = np.array([*source, *[-1] * len(beside)], dtype=np.int64)  # amplifiers
        self.others = (*(name for name, k in zip(nodes, source, strict=True) if k < 0), *beside)
        self.weights = np.ones(len(self.others))
        self.by_input = np.isin(np.arange(devices.count), self.source)
        self.resting = np.array([rest[name] for name in (*nodes, *beside)])

    def volts(self, inputs: Floats) -> Floats:
        """Return reported volts for a volt of each watched voltage, at inputs (m, s); (W,).

        Every input counts as volts itself, too: where an amplifier is flat, it decides when the
        amplifier leaves that.
        """
        slopes = np.abs(self.devices.slopes(inputs)).max(axis=1, initial=0.0)
        seen = np.where(self.by_input, np.maximum(slopes, 1.0), 1.0)
        return np.concatenate([np.maximum(seen, self.devices.steepest), self.weights])

    def voltages(self, watched: Floats) -> Floats:
        """Return the voltages of the nodes, (P, nodes), for watched voltages (P, W)."""
        m, by_input = self.devices.count, self.source >= 0
        voltages = np.empty((len(watched), len(self.source)))
        voltages[:, ~by_input] = watched[:, m:]
        outputs = self.devices.outputs(watched[:, :m].T).T
        voltages[:, by_input] = outputs[:, self.source[by_input]]
        return voltages

    def distance(self, watched: Floats) -> float:
        """Return the largest distance of a reported voltage from rest, V, for watched ones (W,)."""
        away = np.abs(self.voltages(watched[None])[0] - self.resting)[: len(self.nodes)]
        return float(away.max(initial=0.0))


@dataclass(frozen=True, slots=True, eq=False)
class Task:
    """What `integrate` gets; a run with half the steps of another one has that as `whole`."""

    board: LinearBoard
    analysis: Transient
    nodes: Iterable[str] | None = None
    times: Floats | None = None
    tolerance: float = TOLERANCE
    beside: tuple[str, ...] = ()
    whole: SteppedCurve | None = None

    @property
    def stop(self) -> float:
        """The end of the record, s."""
        last = self.analysis.stop if self.times is None else float(self.times[-1])
        same = math.isclose(last, self.analysis.stop, rel_tol=1e-12)
        return self.analysis.stop if same else last

    @property
    def halvings(self) -> int:
        """How often the steps of the first run are halved."""
        return 0 if self.whole is None else self.whole.task.halvings + 1

    @property
    def key(self) -> Hashable:
        """What two tasks of a board have in common that need one integration."""
        start, nodes = self.analysis.initial, self.board.reported(self.nodes)
        voltages = tuple((self.analysis.voltages or {}).items())
        return start, voltages, nodes, self.beside, self.tolerance, self.stop, self.whole


@dataclass(eq=False)
class SteppedCurve:
    """One integration of a board: voltages of nodes (Q,) at instants (Q,) by its steps."""

    task: Task
    reported: ReportedOutputs
    unit: float  # the step amplitude, V
    work: Integration  # at its start
    seconds: float = 0.0  # that it cost, with the runs before it

    @classmethod
    def of(cls, task: Task) -> SteppedCurve:
        """Prepare the integration of a task."""
        board, analysis, nodes = task.board, task.analysis, task.board.reported(task.nodes)
        reported, slopes = ReportedOutputs(board, nodes, task.beside), board.equilibrium.slopes
        unknowns = initial_unknowns(board, analysis.initial, analysis.voltages)
        equations: StateBoard | StructuredBoard
        if board.descriptor.is_large:
            equations = StructuredBoard(board, reported.others)
        else:
            equations = _equations(task, reported, slopes)
        state, start = equations.start(unknowns, reported.devices)
        largest = _largest(board, unknowns, start)
        unit = max(reported.distance(start), FLOOR * largest) or 1.0
        if task.beside:
            away = np.abs(reported.voltages(start[None])[0] - reported.resting)[len(nodes) :]
            allowed = BESIDE * max(float(away.max()), FLOOR * largest)
            weight = min(task.tolerance * unit / allowed, 1.0)
            reported.weights[-len(task.beside) :] = weight
        steps: ModalBoard | StructuredBoard
        if isinstance(equations, StructuredBoard):
            steps = equations
        else:
            steps, slopes = _modal(task, reported, equations, unknowns, largest)
        whole = None if task.whole is None else task.whole.dense
        tolerance = task.tolerance * unit * (BENT if reported.devices.steepest.any() else 1.0)
        work = Integration(
            steps, reported, whole, steps.state(state), start, slopes,
            tolerance=tolerance * (1.0 if whole is None else REPEATED),
            unit=unit, base=task.stop * FIRST, limit=ESCAPED * (largest or 1.0), stop=task.stop,
        )  # fmt: skip
        return cls(task, reported, unit, work)

    @property
    def dense(self) -> Dense:
        """The steps."""
        return self.work.out

    def at(self, times: Floats) -> Floats:
        """Return the voltages of all nodes, those beside the last, shape (P, nodes)."""
        return self.reported.voltages(self.dense.at(times))

    def __call__(self, times: Floats, columns: Indices) -> Floats:
        """Return voltages (Q,)."""
        instants, place = np.unique(times, return_inverse=True)
        return np.asarray(self.at(instants)[place, columns])

    def points(self) -> Floats:
        """Return instants between which a cubic through the reported voltages errs by `BETWEEN`, s.

        Every step is divided evenly. How often follows from the fourth derivatives of the voltages
        and from their changes in it, so that all that the steps resolve is seen at the instants.
        """
        reported, ends = self.reported, np.array(self.dense.ends)
        at_nodes = np.stack(self.dense.pieces) @ np.linalg.inv(TABLE.legendre).T  # (S, W, s + 1)
        flat = at_nodes.transpose(0, 2, 1).reshape(-1, at_nodes.shape[1])
        values = reported.voltages(flat)[:, : len(reported.nodes)]
        pieces = np.abs(TABLE.legendre @ values.reshape(len(at_nodes), STAGES + 1, -1))
        away = np.abs(values - reported.resting[: len(reported.nodes)])
        # As in the steps, growing voltages count by their size.
        unit = np.maximum(self.unit, away.reshape(len(at_nodes), -1).max(axis=1))
        bend = (pieces * BENDS[:, None]).sum(axis=1).max(axis=1)
        parts = (3.0 / 128.0 * bend / (BETWEEN * unit)) ** 0.25
        parts = np.maximum(parts, 2.0 * pieces[:, 1:].sum(axis=1).max(axis=1) / (MOVE * unit))
        parts = np.maximum(parts, FEWEST * np.diff(ends) / ends[-1])
        count = np.ceil(np.clip(parts, 2.0, MOST_PARTS)).astype(np.int64)
        step = np.repeat(np.arange(len(count)), count)
        share = (np.arange(len(step)) - np.repeat(np.cumsum(count) - count, count)) / count[step]
        found = np.append(ends[step] + share * np.diff(ends)[step], ends[-1])
        stop = min(self.task.stop, ends[-1])
        return np.append(found[found < stop * (1.0 - 1e-12)], stop)


def _equations(task: Task, reported: ReportedOutputs, slopes: Floats) -> StateBoard:
    """Return the equations at slopes of the amplifiers.

    The coefficients of a run with half the steps of another one are moved by their rounding.
    """
    rounding = ROUNDED[bool(reported.devices.steepest.any())]
    return StateBoard(task.board.open_loop, reported.others, slopes, task.halvings, rounding)


def _largest(board: LinearBoard, unknowns: Floats, start: Floats) -> float:
    """Return the board's largest voltage, V: at the start, at rest, or of an amplifier."""
    devices = board.descriptor.devices
    sizes = np.maximum(np.abs(board.equilibrium.values), np.abs(unknowns))
    sizes = np.delete(sizes, devices.output[devices.limits])
    parts = sizes, np.abs(start), devices.u_scale[~devices.limits]
    return max(float(part.max(initial=0.0)) for part in parts)


def _modal(
    task: Task,
    reported: ReportedOutputs,
    equations: StateBoard,
    unknowns: Floats,
    largest: float,
) -> tuple[ModalBoard, Floats]:
    """Return the equations in the basis of the modes, and the slopes of the first steps.

    These are the smaller of start and rest. Where the modes are no basis, or rounding of their
    shares in the largest voltage would move an amplifier, the states are the basis.
    """
    board, devices, slopes = task.board, task.board.descriptor.devices, equations.slopes
    first = reported.devices.slopes(unknowns[devices.input, None])[:, 0]
    least = np.where(np.abs(first) < np.abs(slopes), first, slopes)
    finest = task.tolerance * float(devices.v_scale[~devices.limits].min(initial=np.inf))
    modes = refined_modes(board.state_space.modes)
    known = is_basis(modes) and () != board.open_loop.states == board.state_space.states
    if known and finest >= EPS * largest:
        return ModalBoard(equations, modes), least
    return ModalBoard(_equations(task, reported, least), None), least


def simulate(
    circuit: Circuit | LinearBoard,
    analysis: Transient,
    nodes: Iterable[str] | None = None,
    times: Floats | None = None,
    *,
    tolerance: float | None = None,
    beside: tuple[str, ...] = (),
    resolved: bool = False,
) -> Waveforms:
    """Simulate a transient: by `exact` if the board is linear and small, else by `integrate`.

    A large linear board is simulated by `reduced_transient`, if that reaches the tolerance. Of the
    analysis, `max_step` only sets the spacing of the points, and `method` is not used. The record
    of a board that leaves the range of floats ends before.

    `nodes`: by default the outputs' nodes.
    `times` (P,): requested instants, strictly increasing, s; by default uniform from 0 to `stop`.
    `tolerance`: of one step in `integrate`, of the outputs in `reduced_transient`.
    `beside`, `resolved`: see `integrate`.
    EngineError: as `exact_solution` and `integrate`; the record ends before given `times`.
    """
    board = LinearBoard.of(circuit)
    if is_exact(board):
        return _record(board, analysis, nodes, times)
    if board.circuit.is_linear:
        tolerance = LARGE_TOLERANCE if tolerance is None else tolerance
        found = reduced_transient.simulate(board, analysis, nodes, times, tolerance=tolerance)
        if found is not None:
            return found
    tolerance = TOLERANCE if tolerance is None else tolerance
    return integrate(
        board, analysis, nodes, times, tolerance=tolerance, beside=beside, resolved=resolved
    )


def _record(
    board: LinearBoard, analysis: Transient, nodes: Iterable[str] | None, times: Floats | None
) -> Waveforms:
    """Return the record of the exact solution; it ends before the range of floats does."""
    began = clock.perf_counter()
    initial, voltages = analysis.initial, analysis.voltages
    solution = exact_solution(board, initial=initial, voltages=voltages, nodes=nodes)
    instants = record_times(analysis, analysis.stop) if times is None else times
    values, flags = solution.at(instants), tuple[str, ...]()
    overflow = np.flatnonzero(~np.isfinite(values).all(axis=1))
    if overflow.size:
        if times is not None or overflow[0] < 2:
            raise EngineError("the board is unstable and leaves the range of floats")
        instants, values = instants[: overflow[0]], values[: overflow[0]]
        flags = (f"the board diverges: it leaves the range of floats after {instants[-1]!r} s",)
    cost = Cost(clock.perf_counter() - began, len(instants), 1)
    return Waveforms(
        instants, solution.nodes, values, "statespace", cost, flags, solution.error, method="exact"
    )


def integrate(
    circuit: Circuit | LinearBoard,
    analysis: Transient,
    nodes: Iterable[str] | None = None,
    times: Floats | None = None,
    *,
    tolerance: float = TOLERANCE,
    beside: tuple[str, ...] = (),
    resolved: bool = False,
) -> Waveforms:
    """Simulate a transient by steps, as `simulate`.

    `tolerance` is that of one step and of the solution within it, in step amplitudes. The nodes
    `beside` are in the curve of the record, to `BESIDE`. With `resolved` the record has the points
    of the solution, up to the last of `times`.

    DivergesError: the board diverges before the last of `times`; the exception has the record,
      which ends beyond any physical bound.
    EngineError: no equilibrium, no state space, or the solution leaves the range of floats.
    """
    board = LinearBoard.of(circuit)
    curve = _curve(Task(board, analysis, nodes, times, tolerance, beside))
    dense = curve.dense
    ended = min(dense.ends[-1], curve.task.stop)
    diverges = f"the board diverges: it passes {curve.work.limit:.3g} V at {show(ended, 's')}"
    instants = curve.points() if resolved else record_times(analysis, ended, times)
    waveforms = _waveforms(curve, instants, (diverges,) * dense.escaped)
    if times is not None and dense.escaped:
        raise DivergesError(diverges, waveforms)
    return waveforms


def _curve(task: Task) -> SteppedCurve:
    """Return the integration of a task, which its board keeps; EngineError without a solution."""
    kept = task.board.integrations
    if task.key not in kept:
        began, curve = clock.perf_counter(), SteppedCurve.of(task)
        curve.work.run()
        before = 0.0 if task.whole is None else task.whole.seconds
        curve.seconds = before + clock.perf_counter() - began
        kept[task.key] = curve
    found: SteppedCurve = kept[task.key]
    found.dense.checked(task.board.circuit.name)
    return found


def halved(first: Waveforms, *, resolved: bool = False) -> Waveforms:
    """Repeat a run of `integrate`, or of this, with every step halved, at the same instants.

    With `resolved` the instants are those that the new run resolves. A run with a smaller tolerance
    would take many of the same steps, whose lengths are powers of two: its difference would not
    show their error. Nor does this one show the change of modes that are too fast for both runs,
    which `rounding` includes. The cost is that of both.

    EngineError: the first run is not one of the integrator's, or half a step is not found.
    """
    if not isinstance(first.curve, SteppedCurve):
        raise EngineError("the first run is not one of the integrator's")
    curve = _curve(replace(first.curve.task, whole=first.curve))
    found = _waveforms(curve, curve.points() if resolved else first.time, first.flags)
    return replace(found, rounding=curve.dense.doubt(first.curve.dense))


def _waveforms(curve: SteppedCurve, instants: Floats, flags: tuple[str, ...]) -> Waveforms:
    nodes, dense = curve.reported.nodes, curve.dense
    values = curve.at(instants)[:, : len(nodes)]
    if not np.all(np.isfinite(values)):
        raise EngineError("an amplifier left the range of floats between two steps")
    cost = Cost(curve.seconds, dense.steps, dense.factorisations)
    return Waveforms(
        instants, nodes, values, "statespace", cost, flags, dense.rounding,
        curve=curve, method=METHOD,
    )  # fmt: skip
