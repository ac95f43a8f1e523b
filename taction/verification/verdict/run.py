"""Simulate the transient of a board and measure it, until its error is what the scene asks for."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Annotated

import numpy as np

from taction.netlist_gen.analysis import Transient
from taction.netlist_gen.board.circuit import Circuit
from taction.netlist_gen.scene.inverse_problem import InverseProblem
from taction.netlist_gen.scene.scene import Scene
from taction.system.array_types import Floats
from taction.system.documents import HIDDEN
from taction.system.errors import StepTooSmall, TimedOut
from taction.system.progress import Clock, Progress
from taction.system.quantities import quantity
from taction.system.results import Result
from taction.system.waveforms import Waveforms
from taction.verification.readings.measurements import Measurements
from taction.verification.verdict.board import Board
from taction.verification.verdict.build import build
from taction.verification.verdict.measure import (
    Agreement,
    measure_outputs,
    measure_with_bounds,
    outputs,
    second_solution,
)
from taction.verification.verdict.simulation import (
    StateSpaceError,
    Waiting,
    begin,
    own_error,
)
from taction.verification.verdict.transient_plan import (
    AFTER_SETTLING,
    AIM,
    LEAST_ERROR,
    TransientPlan,
    plan_transient,
)

INSIDE = 0.5  # of the band minus the static error: remaining ringing at the end of a longer record
LONGER = 2.0  # times the length of a record that was too short: least length of the next record
SMALLER = 1.05  # times: by so much the forecast error of a finer plan is smaller
REPEATS = 3  # largest number of repeated runs
REPEAT_FAILED = (
    "a better run ended without a record, so the readings are of the run before it: {reason}"
)
UNSTABLE = "the board is unstable: the error grows with the voltages"


@dataclass(frozen=True, slots=True)
class Accuracy:
    """The error of a transient, largest over all outputs and times."""

    wanted: float  # error that the checks allow, fraction of the step amplitude (`wanted_error`)
    achieved: float | None  # bound of the error, measured after the run; None if that is not known
    seconds: float  # wall time of all tries, s
    points: int  # time points or steps of the run
    points_per_period: float  # of the fastest ringing, averaged over the record
    engine: str
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
    """A transient of a board, with the error of its record."""

    board: Board  # with the plan of this record
    ends: Waveforms  # the record, at least its first and its last point
    own: StateSpaceError | None = None  # its error, if its engine bounds that itself
    beside: Agreement | None = None  # else the second solution; None for an unstable board
    before: Accuracy | None = None  # of the runs that did not suffice

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
        """Bounds of the error of any output, V, and their source: at any time, and at the end.

        Not a number, and infinite, where they are unknown.
        """
        if self.own is not None:
            volts, how = self.own.volts, self.own.how
            return volts, volts if math.isfinite(volts) else math.inf, how
        if self.beside is not None:
            volts = self.beside.difference + self.beside.doubt
            return volts, self.beside.end_error, self.beside.how
        return math.nan, math.inf, UNSTABLE

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
        board, cost, before = self.board, self.waveforms.cost, self.before
        periods = board.transient.stop / board.scales.max_step_for(1.0)
        return Accuracy(
            wanted=board.plan.wanted,
            achieved=self.achieved,
            seconds=cost.seconds + (before.seconds if before else 0.0),
            points=cost.points,
            points_per_period=max(cost.points, 1) / periods,
            engine=self.ends.engine,
            method=str(board.transient.method) if self.own is None else self.ends.method,
            how=self.error[2],
            tries=1 + (before.tries if before else 0),
            asked=board.scene.analysis.points_per_period is None,
        )


def observe(board: Board, pending: Waiting | None, clock: Clock) -> tuple[Run, Measurements, bool]:
    """Wait for a simulation, which begins here unless it runs, and measure the record.

    A run that missed the wanted error is repeated with smaller steps, a record that is too short
    for a reading is repeated with a longer stop time; the record stays if its repeat fails. The
    last value is that of `measure_with_bounds`. SimulationError: of the first run, as `begin`.
    """
    run, measured, forever = _observed(board, pending, clock)
    for _ in range(REPEATS):
        plan = better_plan(run, measured)
        if plan is None:
            break
        try:
            again, measured, forever = _observed(replace(run.board, plan=plan), None, clock)
        except (StepTooSmall, TimedOut) as error:
            flag = REPEAT_FAILED.format(reason=str(error).splitlines()[0])
            ends = replace(run.ends, flags=(*run.ends.flags, flag))
            return replace(run, ends=ends), measured, forever
        run = replace(again, before=run.accuracy)
    return run, measured, forever


def _observed(
    board: Board, pending: Waiting | None, clock: Clock
) -> tuple[Run, Measurements, bool]:
    """Wait for a simulation, find the error of its record, and measure it."""
    clock.begin("simulation", remark=board.plan.remark)
    wave = (pending or begin(board))()
    clock.begin("comparison")
    own, beside = own_error(board, wave), None
    if own is None and board.poles.known_stable:
        beside = second_solution(board, wave)
    clock.begin("measures")
    wave = wave if own is None else own.record
    return Run(board, wave, own, beside), *measure_with_bounds(board, wave, own, beside)


def better_plan(run: Run, measured: Measurements) -> TransientPlan | None:
    """Return a plan for a better run; None if the run suffices or no plan would be better."""
    return _longer(run.board, measured) or _finer(run)


def _longer(board: Board, measured: Measurements) -> TransientPlan | None:
    """Plan a longer record if a channel settles only after its end."""
    automatic = board.scene.analysis.stop == "auto" and board.poles.known_stable
    if not automatic or measured.settling_time is not None or not measured.amplitude:
        return None
    static = float(np.abs(board.steady.values - board.ideal.target).max()) / measured.amplitude
    room = INSIDE * (board.scene.checks.settling_time.band - static)
    if room <= 0.0:
        return None
    stop = max(AFTER_SETTLING * board.scales.stop_for(room), LONGER * board.transient.stop)
    return _planned(board, float(f"{stop:.6g}"))


def _finer(run: Run) -> TransientPlan | None:
    """Plan smaller steps if a run with the steps of the plan missed the wanted error."""
    board, achieved, wanted = run.board, run.achieved, run.board.plan.wanted
    even = board.scene.analysis.points_per_period is not None
    if achieved is None or achieved <= wanted or even or run.own is not None:
        return None
    error = board.plan.forecast.error
    aim = AIM * wanted * min(error / achieved, 1.0)
    if aim < LEAST_ERROR:
        return None
    plan = _planned(board, board.transient.stop, aim)
    return plan if SMALLER * plan.forecast.error < error else None


def _planned(board: Board, stop: float, aim: float | None = None) -> TransientPlan:
    """Plan a transient of a stable board up to an instant, s."""
    analysis = board.scene.analysis.model_copy(update={"stop": stop})
    scene, steps = board.scene.model_copy(update={"analysis": analysis}), board.plan.by_steps
    return plan_transient(scene, board.linear, board.scales, steps=steps, stable=True, aim=aim)


@dataclass(frozen=True, slots=True, eq=False, repr=False)
class MeasuredTransient(Result):
    """Waveforms of one transient, their measurements, and their file, if there is one."""

    VIEW = "taction.verification.report.views.verdict_view:transient_view"
    DOCUMENT = (
        *("scene = circuit.name", "simulator = waveforms.engine"),
        *("solver = waveforms.solver or null", "method = waveforms.method or null"),
        *("points = waveforms.cost.points", "seconds [s] = waveforms.cost.seconds", "stop [s]"),
        *("step_amplitude [V] = measurements.amplitude",),
        "settling_time [s] = measurements.settling_time.value",
        "channels = verification.verdict.record:channels_of(measurements)",
        "output",
    )

    circuit: Circuit
    transient: Transient
    waveforms: Waveforms
    measurements: Measurements
    output: str | None = None

    @property
    def stop(self) -> float:
        """The last instant, s."""
        return float(self.waveforms.time[-1])

    def __repr__(self) -> str:
        settled, state = self.measurements.settling_time, self.measurements.reason
        if settled is not None:
            state = f"settled at {quantity(settled.value, 's')}"
        return f"{type(self).__name__}({self.circuit.name!r}, {self.waveforms!r}, {state})"


def record_transient(
    scene: Scene,
    progress: Progress = lambda stage: None,
    *,
    problem: InverseProblem | None = None,
) -> MeasuredTransient:
    """Simulate the transient of `scene`, or of another `problem`; measure it without its error.

    InputError, NoVerdictError: as `verify`.
    """
    clock = Clock(progress)
    board = build(scene, clock, problem=problem)
    clock.begin("simulation")
    waveforms = begin(board)().filled
    clock.begin("measures")
    measurements = measure_outputs(board, waveforms)
    return MeasuredTransient(board.circuit, board.transient, waveforms, measurements)
