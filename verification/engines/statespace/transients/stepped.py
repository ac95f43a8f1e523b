"""Transients of boards without an exact solution: with amplifiers, or with many unknowns.

The reported voltage of an amplifier's output is g of its interpolated input, so that a small
voltage keeps its relative accuracy.
"""

from __future__ import annotations

import time as clock
from collections.abc import Iterable
from dataclasses import dataclass, replace

import numpy as np

from taction.netlist_gen.analysis import Transient
from taction.netlist_gen.board.circuit import Circuit
from taction.system.array_types import Floats, Indices
from taction.system.errors import DivergesError, EngineError
from taction.system.quantities import show
from taction.system.waveforms import Cost, Waveforms
from taction.verification.engines.statespace.equations.amplifier_gains import OPAMP_KINDS
from taction.verification.engines.statespace.linearised.board import LinearBoard, initial_unknowns
from taction.verification.engines.statespace.transients.integrator import Dense, Integrator
from taction.verification.engines.statespace.transients.record_times import record_times
from taction.verification.engines.statespace.transients.steps import (
    Amplifiers,
    Board,
    DenseBoard,
    LargeBoard,
)

METHOD = "Radau IIA"
TOLERANCE = 1e-9  # of a step, in step amplitudes
ESCAPED = 1e8  # of the board's largest voltage: a board above it has diverged, and the record ends
FLOOR = 1e-3  # of the board's largest voltage: the least voltage to which errors are relative
REPEATED = 1.0 / 16.0  # of the tolerance: what a second run leaves of its iterations
FIRST = 2.0**-16  # of the record: the first step tried


class Reported:
    """Reported nodes: the output of an amplifier by its input, other nodes themselves."""

    def __init__(self, board: LinearBoard, nodes: tuple[str, ...]) -> None:
        devices, rest = board.descriptor.devices, board.equilibrium
        self.amplifiers, self.nodes = Amplifiers(devices), nodes
        device = {int(place): k for k, place in enumerate(devices.output)}
        source = [device.get(board.descriptor.place(name), -1) for name in nodes]
        self.source = np.array(source, dtype=np.int64)
        self.others = tuple(name for name, k in zip(nodes, source, strict=True) if k < 0)
        self.resting = np.array([rest[name] for name in nodes])
        self.linear = np.ones(devices.count, dtype=np.bool_)
        self.linear[self.source[self.source >= 0]] = False

    def volts(self, inputs: Floats) -> Floats:
        """Return reported volts for a volt of each watched voltage, at inputs (m, s); (m + K,).

        The inputs of amplifiers that are not reported count as volts themselves.
        """
        slopes = np.abs(self.amplifiers.slopes(inputs)).max(axis=1, initial=0.0)
        return np.append(np.where(self.linear, 1.0, slopes), np.ones(len(self.others)))

    def voltages(self, watched: Floats) -> Floats:
        """Return the voltages of the nodes for watched voltages (P, m + K), shape (P, nodes)."""
        m = self.amplifiers.count
        voltages = np.empty((len(watched), len(self.nodes)))
        by_input = self.source >= 0
        voltages[:, ~by_input] = watched[:, m:]
        outputs = self.amplifiers.outputs(watched[:, :m].T)
        voltages[:, by_input] = outputs[self.source[by_input]].T
        return voltages

    def distance(self, watched: Floats) -> float:
        """Return the largest distance of a reported voltage from rest, V."""
        return float(np.abs(self.voltages(watched[None])[0] - self.resting).max(initial=0.0))


@dataclass(frozen=True, eq=False)
class Run:
    """One integration of a board, with what another one of it needs."""

    board: Board
    reported: Reported
    state: Floats
    start: Floats
    slopes: Floats
    tolerance: float  # of a step, V
    unit: float  # the step amplitude, V
    base: float  # s
    limit: float  # V

    @classmethod
    def of(cls, board: LinearBoard, nodes: tuple[str, ...], analysis: Transient, tolerance: float,
           stop: float) -> Run:  # fmt: skip
        """Prepare the integration of `board` up to `stop`, s."""
        reported = Reported(board, nodes)
        unknowns = initial_unknowns(board, analysis.initial, analysis.voltages)
        equations, slopes = _equations(board, reported, unknowns)
        state = equations.state(unknowns)
        start = equations.start(state, reported.amplifiers)
        amplitude = reported.distance(start)
        devices = board.descriptor.devices
        inner = np.array([kind in OPAMP_KINDS for kind in devices.kinds], dtype=np.bool_)
        sizes = np.maximum(np.abs(board.equilibrium.values), np.abs(unknowns))
        largest = max(
            float(np.delete(sizes, devices.output[inner]).max(initial=0.0)),
            float(np.abs(start).max(initial=0.0)),
            float(devices.u_scale[~inner].max(initial=0.0)),
        )
        unit = max(amplitude, FLOOR * largest) or 1.0
        return cls(
            equations, reported, state, start, slopes, tolerance * unit, unit, stop * FIRST,
            ESCAPED * (largest or 1.0),
        )  # fmt: skip

    def integrator(self, share: float = 1.0) -> Integrator:
        """Return a new integrator at the start, with a share of the tolerance."""
        return Integrator(
            self.board, self.reported, self.state, self.start, self.slopes,
            share * self.tolerance, self.unit, self.base, self.limit,
        )  # fmt: skip


