"""Transients recorded and measured against the reference; nothing is judged here."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from typing import TypedDict

from netlist_gen.analysis import Transient
from netlist_gen.board.circuit import Circuit
from netlist_gen.problem.inverse_problem import InverseProblem
from netlist_gen.scene.scene import Scene
from spice_models.array_types import Floats
from verification.engines.ngspice.process import PHYSICAL_BOUND
from verification.engines.statespace.linearised.equilibrium import rounding as rounding_at_rest
from verification.ideal.ideal_answer import IdealAnswer, ideal_answer
from verification.measures.measure import measure, read_record
from verification.measures.measurements import Measurements
from verification.pipeline.agreement import Agreement, compare_engines, exact_record, other_engine
from verification.pipeline.attained_accuracy import Accuracy, attained, both_tries, finer
from verification.pipeline.clock import Clock, Progress
from verification.pipeline.design import Design, design_board
from verification.pipeline.effort import Effort
from verification.pipeline.simulation import Pending, Simulation, begin, outputs
from verification.pipeline.step_error import StepError, simulation_error, undecided
from verification.waveforms import Waveforms


@dataclass(frozen=True, slots=True, eq=False, repr=False)
class Record:
    """Waveforms of one transient and what was measured on them."""

    circuit: Circuit
    transient: Transient
    waveforms: Waveforms
    measurements: Measurements

    def __repr__(self) -> str:
        return f"Record({self.waveforms!r})"


@dataclass(frozen=True, slots=True, eq=False)
class Recording:
    """A transient with what tells its error.

    Attributes
    ----------
    simulation : Simulation
        The waveforms.
    measurements : Measurements
        Of the finer run.
    u : ndarray (P, N)
        Outputs of the finer run, V.
    error : StepError
        The simulation's own.
    agreement : Agreement or None
        With the other engine; None where only one ran.
    accuracy : Accuracy or None
        The error over all time; None where the scene asks for none.
    """

    simulation: Simulation
    measurements: Measurements
    u: Floats
    error: StepError
    agreement: Agreement | None
    accuracy: Accuracy | None


def record_transient(
    scene: Scene,
    progress: Progress = lambda stage: None,
    *,
    problem: InverseProblem | None = None,
) -> Record:
    """Simulate the transient of `scene` once, without a second look at another step.

    `problem` replaces the scene's own.

    Raises
    ------
    InputError, NoVerdictError
        As `verification.verify.verify`.
    """
    clock = Clock(progress)
    design = design_board(scene, clock, problem=problem)
    clock.begin("simulation")
    once = Effort(second_look=False)
    pending = begin(design.scene, design.board, design.transient, design.engine, once)
    ideal = ideal_answer(design.network, design.scene)
    waveforms = pending.result().fine
    clock.begin("measures")
    measurements, _ = measure_outputs(
        design.scene, design.circuit, ideal, waveforms, design.transient
    )
    return Record(design.circuit, design.transient, waveforms, measurements)


def attempt(
    design: Design, ideal: IdealAnswer, pending: Pending, clock: Clock, effort: Effort
) -> tuple[Design, Recording]:
    """Do as `watch`, and again with a smaller step where the wanted error was missed.

    The design that is returned has the step of the recording.
    """
    seen = watch(design, ideal, pending, clock, effort)
    better = finer(design, seen.accuracy)
    if seen.accuracy is None or better is None:
        return design, seen
    clock.begin("simulation")
    pending = begin(better.scene, better.board, better.transient, better.engine, effort)
    again = watch(better, ideal, pending, clock, effort)
    return better, replace(again, accuracy=both_tries(seen.accuracy, again.accuracy))


def watch(
    design: Design, ideal: IdealAnswer, pending: Pending, clock: Clock, effort: Effort
) -> Recording:
    """Wait for a simulation under way, do what can be done meanwhile, and measure it.

    The coarser run ends while the finer one is under way; it is read, and the other engine run, in
    that time. Without a second look the state-space engine takes the coarser run's place. It is
    judged only where its readings alone do not tell the finer run's error.
    With details, times on an exact solution are found by root finding, not on its grid.

    Raises
    ------
    SimulationError
        As `verification.pipeline.simulation.Pending.result`.
    """
    scene, circuit, transient = design.scene, design.circuit, design.transient
    stable = design.poles.stable
    clock.begin("simulation")
    second, share = pending.second_look(), pending.share
    clock.begin("second look", beside="simulation")
    if not effort.second_look and share and stable:
        second, share = exact_record(design.board, transient), 1.0
    coarse = other = None
    if second is not None:
        terms = _terms(scene, circuit, transient)
        there = outputs(circuit, second)
        coarse = read_record(second.time, there, ideal.target, ideal.start, **terms)
    if second is not None and effort.second_look and stable:
        other = other_engine(design.board, transient, second)
    clock.begin("simulation")
    simulation = pending.result(running_away=not stable)
    clock.begin("measures")
    fine, u = measure_outputs(
        scene, circuit, ideal, simulation.fine, transient, details=effort.details
    )
    if effort.details and stable and _is_exact(design):
        fine = _on_the_solution(design, ideal, u[-1])
    if math.isinf(simulation.share):  # the record ends early: nothing tells its error
        coarse, share = None, math.inf
    if second is not None and coarse is not None and undecided(fine, coarse):
        again, _ = measure_outputs(scene, circuit, ideal, second, transient, details=effort.details)
        coarse = again.readings
    rounding = simulation.fine.rounding + (0.0 if share or not stable else _rounding(design, fine))
    error = simulation_error(fine, coarse, share, rounding)
    agreement = compare_engines(circuit, simulation, other) if other is not None else None
    accuracy = attained(design, simulation, fine.amplitude)
    return Recording(simulation, fine, u, error, agreement, accuracy)


def _rounding(design: Design, found: Measurements) -> float:
    """Return what rounding of the board's stamped values moves its equilibrium and modes by, V."""
    poles = design.poles
    # A mode exp(p t) whose p moves by dp moves by dp t exp(p t), at most dp / (e |Re p|).
    modes = found.amplitude * poles.resolution / (math.e * abs(poles.rightmost.real))
    return modes + float(rounding_at_rest(design.board.equilibrium).max(initial=0.0))


