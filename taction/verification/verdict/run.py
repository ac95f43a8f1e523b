"""Simulate the transient of a board and measure it, until its error is what the scene asks for.

The state-space engine gives a second solution with a bound of its own error. The error of a reading
of ngspice is at most its difference to the reading of that solution, and the uncertainty of that
one. The exact solution of a linear board is measured for all time, so that no reading depends on
the end of a record.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from functools import cached_property, partial
from typing import Annotated

import numpy as np

from taction.netlist_gen.analysis import Transient
from taction.netlist_gen.board.circuit import Circuit
from taction.netlist_gen.scene.check_keys import AGREE
from taction.system.array_types import PHYSICAL_BOUND, Floats, Indices, Waveforms
from taction.system.documents import HIDDEN
from taction.system.errors import EngineError, StepTooSmall, TimedOut
from taction.system.progress import Clock
from taction.verification.engines.statespace.linearised.linear_board import LinearBoard
from taction.verification.engines.statespace.transients import stepped
from taction.verification.engines.statespace.transients.exact import is_exact
from taction.verification.readings.measurements import Measurements, measure, summary
from taction.verification.readings.record import CUBIC, Rest, lagrange
from taction.verification.verdict.board import Board
from taction.verification.verdict.headroom import watched_nodes
from taction.verification.verdict.simulation import (
    ENGINES,
    StateSpaceError,
    Waiting,
    begin,
    on_curve,
    state_space_error,
)
from taction.verification.verdict.transient_plan import (
    AFTER_SETTLING,
    AIM,
    LEAST_ERROR,
    TransientPlan,
    plan_transient,
)

COMPARED = "difference to the state-space engine, and the error of that engine"
MAX_INSTANTS = 20_000
LATE = 0.9  # of a record: after it the largest distance from the equilibrium will not be exceeded


@dataclass(frozen=True, slots=True, eq=False)
class Agreement:
    """The outputs of a record beside those of a second solution."""

    instants: Floats  # (Q,): at which both are compared, s
    u: Floats  # (Q, N): outputs of the record, V
    other: Floats  # (Q, N): outputs of the second solution, V
    solution: Waveforms  # the second solution at instants that resolve it
    doubt: float  # bound of the error of the second solution, V; infinite without one
    reason: str = ""  # why the state-space engine has no solution, or empty
    step_error: float = 0.0  # expected error of the time steps of ngspice, V
    limit: float = AGREE  # accepted difference, of the step amplitude; without a step, of `unit`
    unit: float = 1.0  # unit voltage U0, V

    @property
    def differences(self) -> Floats:
        """Record minus second solution, (Q, N), V."""
        return self.u - self.other

    @property
    def difference(self) -> float:
        """Largest difference of any output at any instant, V."""
        return float(np.abs(self.differences).max(initial=0.0))

    @property
    def largest(self) -> tuple[float, int]:
        """Instant of the largest difference, s, and its channel, from 0."""
        place, channel = np.unravel_index(int(np.abs(self.differences).argmax()), self.u.shape)
        return float(self.instants[place]), int(channel)


def second_solution(board: Board, record: Waveforms) -> Agreement:
    """Return the second solution for ngspice's record of a stable board, or why there is none."""
    linear, plan = board.linear, board.plan
    by_patterns = linear.circuit.is_linear and not is_exact(linear)
    dense = plan.instants(linear) if by_patterns else None
    wanted = board.volts(plan.wanted)
    try:
        found = state_space_beside(linear, plan.transient, record, plan.tolerance, dense, wanted)
    except EngineError as error:
        at, u = record.time[[0, -1]], outputs(board.circuit, record)[[0, -1]]
        found = Agreement(at, u, u, record, math.inf, str(error))
    return replace(
        found,
        step_error=plan.error * board.amplitude,
        limit=board.scene.agreement_limit,
        unit=board.circuit.value("U0"),
    )