def _equations(board: LinearBoard, reported: Reported, unknowns: Floats) -> tuple[Board, Floats]:
    """Return the equations, and the slopes of the first steps: the smaller of start and rest."""
    slopes = board.equilibrium.slopes
    if board.descriptor.is_large:
        return LargeBoard(board, reported.others), slopes
    inputs = unknowns[board.descriptor.devices.input, None]
    first = reported.amplifiers.slopes(inputs)[:, 0]
    slopes = np.where(np.abs(first) < np.abs(slopes), first, slopes)
    return DenseBoard(board.open_loop, reported.others, slopes), slopes


@dataclass(frozen=True, slots=True, eq=False)
class Curve:
    """Voltages of nodes (Q,) at instants (Q,), from the polynomials of the steps."""

    run: Run
    dense: Dense

    def at(self, times: Floats) -> Floats:
        """Return the voltages of all nodes, shape (P, nodes)."""
        return self.run.reported.voltages(self.dense.at(times))

    def __call__(self, times: Floats, columns: Indices) -> Floats:
        """Return voltages (Q,)."""
        instants, place = np.unique(times, return_inverse=True)
        return np.asarray(self.at(instants)[place, columns])


def simulate(
    circuit: Circuit | LinearBoard,
    analysis: Transient,
    *,
    nodes: Iterable[str] | None = None,
    times: Floats | None = None,
    tolerance: float = TOLERANCE,
) -> Waveforms:
    """Simulate a transient by steps.

    Parameters
    ----------
    circuit, analysis, nodes, times
        See `simulate.simulate`; the error estimate controls the step.
    tolerance : float
        Of one step and of the solution within it, in step amplitudes.

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
    began = clock.perf_counter()
    board = LinearBoard.of(circuit)
    stop = analysis.stop if times is None else float(times[-1])
    run = Run.of(board, board.reported(nodes), analysis, tolerance, stop)
    dense = run.integrator().run(stop)
    ended = min(dense.ends[-1], stop)
    diverges = f"the board diverges: it passes {run.limit:.3g} V at {show(ended, 's')}"
    instants = record_times(analysis, ended) if times is None else times
    if times is not None and dense.escaped:
        instants = np.append(times[times < ended], ended)
    flags = (diverges,) * dense.escaped
    waveforms = _record(run, dense, instants, began, flags)
    if times is not None and dense.escaped:
        raise DivergesError(diverges, waveforms)
    return waveforms


def _record(
    run: Run, dense: Dense, instants: Floats, began: float, flags: tuple[str, ...]
) -> Waveforms:
    curve = Curve(run, dense)
    values = curve.at(instants)
    if not np.all(np.isfinite(values)):
        raise EngineError("an amplifier left the range of floats between two steps")
    if dense.coarse:
        flags += (
            f"rounding leaves up to {dense.rounding:.3g} V, in a step more than its tolerance",
        )
    cost = Cost(clock.perf_counter() - began, dense.steps, dense.factorisations)
    return Waveforms(
        instants, run.reported.nodes, values, "statespace", cost, flags, dense.rounding,
        curve=curve, method=METHOD,
    )  # fmt: skip


def halved(first: Waveforms) -> Waveforms:
    """Repeat a run of `simulate` with every step halved, at the same instants.

    A run with a smaller tolerance would take many of the same steps, since their lengths are powers
    of two, and the difference of the two runs would not show their error. Nor does it show the
    change of modes that are too fast for both runs, which `rounding` of this one includes.

    Raises
    ------
    EngineError
        The first run is not one of `simulate`, or half a step is not found.
    """
    began, curve = clock.perf_counter(), first.curve
    if not isinstance(curve, Curve):
        raise EngineError("the first run is not one of the integrator's")
    run = curve.run
    levels = [level - 1 for level in curve.dense.levels for _ in range(2)]
    dense = run.integrator(REPEATED).repeat(levels)
    found = _record(run, dense, first.time, began, ())
    return replace(
        found, flags=first.flags, rounding=found.rounding + dense.unresolved(curve.dense)
    )
