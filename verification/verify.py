"""The pipeline: scene, circuit, deck, waveforms, measurements, verdict."""

from __future__ import annotations

from dataclasses import dataclass

from netlist_gen.analysis import Transient
from netlist_gen.board.circuit import Circuit
from netlist_gen.problem.inverse_problem import InverseProblem
from netlist_gen.scene.scene import Scene
from spice_models.array_types import Floats
from verification.engines.statespace.linearised.board import LinearBoard
from verification.ideal.energy_rise import EnergyRise, energy_rise
from verification.ideal.ideal_answer import IdealAnswer, ideal_answer
from verification.measures.measurements import Measurements
from verification.pipeline.agreement import Agreement
from verification.pipeline.attained_accuracy import Accuracy
from verification.pipeline.checks import Check, Evidence, Outcome, overall, run_checks
from verification.pipeline.clock import Clock, Progress
from verification.pipeline.design import Design, design_board
from verification.pipeline.effort import FULL, Effort
from verification.pipeline.error_budget import ErrorPart, error_budget
from verification.pipeline.recording import attempt
from verification.pipeline.simulation import begin
from verification.pipeline.step_error import StepError
from verification.pipeline.warnings import find_warnings
from verification.small_signal.constraint_stage import ConstraintPlane, constraint_plane
from verification.small_signal.margin import REACH, Margin, capacitance_margin
from verification.small_signal.poles import Poles
from verification.waveforms import Waveforms


@dataclass(frozen=True, slots=True, eq=False, repr=False)
class Verdict:
    """Everything that `verify` found; `outcome` sums it up."""

    scene: Scene
    problem: InverseProblem
    circuit: Circuit
    transient: Transient
    ideal: IdealAnswer
    poles: Poles
    margin: Margin | None
    constraint: ConstraintPlane | None
    waveforms: Waveforms
    u: Floats
    measurements: Measurements
    error: StepError
    accuracy: Accuracy | None
    agreement: Agreement | None
    energy: EnergyRise | None
    budget: tuple[ErrorPart, ...]
    checks: tuple[Check, ...]
    warnings: tuple[str, ...]
    outcome: Outcome
    timing: dict[str, float]

    def __repr__(self) -> str:
        return f"Verdict({self.scene.name!r}, {self.outcome.value}, {self.waveforms.engine})"


def verify(
    scene: Scene,
    progress: Progress = lambda stage: None,
    *,
    problem: InverseProblem | None = None,
    circuit: Circuit | LinearBoard | None = None,
    ideal: IdealAnswer | None = None,
    effort: Effort = FULL,
) -> Verdict:
    """Verify a scene: simulate its board, solve its problem, compare.

    Parameters
    ----------
    scene : Scene
        What is asked for.
    progress : callable, optional
        Told the name of each stage as it begins.
    problem : InverseProblem, optional
        The scene's problem where it is at hand already; its files are not read then.
    circuit : Circuit, optional
        The board to verify in place of the one that the scene's synthesis would give.
    ideal : IdealAnswer, optional
        The problem's own answer where it is at hand already.
    effort : Effort, optional
        What is left out.

    Raises
    ------
    InputError
        The scene's files or numbers cannot be used.
    NoVerdictError
        No engine, or no trustworthy answer.
    """
    clock = Clock(progress)
    design = design_board(scene, clock, problem=problem, circuit=circuit)
    clock.begin("simulation")
    pending = begin(design.scene, design.board, design.transient, design.engine, effort)
    clock.begin("reference", beside="simulation")
    ideal = ideal_answer(design.network, design.scene) if ideal is None else ideal
    margin = _margin(design, effort.full_margin)
    rest = design.board.equilibrium if effort.details else None
    constraint = constraint_plane(design.circuit) if effort.details else None
    design, seen = attempt(design, ideal, pending, clock, effort)
    wave = seen.simulation.fine
    evidence = Evidence(
        checks=design.scene.checks,
        measurements=seen.measurements,
        error=seen.error,
        agreement=seen.agreement,
        poles=design.poles,
        margin=margin,
        reference_error=ideal.error,
        reference_problem=ideal.problem,
    )
    checks = run_checks(evidence)
    energy = energy_rise(design.network, wave.time, seen.u) if effort.details else None
    own_error = seen.error.steady_state * seen.measurements.amplitude
    budget = () if rest is None else error_budget(design, ideal, rest, seen.u[-1], own_error)
    clock.end()
    return Verdict(
        scene=design.scene,
        problem=design.problem,
        circuit=design.circuit,
        transient=design.transient,
        ideal=ideal,
        poles=design.poles,
        margin=margin,
        constraint=constraint,
        waveforms=wave,
        u=seen.u,
        measurements=seen.measurements,
        error=seen.error,
        accuracy=seen.accuracy,
        agreement=seen.agreement,
        energy=energy,
        budget=budget,
        checks=checks,
        warnings=find_warnings(evidence, seen.simulation.notes),
        outcome=overall(checks),
        timing=clock.seconds,
    )


def _margin(design: Design, full: bool) -> Margin | None:
    wanted = design.scene.checks.stability.margin
    if wanted <= 1.0:
        return None
    reach = max(wanted, REACH) if full else wanted
    return capacitance_margin(design.board, reach, design.poles)
