"""Record transients and measure them against the reference solution."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from typing import TypedDict

from netlist_gen.analysis import Transient
from netlist_gen.board.circuit import Circuit
from netlist_gen.problem.inverse_problem import InverseProblem
from netlist_gen.scene.scene import Scene
from spice_models.array_types import Floats
from spice_models.errors import EngineError
from verification.engines.ngspice.process import PHYSICAL_BOUND
from verification.engines.statespace.transients.exact import ENGINE
from verification.ideal.ideal_answer import IdealAnswer, ideal_answer
from verification.measures.measure import measure, read_record
from verification.measures.measurements import Measurements
from verification.measures.readings import Readings
from verification.pipeline.agreement import Agreement, compare_engines
from verification.pipeline.attained_accuracy import Accuracy, attained, better_plan
from verification.pipeline.clock import Clock, Progress
from verification.pipeline.companion import Companion, find_companion
from verification.pipeline.design import Design, design_board
from verification.pipeline.effort import Effort
from verification.pipeline.simulation import (
    Pending,
    Simulation,
    begin,
    outputs,
    state_space_tolerance,
)
from verification.pipeline.state_space_error import (
    StateSpaceError,
    is_exact,
    state_space_error,
)
from verification.pipeline.step_error import StepError, bounded, step_error, undecided
from verification.small_signal.step_forecast import MOST_INSTANTS
from verification.waveforms import Waveforms

REPEATS = 3  # largest number of repeated runs


@dataclass(frozen=True, slots=True, eq=False, repr=False)
class Record:
    """Waveforms of one transient and their measurements."""

    circuit: Circuit
    transient: Transient
    waveforms: Waveforms
    measurements: Measurements

    def __repr__(self) -> str:
        return f"Record({self.waveforms!r})"


@dataclass(frozen=True, slots=True, eq=False)
class Recording:
    """A measured transient with its error.

    Attributes
    ----------
    simulation : Simulation
        The waveforms.
    measurements : Measurements
        Measurements on the record.
    u : ndarray (P, N)
        Outputs, V.
    error : StepError
        Error of the readings.
    agreement : Agreement or None
        Comparison with the other engine; None if only one engine ran.
    accuracy : Accuracy
        The error over all time.
    forever : bool
        Whether the measurements are those of the exact solution, which has no end.
    """

    simulation: Simulation
    measurements: Measurements
    u: Floats
    error: StepError
    agreement: Agreement | None
    accuracy: Accuracy
    forever: bool


def record_transient(
    scene: Scene,
    progress: Progress = lambda stage: None,
    *,
    problem: InverseProblem | None = None,
) -> Record:
    """Simulate the transient of `scene` and measure the record without its error.

    `problem` replaces the problem of the scene.

    Raises
    ------
    InputError, NoVerdictError
        As `verification.verify.verify`.
    """
    clock = Clock(progress)
    design = design_board(scene, clock, problem=problem)
    clock.begin("simulation")
    pending = begin(design.scene, design.board, design.plan, design.engine)
    ideal = ideal_answer(design.network, design.scene)
    waveforms = pending.result().waveforms
    clock.begin("measures")
    measurements, _ = measure_outputs(
        design.scene, design.circuit, ideal, waveforms, design.transient
    )
    return Record(design.circuit, design.transient, waveforms, measurements)


def record_and_measure(
    design: Design, ideal: IdealAnswer, pending: Pending, clock: Clock, effort: Effort
) -> tuple[Design, Recording]:
    """Wait for a simulation and measure the record; repeat a run that does not suffice.

    A run that missed the wanted error is repeated with smaller steps, a record that is too short
    for a reading is repeated with a longer stop time. The returned design has the plan of the
    returned recording.

    Raises
    ------
    SimulationError
        As `verification.pipeline.simulation.Pending.result`.
    """
    recording = _record(design, ideal, pending, clock, effort)
    for _ in range(REPEATS):
        plan = better_plan(design, ideal, recording.measurements, recording.accuracy)
        if plan is None:
            break
        design = replace(design, plan=plan)
        clock.begin("simulation", remark=plan.remark)
        pending = begin(design.scene, design.board, plan, design.engine, session=effort.session)
        repeated = _record(design, ideal, pending, clock, effort)
        recording = replace(repeated, accuracy=repeated.accuracy.after(recording.accuracy))
    return design, recording


def _record(
    design: Design, ideal: IdealAnswer, pending: Pending, clock: Clock, effort: Effort
) -> Recording:
    scene, stable = design.scene, design.poles.stable
    clock.begin("simulation", remark=design.plan.remark)
    simulation = pending.result()
    wave = simulation.waveforms
    clock.begin("comparison")
    companion, own = None, None
    if wave.engine == ENGINE:
        tolerance = state_space_tolerance(design.plan.wanted)
        own = state_space_error(design.board, design.transient, wave, tolerance)
    elif stable:
        companion = find_companion(design, wave)
    clock.begin("measures")
    error = _record_error(own, companion)
    measured, u = measure_outputs(
        scene, design.circuit, ideal, wave, design.transient, error=error, details=effort.details
    )
    asked = effort.details or scene.analysis.stop != "auto" or len(u) >= MOST_INSTANTS
    solution = None
    if stable and is_exact(design.board) and (asked if companion is None else companion.exact):
        solution = _on_the_solution(design, ideal)
    forever = own is not None and solution is not None
    other = None
    if companion is not None and companion.exact:
        other = _other_readings(design, ideal, measured, companion, solution, effort)
        measured = bounded(measured, other)
    elif forever and solution is not None:
        measured = _ending(solution, u[-1])
    elif not math.isfinite(error):
        measured = bounded(measured, None)
    amplitude, agreement = measured.amplitude, None
    if companion is not None:
        steps = design.plan.forecast.error * amplitude
        agreement = compare_engines(companion, steps, scene.agreement_limit)
    end_error = error if companion is None else companion.end_error
    return Recording(
        simulation=simulation,
        measurements=measured,
        u=u,
        error=step_error(measured, end_error, other),
        agreement=agreement,
        accuracy=attained(design, wave, own, companion, amplitude),
        forever=forever,
    )


def _record_error(own: StateSpaceError | None, companion: Companion | None) -> float:
    """Return the bound of a record's error by which its readings are bounded, V.

    0 for a record of ngspice whose readings are compared with those of a better solution; infinite
    if nothing is known.
    """
    if companion is not None:
        return 0.0 if companion.exact else companion.difference
    return own.volts if own is not None and math.isfinite(own.volts) else math.inf


def _other_readings(
    design: Design,
    ideal: IdealAnswer,
    measured: Measurements,
    companion: Companion,
    solution: Measurements | None,
    effort: Effort,
) -> Readings:
    """Return the readings of the state-space engine beside those of ngspice."""
    if solution is not None:
        return solution.readings
    terms = _terms(design.scene, design.circuit, design.transient)
    time, u, error = companion.time, companion.values, companion.doubt + _target_error(ideal)
    readings = read_record(time, u, ideal.target, ideal.start, **terms, error=error)
    if not undecided(measured, readings):
        return readings
    details = effort.details
    second = measure(time, u, ideal.target, ideal.start, **terms, error=error, details=details)
    return second.readings


def _target_error(ideal: IdealAnswer) -> float:
    """Return the bound of the error of an output's distance from the reference, V.

    The error of the reference moves the distance, and as step amplitude the band.
    """
    return 2.0 * ideal.solution.error_bound * ideal.network.U0


def _on_the_solution(design: Design, ideal: IdealAnswer) -> Measurements | None:
    """Measure the exact solution of a linear board; None if its modes are not all stable."""
    from verification.small_signal.exact_measures import measure_exact

    try:
        return measure_exact(
            design.board,
            ideal.target,
            ideal.start,
            initial=design.transient.initial,
            band=design.scene.checks.settling_time.band,
            target_error=_target_error(ideal),
        )
    except EngineError:
        return None


def _ending(measured: Measurements, final: Floats) -> Measurements:
    """Return measurements of a solution without an end, with the end of the record in them."""
    ends = zip(measured.channels, final.tolist(), strict=True)
    return replace(measured, channels=tuple(replace(c, final=end) for c, end in ends))


def measure_outputs(
    scene: Scene,
    circuit: Circuit,
    ideal: IdealAnswer,
    waveforms: Waveforms,
    transient: Transient,
    *,
    error: float = 0.0,
    details: bool = True,
) -> tuple[Measurements, Floats]:
    """Measure `waveforms` against the reference; return the measurements and u (P, N), V.

    `error` bounds the error of the waveforms, V; the readings have no bound if it is infinite.
    """
    u, terms = outputs(circuit, waveforms), _terms(scene, circuit, transient)
    time, target, start = waveforms.time, ideal.target, ideal.start
    error = error + _target_error(ideal) if math.isfinite(error) else 0.0
    return measure(time, u, target, start, **terms, error=error, details=details), u


class _Terms(TypedDict):
    """Arguments of `measure` and `read_record` in addition to the record and its target."""

    band: float
    bound: float
    expected_stop: float


def _terms(scene: Scene, circuit: Circuit, transient: Transient) -> _Terms:
    return {
        "band": scene.checks.settling_time.band,
        "bound": PHYSICAL_BOUND * circuit.scalings.unit_voltage,
        "expected_stop": transient.stop,
    }