def _is_exact(design: Design) -> bool:
    small = not (design.circuit.amplifiers or design.board.descriptor.is_large)
    return design.engine == "statespace" and design.scene.analysis.stop == "auto" and small


def _on_the_solution(design: Design, ideal: IdealAnswer, final: Floats) -> Measurements:
    """Measure the exact solution; `final` stays the end of the record, as for every engine."""
    from verification.small_signal.exact_measures import measure_exact

    found = measure_exact(
        design.board,
        ideal.target,
        ideal.start,
        initial=design.transient.initial,
        band=design.scene.checks.settling_time.band,
    )
    ends = zip(found.channels, final.tolist(), strict=True)
    return replace(found, channels=tuple(replace(c, final=end) for c, end in ends))


def measure_outputs(
    scene: Scene,
    circuit: Circuit,
    ideal: IdealAnswer,
    waveforms: Waveforms,
    transient: Transient,
    *,
    details: bool = True,
) -> tuple[Measurements, Floats]:
    """Measure `waveforms` against the reference; return the measures and u (P, N), V."""
    u, terms = outputs(circuit, waveforms), _terms(scene, circuit, transient)
    found = measure(waveforms.time, u, ideal.target, ideal.start, **terms, details=details)
    return found, u


class _Terms(TypedDict):
    """What `measure` and `read_record` are told besides the record and where it should go."""

    band: float
    bound: float
    expected_stop: float


def _terms(scene: Scene, circuit: Circuit, transient: Transient) -> _Terms:
    return {
        "band": scene.checks.settling_time.band,
        "bound": PHYSICAL_BOUND * circuit.scalings.unit_voltage,
        "expected_stop": transient.stop,
    }
