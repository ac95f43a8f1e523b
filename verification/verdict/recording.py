"""Record transients and measure them against the reference solution."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

import numpy as np

from taction.netlist_gen.analysis import Transient
from taction.netlist_gen.board.circuit import Circuit
from taction.netlist_gen.scene.inverse_problem import InverseProblem
from taction.netlist_gen.scene.scene import Scene
from taction.system.array_types import Floats
from taction.system.quantities import quantity
from taction.verification.readings.measurements import Measurements
from taction.verification.reference.ideal_answer import IdealAnswer, ideal_answer
from taction.verification.verdict.attained_accuracy import Accuracy, attained, better_plan
from taction.verification.verdict.bounded_measures import (
    StepError,
    measure_outputs,
    measure_with_bounds,
    step_error,
)
from taction.verification.verdict.companion import (
    Agreement,
    Companion,
    compare_engines,
    find_companion,
)
from taction.verification.verdict.design import design_board
from taction.verification.verdict.planned_board import PlannedBoard
from taction.verification.verdict.progress import Clock, Progress
from taction.verification.verdict.simulation import (
    Pending,
    Simulation,
    begin,
    outputs,
    own_error,
)
from taction.verification.verdict.state_space_error import StateSpaceError
from taction.verification.waveforms import Waveforms

REPEATS = 3  # largest number of repeated runs


@dataclass(frozen=True, slots=True, eq=False, repr=False)
class Record:
    """Waveforms of one transient and their measurements."""

    circuit: Circuit
    transient: Transient
    waveforms: Waveforms
    measurements: Measurements

    def __repr__(self) -> str:
        settled = self.measurements.settling_time
        state = (
            self.measurements.reason
            if settled is None
            else f"settled at {quantity(settled.value, 's')}"
        )
        return f"Record({self.circuit.name!r}, {self.waveforms!r}, {state})"


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
    exact_end : ndarray (N,) or None
        Outputs of the second solution at the record's end, V, or of the record if it is exact
        itself; None without a second solution.
    """

    simulation: Simulation
    measurements: Measurements
    u: Floats
    error: StepError
    agreement: Agreement | None
    accuracy: Accuracy
    forever: bool
    exact_end: Floats | None


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
        As `taction.verification.verdict.verify.verify`.
    """
    clock = Clock(progress)
    design = design_board(scene, clock, problem=problem)
    clock.begin("simulation")
    pending = begin(design)
    ideal = ideal_answer(design.network, design.scene)
    waveforms = pending.result().waveforms
    clock.begin("measures")
    measurements, _ = measure_outputs(design, ideal, waveforms)
    return Record(design.circuit, design.transient, waveforms, measurements)


def record_and_measure(
    design: PlannedBoard, ideal: IdealAnswer, pending: Pending, clock: Clock
) -> tuple[PlannedBoard, Recording]:
    """Wait for a simulation and measure the record; repeat a run that does not suffice.

    A run that missed the wanted error is repeated with smaller steps, a record that is too short
    for a reading is repeated with a longer stop time. The returned design has the plan of the
    returned recording.

    Raises
    ------
    SimulationError
        As `taction.verification.verdict.simulation.Pending.result`.
    """
    recording = _record(design, ideal, pending, clock)
    for _ in range(REPEATS):
        plan = better_plan(design, ideal, recording.measurements, recording.accuracy)
        if plan is None:
            break
        design = replace(design, plan=plan)
        clock.begin("simulation", remark=plan.remark)
        pending = begin(design)
        repeated = _record(design, ideal, pending, clock)
        recording = replace(repeated, accuracy=repeated.accuracy.after(recording.accuracy))
    return design, recording


def _record(design: PlannedBoard, ideal: IdealAnswer, pending: Pending, clock: Clock) -> Recording:
    clock.begin("simulation", remark=design.plan.remark)
    simulation = pending.result()
    wave = simulation.waveforms
    clock.begin("comparison")
    companion, own = None, own_error(design, wave)
    if own is None and design.poles.known_stable:
        companion = find_companion(design, wave)
    clock.begin("measures")
    found = measure_with_bounds(design, ideal, wave, own, companion)
    amplitude, agreement = found.measurements.amplitude, None
    if companion is not None:
        steps = design.plan.forecast.error * amplitude
        unit = design.circuit.value("U0")
        agreement = compare_engines(companion, steps, design.scene.agreement_limit, unit)
    return Recording(
        simulation=simulation,
        measurements=found.measurements,
        u=found.u,
        error=step_error(found.measurements, found.end_error),
        agreement=agreement,
        accuracy=attained(design, wave, own, companion, amplitude),
        forever=found.forever,
        exact_end=_exact_end(design, found.u[-1], own, companion),
    )


def _exact_end(
    design: PlannedBoard, end: Floats, own: StateSpaceError | None, companion: Companion | None
) -> Floats | None:
    """Return the outputs of the second solution at the record's end, V, (N,)."""
    if companion is not None:
        return np.array(companion.other[-1])
    if own is None or not math.isfinite(own.volts):
        return None
    return end if own.second is None else np.array(outputs(design.circuit, own.second)[-1])
