"""Verify a scene: circuit, deck, waveforms, measurements, checks, verdict."""

from __future__ import annotations

from dataclasses import dataclass

from taction.netlist_gen.analysis import Transient
from taction.netlist_gen.board.circuit import Circuit
from taction.netlist_gen.board.part_warnings import part_warnings
from taction.netlist_gen.scene.inverse_problem import InverseProblem
from taction.netlist_gen.scene.questions import questions
from taction.netlist_gen.scene.scene import Scene, opamp_words
from taction.system.array_types import Floats
from taction.system.quantities import sizes
from taction.system.waveforms import Waveforms
from taction.verification.engines.statespace.linearised.board import LinearBoard
from taction.verification.readings.constraint_stage import ConstraintPlane, constraint_plane
from taction.verification.readings.measurements import Measurements
from taction.verification.reference.ideal_answer import (
    EnergyRise,
    IdealAnswer,
    energy_rise,
    ideal_answer,
)
from taction.verification.stability.margin import REACH, Margin, stability_margin
from taction.verification.stability.poles import Poles
from taction.verification.verdict.bounded_measures import StepError
from taction.verification.verdict.checks import Check, Evidence, Outcome, overall
from taction.verification.verdict.companion import Agreement
from taction.verification.verdict.design import design_board
from taction.verification.verdict.error_budget import ErrorBudget, error_budget
from taction.verification.verdict.headroom import PartLoads
from taction.verification.verdict.output_noise import OutputNoise
from taction.verification.verdict.planned_board import PlannedBoard, SteadyState
from taction.verification.verdict.progress import FULL, Clock, Effort, Progress
from taction.verification.verdict.recording import Accuracy, Recording, record_and_measure
from taction.verification.verdict.run_checks import run_checks
from taction.verification.verdict.simulation import begin
from taction.verification.verdict.warnings import (
    find_contradiction,
    find_warnings,
    missing_witness,
    notes,
)


@dataclass(frozen=True, slots=True, eq=False, repr=False)
class Verdict:
    """All results of `verify`; `outcome` is the overall result."""

    scene: Scene
    problem: InverseProblem
    circuit: Circuit
    transient: Transient
    ideal: IdealAnswer
    poles: Poles
    steady: SteadyState
    margin: Margin | None
    constraint: ConstraintPlane | None
    waveforms: Waveforms
    u: Floats
    measurements: Measurements
    error: StepError
    accuracy: Accuracy
    agreement: Agreement | None
    energy: EnergyRise | None
    budget: ErrorBudget
    parts: PartLoads
    noise: OutputNoise | None
    checks: tuple[Check, ...]
    warnings: tuple[str, ...]
    outcome: Outcome
    timing: dict[str, float]

    def __repr__(self) -> str:
        outcome, circuit = self.outcome.value, self.circuit
        named = [check.name for check in self.checks if check.outcome is self.outcome]
        if self.outcome is not Outcome.PASS:
            outcome += f" ({', '.join(named)})"
        parts = (
            sizes(len(circuit.outputs), len(circuit.constraint_nodes)),
            circuit.values,
            f"op-amp {opamp_words(self.scene.design.opamp)}",
        )
        engine = self.waveforms.engine
        return f"Verdict({self.scene.name!r}, {outcome}, {engine}; {', '.join(parts)})"


