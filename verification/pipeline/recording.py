"""Record transients and measure them against the reference solution."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from typing import TypedDict

import numpy as np

from netlist_gen.analysis import Transient
from netlist_gen.board.circuit import Circuit
from netlist_gen.problem.inverse_problem import InverseProblem
from netlist_gen.scene.scene import Scene
from spice_models.array_types import Floats
from verification.engines.ngspice.process import PHYSICAL_BOUND
from verification.ideal.ideal_answer import IdealAnswer, ideal_answer
from verification.measures.measure import measure, read_record
from verification.measures.measurements import Measurements
from verification.measures.resampling import CUBIC, lagrange
from verification.pipeline.agreement import (
    Agreement,
    Companion,
    compare_engines,
    exact_companion,
)
from verification.pipeline.attained_accuracy import Accuracy, attained, better_plan
from verification.pipeline.clock import Clock, Progress
from verification.pipeline.design import Design, design_board
from verification.pipeline.effort import Effort
from verification.pipeline.simulation import (
    Pending,
    Simulation,
    begin,
    outputs,
    state_space_tolerance,
)
from verification.pipeline.step_error import StepError, simulation_error, undecided
from verification.pipeline.transient_plan import coarser
from verification.small_signal.step_forecast import MOST_INSTANTS
from verification.waveforms import Waveforms

COARSER = 2.0  # times the step: the step of a second run
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
    scene, circuit, transient = design.scene, design.circuit, design.transient
    stable = design.poles.stable
    clock.begin("simulation", remark=design.plan.remark)
    simulation = pending.result()
    clock.begin("comparison")
    companion = None
    if stable and design.engine == "ngspice":
        companion = _companion(design, simulation.waveforms)
    clock.begin("measures")
    measurements, u = measure_outputs(
        scene, circuit, ideal, simulation.waveforms, transient, details=effort.details
    )
    forever = effort.details or scene.analysis.stop != "auto" or len(u) >= MOST_INSTANTS
    if forever := forever and stable and is_exact(design):
        measurements = _on_the_solution(design, ideal, u[-1])
    amplitude = measurements.amplitude
    agreement = None
    if companion is not None and (companion.share == 1.0 or companion.reason):
        agreement = compare_engines(companion, design.plan.forecast.error * amplitude)
    return Recording(
        simulation=simulation,
        measurements=measurements,
        u=u,
        error=_readings_error(design, ideal, measurements, companion, simulation, effort),
        agreement=agreement,
        accuracy=attained(design, simulation.waveforms, companion, amplitude),
        forever=forever,
    )


def _companion(design: Design, waveforms: Waveforms) -> Companion:
    """Return a second solution for ngspice's record: exact if possible, else at larger steps."""
    tolerance = state_space_tolerance(design.plan.wanted)
    exact = exact_companion(design.board, design.transient, waveforms, tolerance)
    if not exact.reason:
        return exact
    plan = replace(design.plan, transient=coarser(design.transient, COARSER))
    second = begin(design.scene, design.board, plan, design.engine).result().waveforms
    inside = (second.time >= waveforms.time[0]) & (second.time <= waveforms.time[-1])
    instants = np.array(second.time[inside])
    u = lagrange(waveforms.time, outputs(design.circuit, waveforms), instants, CUBIC)
    other, share = outputs(design.circuit, second)[inside], 1.0 / (COARSER**2 - 1.0)
    how = "difference to a run at twice the step, extrapolated"
    return Companion(instants, u, other, share, how, f"no state-space solution: {exact.reason}")


def _readings_error(
    design: Design,
    ideal: IdealAnswer,
    measurements: Measurements,
    companion: Companion | None,
    simulation: Simulation,
    effort: Effort,
) -> StepError:
    """Return the error of the readings, from those of the second solution if it exists."""
    rounding = simulation.waveforms.rounding
    if companion is None and design.engine == "ngspice":
        return simulation_error(measurements, None, math.inf, rounding)
    if companion is None:
        rounding += _rounding(design, measurements) if design.poles.stable else 0.0
        return simulation_error(measurements, None, 0.0, rounding)
    terms = _terms(design.scene, design.circuit, design.transient)
    time, u = companion.instants, companion.other
    readings = read_record(time, u, ideal.target, ideal.start, **terms)
    if undecided(measurements, readings):
        second = measure(time, u, ideal.target, ideal.start, **terms, details=effort.details)
        readings = second.readings
    return simulation_error(measurements, readings, companion.share, rounding)


def _rounding(design: Design, measurements: Measurements) -> float:
    """Return the effect of rounded matrix entries on the equilibrium and the modes, V."""
    poles = design.poles
    # A mode exp(p t) whose p moves by dp moves by dp t exp(p t), at most dp / (e |Re p|).
    modes = measurements.amplitude * poles.resolution / (math.e * abs(poles.rightmost.real))
    return modes + float(design.board.rounding.max(initial=0.0))


def is_exact(design: Design) -> bool:
    """Whether the engine has the exact solution, at any time."""
    small = not (design.circuit.amplifiers or design.board.descriptor.is_large)
    return design.engine == "statespace" and small


def _on_the_solution(design: Design, ideal: IdealAnswer, final: Floats) -> Measurements:
    """Measure the exact solution; `final` remains the end of the record, as for every engine."""
    from verification.small_signal.exact_measures import measure_exact

    measurements = measure_exact(
        design.board,
        ideal.target,
        ideal.start,
        initial=design.transient.initial,
        band=design.scene.checks.settling_time.band,
    )
    ends = zip(measurements.channels, final.tolist(), strict=True)
    return replace(measurements, channels=tuple(replace(c, final=end) for c, end in ends))


def measure_outputs(
    scene: Scene,
    circuit: Circuit,
    ideal: IdealAnswer,
    waveforms: Waveforms,
    transient: Transient,
    *,
    details: bool = True,
) -> tuple[Measurements, Floats]:
    """Measure `waveforms` against the reference; return the measurements and u (P, N), V."""
    u, terms = outputs(circuit, waveforms), _terms(scene, circuit, transient)
    time = waveforms.time
    return measure(time, u, ideal.target, ideal.start, **terms, details=details), u


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
