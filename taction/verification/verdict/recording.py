"""Record transients and measure them, until the error is as small as the scene asks for."""

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
from taction.verification.reference.ideal_answer import IdealAnswer, ideal_answer
from taction.verification.verdict.companion import (
    Agreement,
    StepError,
    compare_engines,
    find_companion,
    measure_outputs,
    measure_with_bounds,
    outputs,
    step_error,
)
from taction.verification.verdict.plan_board import design_board
from taction.verification.verdict.planned_board import PlannedBoard
from taction.verification.verdict.simulation import (
    ENGINES,
    Pending,
    begin,
    bound_after,
    engine_of,
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


@dataclass(frozen=True, slots=True)
class Accuracy:
    """The error of a transient, largest over all outputs and times."""

    wanted: float  # error that the checks allow, fraction of the step amplitude (`wanted_error`)
    # Bound of the error, measured after the run; None if it cannot be measured.
    achieved: float | None
    seconds: float  # wall time of the run (of all tries), s
    points: int  # time points or steps of the run
    # Points on the period of the fastest ringing, averaged over the record.
    points_per_period: float
    # `engine`, `method`: engine and integration method.
    engine: str
    method: str
    how: str  # how `achieved` was measured
    tries: int = 1  # number of runs; 2 or more if the first run did not suffice
    # Whether the scene allows `wanted`; False where it states the steps, of which an error follows
    # that it does not name.
    asked: Annotated[bool, HIDDEN] = True

    @property
    def reached(self) -> bool:
        """Whether the achieved error is known and does not exceed the wanted error."""
        return self.achieved is not None and self.achieved <= self.wanted

    @property
    def missed(self) -> bool:
        """Whether the achieved error is known and exceeds the error that the scene allows."""
        return self.asked and self.achieved is not None and not self.reached

    def after(self, earlier: Accuracy) -> Accuracy:
        """Return this accuracy with the cost of an `earlier` run added."""
        return replace(
            self, seconds=self.seconds + earlier.seconds, tries=self.tries + earlier.tries
        )


def better_plan(recording: Recording, ideal: IdealAnswer) -> TransientPlan | None:
    """Return a plan for a better run; None if the run suffices or no plan would be better."""
    return _longer(recording.design, ideal, recording.measurements) or _finer(recording)


def _longer(
    design: PlannedBoard, ideal: IdealAnswer, measured: Measurements
) -> TransientPlan | None:
    """Plan a longer record if a channel settles only after the end of the record."""
    scene = design.scene
    automatic = scene.analysis.stop == "auto" and design.poles.known_stable
    if not automatic or measured.settling_time is not None or not measured.amplitude:
        return None
    equilibrium = design.board.equilibrium.values
    places = design.board.descriptor.places
    final = np.array([out.sign * equilibrium[places[out.node]] for out in design.circuit.outputs])
    static = float(np.abs(final - ideal.target).max()) / measured.amplitude
    room = INSIDE * (scene.checks.settling_time.band - static)
    if room <= 0.0:
        return None
    stop = max(AFTER_SETTLING * design.scales.stop_for(room), LONGER * design.transient.stop)
    analysis = scene.analysis.model_copy(update={"stop": float(f"{stop:.6g}")})
    longer = scene.model_copy(update={"analysis": analysis})
    steps = ENGINES[design.engine].error is None
    return plan_transient(longer, design.board, design.scales, steps=steps, stable=True)


def _finer(recording: Recording) -> TransientPlan | None:
    """Plan smaller steps if a run with the steps of the plan missed the wanted error."""
    design, achieved = recording.design, recording.achieved
    even = design.scene.analysis.points_per_period is not None
    bounded = engine_of(recording.ends.engine).error is not None
    wanted = design.plan.wanted
    if achieved is None or achieved <= wanted or even or bounded:
        return None
    forecast = design.plan.forecast
    aim = AIM * wanted * min(forecast.error / achieved, 1.0)
    if aim < LEAST_ERROR:
        return None
    analysis = design.scene.analysis.model_copy(update={"stop": design.transient.stop})
    scene = design.scene.model_copy(update={"analysis": analysis})
    plan = plan_transient(scene, design.board, design.scales, stable=True, aim=aim)
    return plan if SMALLER * plan.forecast.error < forecast.error else None


REPEATS = 3  # largest number of repeated runs
REPEAT_FAILED = (
    "a better run ended without a record, so the readings are of the run before it: {reason}"
)


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
        settled = self.measurements.settling_time
        state = (
            self.measurements.reason
            if settled is None
            else f"settled at {quantity(settled.value, 's')}"
        )
        return f"{type(self).__name__}({self.circuit.name!r}, {self.waveforms!r}, {state})"


@dataclass(frozen=True, eq=False)
class Recording:
    """A measured transient with its error."""

    design: PlannedBoard  # the board, with the plan of this record
    # The record, with the remarks of the engine; at least its first and its last point.
    ends: Waveforms
    measurements: Measurements  # measurements on the record
    error: StepError  # error of the readings
    agreement: Agreement | None  # comparison with the other engine; None if only one engine ran
    # Bound of the error of any output at any time, V, NaN if unknown; the method; how the bound was
    # found.
    attained: tuple[float, str, str]
    forever: bool  # whether the measurements are those of the exact solution, which has no end
    # (N,): outputs of the second solution at the record's end, V, or of the record of an engine
    # that bounds its own error; None without either.
    exact_end: Floats | None
    before: Accuracy | None = None  # of the runs that did not suffice

    @cached_property
    def waveforms(self) -> Waveforms:
        """The record with all its points."""
        return self.ends.filled

    @cached_property
    def u(self) -> Floats:
        """Outputs, V, (P, N)."""
        return outputs(self.design.circuit, self.waveforms)

    @property
    def is_stepped(self) -> bool:
        """Whether the record of a stable board is by steps that can be halved."""
        from taction.verification.engines.statespace.transients.stepped import METHOD

        return self.ends.method == METHOD and self.design.poles.known_stable

    @property
    def first_and_last(self) -> Floats:
        """Outputs at the first and at the last instant, V, (2, N)."""
        return outputs(self.design.circuit, self.ends)[[0, -1]]

    @property
    def achieved(self) -> float | None:
        """Bound of the error over all time, in step amplitudes; None if it is unknown."""
        volts = self.attained[0]
        return volts / (self.measurements.amplitude or 1.0) if math.isfinite(volts) else None

    @cached_property
    def accuracy(self) -> Accuracy:
        """The error over all time, and what it cost."""
        cost, (_, method, how) = self.waveforms.cost, self.attained
        found = Accuracy(
            wanted=self.design.plan.wanted,
            achieved=self.achieved,
            seconds=cost.seconds,
            points=cost.points,
            points_per_period=self.design.scales.max_step_for(1.0)
            / (self.design.transient.stop / max(cost.points, 1)),
            engine=self.ends.engine,
            method=method,
            how=how,
            asked=self.design.scene.analysis.points_per_period is None,
        )
        return found if self.before is None else found.after(self.before)


def record_transient(
    scene: Scene,
    progress: Progress = lambda stage: None,
    *,
    problem: InverseProblem | None = None,
) -> MeasuredTransient:
    """Simulate the transient of `scene` and measure the record without its error.

    `problem` replaces the problem of the scene.

    InputError, NoVerdictError: as `taction.verification.verdict.verify.verify`.
    """
    clock = Clock(progress)
    design = design_board(scene, clock, problem=problem)
    clock.begin("simulation")
    with clock.listening():
        pending = begin(design)
        ideal = ideal_answer(design.network, design.scene)
        waveforms = pending.result().filled
    clock.begin("measures")
    measurements = measure_outputs(design, ideal, waveforms)
    return MeasuredTransient(design.circuit, design.transient, waveforms, measurements)


def record_and_measure(
    design: PlannedBoard,
    ideal: IdealAnswer,
    pending: Pending | None,
    clock: Clock,
    known: Measurements | None = None,
) -> Recording:
    """Wait for a simulation, which begins here unless it runs, and measure the record.

    A run that does not suffice is repeated.

    A run that missed the wanted error is repeated with smaller steps, a record that is too short
    for a reading is repeated with a longer stop time; the record stays if its repeat fails. `known`
    are the measurements of `companion.exact_response`, if it has been measured.

    SimulationError: of the first run, as `taction.verification.verdict.simulation.Pending.result`.
    """
    recording = _record(design, ideal, pending, clock, known)
    for _ in range(REPEATS):
        plan = better_plan(recording, ideal)
        if plan is None:
            break
        try:
            repeated = _record(replace(design, plan=plan), ideal, None, clock, known)
        except (StepTooSmall, TimedOut) as error:
            ends = recording.ends
            flag = REPEAT_FAILED.format(reason=str(error).splitlines()[0])
            return replace(recording, ends=replace(ends, flags=(*ends.flags, flag)))
        recording = replace(repeated, before=recording.accuracy)
    return recording


def finest(recording: Recording, ideal: IdealAnswer) -> tuple[Measurements, StepError]:
    """Return the measurements of a better solution, and their errors.

    Those of an exact solution are known to its rounding; steps are halved once more.
    """
    design, wave = recording.design, recording.ends
    own = own_error(design, wave)
    if own is not None:
        if own.record is not wave:
            own = bound_after(recording.attained[0], own)
        wave = own.record
    measured, _ = measure_with_bounds(design, ideal, wave, own, None, finest=True)
    return measured, step_error(measured, math.inf if own is None else own.volts)


def _record(
    design: PlannedBoard,
    ideal: IdealAnswer,
    pending: Pending | None,
    clock: Clock,
    known: Measurements | None,
) -> Recording:
    """Wait for a simulation, which begins here unless it runs, and measure its record."""
    clock.begin("simulation", remark=design.plan.remark)
    wave = (pending or begin(design)).result()
    clock.begin("comparison")
    companion, own = None, own_error(design, wave)
    if own is not None:
        wave = own.record
    elif design.poles.known_stable:
        companion = find_companion(design, wave)
    clock.begin("measures")
    measured, forever = measure_with_bounds(design, ideal, wave, own, companion, known=known)
    amplitude, agreement, exact_end = measured.amplitude, None, None
    error, method = math.nan, str(design.transient.method)
    how, end_error = "the board is unstable: the error grows with the voltages", math.inf
    if own is not None:
        error, method, how = own.volts, own.record.method, own.how
        if math.isfinite(error):
            end_error, exact_end = error, outputs(design.circuit, wave)[-1]
    elif companion is not None:
        error, how = companion.difference + companion.doubt, companion.how
        end_error, exact_end = companion.end_error, companion.other[-1]
        steps = design.plan.forecast.error * amplitude
        unit = design.circuit.value("U0")
        agreement = compare_engines(companion, steps, design.scene.agreement_limit, unit)
    return Recording(
        design=design,
        ends=wave,
        measurements=measured,
        error=step_error(measured, end_error),
        agreement=agreement,
        attained=(error, method, how),
        forever=forever,
        exact_end=None if exact_end is None else np.array(exact_end),
    )