def verify(
    scene: Scene,
    progress: Progress = lambda stage: None,
    *,
    problem: InverseProblem | None = None,
    circuit: Circuit | LinearBoard | None = None,
    ideal: IdealAnswer | None = None,
    effort: Effort = FULL,
) -> Verdict:
    """Verify a scene: simulate its board, solve its problem, and compare the results.

    Parameters
    ----------
    scene : Scene
        Problem, design, analysis and checks.
    progress : callable, optional
        Called with the name of each stage when the stage begins.
    problem : InverseProblem, optional
        Problem of the scene, if it has been made before; its files are then not read.
    circuit : Circuit, optional
        The board to verify; the default is the synthesised board of the scene.
    ideal : IdealAnswer, optional
        Reference solution, if it has been computed before.
    effort : Effort, optional
        Which results to compute in addition to the checks.

    Raises
    ------
    InputError
        The scene's files or numbers cannot be used.
    NoVerdictError
        No engine was found, or the simulation or the reference solution failed.
    """
    clock = Clock(progress)
    design = design_board(scene, clock, problem=problem, circuit=circuit)
    clock.begin("simulation", remark=design.plan.remark)
    pending = begin(design)
    clock.begin("reference", beside="simulation", remark=design.plan.remark)
    ideal = ideal_answer(design.network, design.scene) if ideal is None else ideal
    known = _Known.of(design, effort)
    design, recording = record_and_measure(design, ideal, pending, clock)
    return _verdict(design, ideal, recording, known, effort, clock)


@dataclass(frozen=True, slots=True, eq=False)
class _Known:
    """What the equations of a board say about it, computed while its simulation runs."""

    steady: SteadyState
    margin: Margin | None
    parts: PartLoads
    noise: OutputNoise | None
    constraint: ConstraintPlane | None

    @classmethod
    def of(cls, design: PlannedBoard, effort: Effort) -> _Known:
        required = design.scene.checks.stability.margin
        reach = max(required, REACH) if effort.full_margin else required
        constraint = constraint_plane(design.circuit) if effort.details else None
        asked = required > 1.0
        margin = stability_margin(design.board, reach, design.poles) if asked else None
        steady = SteadyState.of(design.board, design.scales)
        return cls(steady, margin, design.loads(), OutputNoise.of(design), constraint)


def _evidence(
    design: PlannedBoard, ideal: IdealAnswer, recording: Recording, known: _Known
) -> Evidence:
    """Return what the checks judge."""
    return Evidence(
        checks=design.scene.checks,
        measurements=recording.measurements,
        error=recording.error,
        steady=known.steady,
        end=float(recording.simulation.waveforms.time[-1]),
        forever=recording.forever,
        wanted=design.plan.wanted,
        agreement=recording.agreement,
        poles=design.poles,
        margin=known.margin,
        reference_error=ideal.error,
        reference_problem=ideal.problem,
        contradiction=find_contradiction(design.circuit, ideal, recording.u[0]),
        parts=known.parts,
        noise=known.noise,
        unwitnessed=missing_witness(design.circuit, design.engine),
        design=design,
        recording=recording,
    )


def _verdict(
    design: PlannedBoard,
    ideal: IdealAnswer,
    recording: Recording,
    known: _Known,
    effort: Effort,
    clock: Clock,
) -> Verdict:
    """Judge a recording, and add the details that `effort` asks for."""
    evidence, wave = _evidence(design, ideal, recording, known), recording.simulation.waveforms
    checks = run_checks(evidence)
    energy = energy_rise(design.network, wave.time, recording.u) if effort.details else None
    clock.begin("error budget")
    budget = ErrorBudget()
    if effort.details:
        budget = error_budget(design, ideal, recording, known.noise)
    clock.end()
    return Verdict(
        scene=design.scene,
        problem=design.problem,
        circuit=design.circuit,
        transient=design.transient,
        ideal=ideal,
        poles=design.poles,
        steady=known.steady,
        margin=known.margin,
        constraint=known.constraint,
        waveforms=wave,
        u=recording.u,
        measurements=recording.measurements,
        error=recording.error,
        accuracy=recording.accuracy,
        agreement=recording.agreement,
        energy=energy,
        budget=budget,
        parts=known.parts,
        noise=known.noise,
        checks=checks,
        warnings=_warnings(design, recording, evidence),
        outcome=overall(checks),
        timing=clock.seconds,
    )


def _warnings(design: PlannedBoard, recording: Recording, evidence: Evidence) -> tuple[str, ...]:
    """Return the warnings of the scene, the parts, the plan, the engine and the readings."""
    known = (
        *questions(design.scene),
        *recording.simulation.notes,
        *design.plan.notes,
        *part_warnings(design.circuit),
        *notes(design.circuit),
    )
    return find_warnings(evidence, known)