def state_space_beside(
    linear: LinearBoard,
    transient: Transient,
    record: Waveforms,
    tolerance: float,
    dense: Floats | None = None,
    wanted: float = math.inf,
) -> Agreement:
    """Return the state-space solution for the `record` of ngspice.

    `tolerance` is relative, of steps; `dense` are further instants that resolve the solution, s;
    an error of `wanted`, V, suffices. EngineError: there is none for the whole record, or none with
    a known error.
    """
    last = len(record.time) - 1  # a record without its end would prove no settling time
    shown = np.append(np.arange(0, last, max(last // MAX_INSTANTS, 1)), last)
    instants, u = np.array(record.time[shown]), outputs(linear.circuit, record)[shown]
    times = instants
    if dense is not None:
        times = np.union1d(instants, dense[dense < instants[-1]])
    steps, nodes = not linear.circuit.is_linear, watched_nodes(linear.circuit)
    solution = stepped.simulate(
        linear, transient, times=times, tolerance=tolerance, beside=nodes, resolved=steps
    )
    if solution.time[-1] < times[-1] * (1.0 - 1e-9):
        raise EngineError("its record ends before the record of ngspice")
    error = state_space_error(linear, solution, wanted)
    if not math.isfinite(error.volts):
        raise EngineError(error.how)
    at = error.record
    if steps:
        # What the record does not show between its points counts as a difference, too.
        own = at.time[:: len(at.time) // MAX_INSTANTS + 1]
        instants = np.union1d(instants, own[own < instants[-1]])
        u = lagrange(record.time, outputs(linear.circuit, record), instants, CUBIC)
        at = replace(at, time=instants, values=on_curve(at, instants))
    other = outputs(linear.circuit, at)[np.searchsorted(at.time, instants)]
    return Agreement(instants, u, other, error.record, error.volts)


def measure_with_bounds(
    board: Board, wave: Waveforms, own: StateSpaceError | None, beside: Agreement | None
) -> Measurements:
    """Measure a record; the uncertainties of the readings are bounds.

    `own` is the error of a record of the state-space engine, `beside` a second solution beside a
    record of ngspice. The readings of a record that has an exact solution are those of it: they
    have no end.
    """
    if beside is not None and not beside.reason:
        other = board.exact or measure_outputs(board, beside.solution, beside.doubt)
        return bounded(measure_outputs(board, wave), other)
    exact = None if own is None else board.exact
    if exact is None:
        return measure_outputs(board, wave.filled, math.inf if own is None else own.volts)
    # As for every engine, `final` is the end of the record.
    ends = zip(exact.channels, outputs(board.circuit, wave)[-1].tolist(), strict=True)
    channels = tuple(replace(channel, final=end) for channel, end in ends)
    return replace(exact, channels=channels)


def bounded(measured: Measurements, other: Measurements | None) -> Measurements:
    """Return `measured` with uncertainties that hold for the true solution.

    The error of a reading is at most its difference to the reading of the better solution `other`,
    and the uncertainty of that one. A reading that only one solution has is infinitely uncertain.
    """
    channels = []
    for n, channel in enumerate(measured.channels):
        better = {} if other is None else other.channels[n].readings
        known = dict(channel.readings)
        for name, reading in channel.readings.items():
            if reading is not None:
                there = better.get(name) or replace(reading, uncertainty=math.inf)
                apart = abs(reading.value - there.value)
                known[name] = replace(reading, uncertainty=apart + there.uncertainty)
        channels.append(replace(channel, readings=known))
    return summary(measured.amplitude, measured.band, measured.modes, channels)


def outputs(circuit: Circuit, waveforms: Waveforms) -> Floats:
    """Return u of every channel, shape (P, N), V; each channel is contiguous in memory."""
    return np.array([out.sign * waveforms[out.node] for out in circuit.outputs]).T


def measure_outputs(board: Board, waveforms: Waveforms, error: float = 0.0) -> Measurements:
    """Measure `waveforms` against the reference; `error` bounds the error of each voltage, V.

    Where it is not finite the readings have no bound.
    """
    u, time, ideal = outputs(board.circuit, waveforms), waveforms.time, board.ideal
    rest = between = None
    if board.poles.known_stable:  # it comes to rest after the record
        late = u[int(np.searchsorted(time, LATE * time[-1])) :]
        moving = float(np.abs(late - board.steady.values).max(initial=0.0))
        rest = Rest(board.steady.values, max(board.steady.left(float(time[-1])), moving))
    if (curve := waveforms.curve) is not None:
        found = board.circuit.outputs
        columns = np.array([waveforms.nodes.index(output.node) for output in found])
        signs = np.array([output.sign for output in found])

        def between(times: Floats, channels: Indices) -> Floats:
            return signs[channels] * curve(times, columns[channels])

    known = math.isfinite(error)
    measured = measure(
        time,
        u,
        ideal.target,
        ideal.start,
        band=board.scene.checks.settling_time.band,
        bound=PHYSICAL_BOUND * board.circuit.value("U0"),
        expected_stop=board.transient.stop,
        error=(error if known else waveforms.rounding) + board.target_error,
        rest=rest,
        curve=between,
        grows=board.poles.known_unstable,
    )
    return measured if known else bounded(measured, None)


INSIDE = 0.5  # of the band minus the static error: remaining ringing at the end of a longer record
LONGER = 2.0  # times the length of a record that was too short: least length of the next record
SMALLER = 1.05  # times: by so much the forecast error of a finer plan is smaller
REPEATS = 3  # largest number of repeated runs
REPEAT_FAILED = "a better run ended without a record, so the readings are of the run before it"
UNSTABLE = "the board is unstable: the error grows with the voltages"


@dataclass(frozen=True, slots=True)
class Accuracy:
    """The error of a transient, largest over all outputs and times."""

    wanted: float  # error that the checks allow, fraction of the step amplitude (`wanted_error`)
    achieved: float | None  # bound of the error, measured after the run; None if that is not known
    seconds: float  # wall time of all tries, s
    method: str  # of integration
    how: str  # how `achieved` was measured
    tries: int = 1  # number of runs
    asked: Annotated[bool, HIDDEN] = True  # False where the scene states the steps, not an error

    @property
    def reached(self) -> bool:
        """Whether the achieved error is known and does not exceed the wanted error."""
        return self.achieved is not None and self.achieved <= self.wanted

    @property
    def missed(self) -> bool:
        """Whether the achieved error is known and exceeds the error that the scene allows."""
        return self.asked and self.achieved is not None and not self.reached


@dataclass(frozen=True, eq=False)
class Run:
    """A transient of a board, the error of its record, and its readings."""

    board: Board  # with the plan of this record
    ends: Waveforms  # the record, at least its first and its last point
    measured: Measurements
    own: StateSpaceError | None = None  # its error, if its engine bounds that itself
    beside: Agreement | None = None  # else the second solution; None for an unstable board
    tries: int = 1  # number of runs
    before: float = 0.0  # wall time of those that did not suffice, s

    @cached_property
    def waveforms(self) -> Waveforms:
        """The record with all its points."""
        return self.ends.filled

    @cached_property
    def u(self) -> Floats:
        """Outputs, V, (P, N)."""
        return outputs(self.board.circuit, self.waveforms)

    @property
    def first_and_last(self) -> Floats:
        """Outputs at the first and at the last instant, V, (2, N)."""
        return outputs(self.board.circuit, self.ends)[[0, -1]]

    @property
    def error(self) -> tuple[float, float, str]:
        """Bounds of the error of any output, V, at any time and at the end, and their source."""
        own, beside = self.own, self.beside
        if own is not None:
            return own.volts, own.volts if math.isfinite(own.volts) else math.inf, own.how
        if beside is None:
            return math.nan, math.inf, UNSTABLE
        last = float(np.abs(beside.differences[-1]).max(initial=0.0))
        how = f"no state-space solution: {beside.reason}" if beside.reason else COMPARED
        return beside.difference + beside.doubt, last + beside.doubt, how

    @property
    def exact_end(self) -> Floats | None:
        """Outputs of the better solution at the record's end, V, (N,); None without one."""
        if self.beside is not None and not self.beside.reason:
            return np.asarray(self.beside.other[-1])
        known = self.own is not None and math.isfinite(self.own.volts)
        return self.first_and_last[-1] if known else None

    @property
    def achieved(self) -> float | None:
        """Bound of the error over all time, in step amplitudes; None if it is unknown."""
        volts = self.error[0]
        return volts / (self.board.amplitude or 1.0) if math.isfinite(volts) else None

    @cached_property
    def accuracy(self) -> Accuracy:
        """The error over all time, and what it cost."""
        board, cost = self.board, self.waveforms.cost
        return Accuracy(
            wanted=board.plan.wanted,
            achieved=self.achieved,
            seconds=cost.seconds + self.before,
            method=str(board.transient.method) if self.own is None else self.ends.method,
            how=self.error[2],
            tries=self.tries,
            asked=board.scene.analysis.points_per_period is None,
        )


def observe(board: Board, pending: Waiting | None, clock: Clock) -> Run:
    """Wait for a simulation, which begins here unless it runs, and measure the record.

    A run that missed the wanted error is repeated with smaller steps, a record that is too short
    for a reading is repeated with a longer stop time; the record stays if its repeat fails.
    SimulationError: of the first run, as `begin`.
    """
    run = _observed(board, pending, clock)
    while run.tries <= REPEATS and (plan := better_plan(run)) is not None:
        try:
            again = _observed(replace(run.board, plan=plan), None, clock)
        except (StepTooSmall, TimedOut) as error:
            flag = f"{REPEAT_FAILED}: {str(error).splitlines()[0]}"
            return replace(run, ends=replace(run.ends, flags=(*run.ends.flags, flag)))
        run = replace(again, tries=run.tries + 1, before=run.accuracy.seconds)
    return run


def _observed(board: Board, pending: Waiting | None, clock: Clock) -> Run:
    """Wait for a simulation, find the error of its record, and measure it."""
    clock.begin("simulation")
    wave = (pending or begin(board))()
    clock.begin("comparison")
    bound = ENGINES[wave.engine.partition("-")[0]].error  # its version follows a hyphen
    own, beside = None if bound is None else bound(board, wave), None
    if own is None and board.poles.known_stable:
        beside = second_solution(board, wave)
    clock.begin("measures")
    wave = wave if own is None else own.record
    return Run(board, wave, measure_with_bounds(board, wave, own, beside), own, beside)


def better_plan(run: Run) -> TransientPlan | None:
    """Return a plan for a better run; None if the run suffices or no plan would be better.

    A longer record is for a channel that settles only after its end, unless the board diverges;
    smaller steps are for an engine that takes the steps of the plan and missed the wanted error.
    """
    board, measured = run.board, run.measured
    steps, whole = board.plan.steps > 0.0, run.ends.time[-1] > 0.999 * board.transient.stop
    planned = partial(plan_transient, board.scene, board.linear, board.scales, steps=steps)
    automatic = whole and board.scene.analysis.stop == "auto" and board.poles.known_stable
    if automatic and measured.settling_time is None and measured.amplitude:
        static = float(np.abs(board.steady.values - board.ideal.target).max()) / measured.amplitude
        room = INSIDE * (board.scene.checks.settling_time.band - static)
        if room > 0.0:
            stop = max(AFTER_SETTLING * board.scales.stop_for(room), LONGER * board.transient.stop)
            return planned(stop=float(f"{stop:.6g}"))
    if run.own is not None or run.achieved is None or not run.accuracy.missed:
        return None
    error, wanted = board.plan.error, board.plan.wanted
    aim = AIM * wanted * min(error / run.achieved, 1.0)
    if aim < LEAST_ERROR:
        return None
    plan = planned(stop=board.transient.stop, aim=aim)
    return plan if SMALLER * plan.error < error else None
