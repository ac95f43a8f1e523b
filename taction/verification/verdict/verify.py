"""Verify a scene: circuit, deck, waveforms, measurements, checks, verdict."""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property, partial
from typing import TYPE_CHECKING

from taction.netlist_gen.analysis import Transient
from taction.netlist_gen.board.circuit import Circuit
from taction.netlist_gen.scene.inverse_problem import InverseProblem
from taction.netlist_gen.scene.scene import Scene, opamp_words
from taction.system.after_result import attempt
from taction.system.array_types import Floats
from taction.system.progress import Clock, Progress
from taction.system.quantities import sizes
from taction.system.results import RENDERERS, Result, load
from taction.system.waveforms import Waveforms
from taction.verification.engines.statespace.linearised.board import LinearBoard
from taction.verification.readings.measurements import Measurements
from taction.verification.reference.ideal_answer import (
    EnergyRise,
    IdealAnswer,
    energy_rise,
    ideal_answer,
)
from taction.verification.stability.margin import REACH, Margin, MarginSearch, find_margin
from taction.verification.stability.poles import Poles
from taction.verification.verdict.answer_error import AnswerError
from taction.verification.verdict.checks import Check, Evidence, Outcome, overall
from taction.verification.verdict.companion import Agreement, StepError
from taction.verification.verdict.design import design_board
from taction.verification.verdict.error_budget import ErrorBudget, error_budget
from taction.verification.verdict.headroom import PartLoads
from taction.verification.verdict.output_noise import OutputNoise
from taction.verification.verdict.planned_board import PlannedBoard, SteadyState
from taction.verification.verdict.recording import Accuracy, Recording, finest, record_and_measure
from taction.verification.verdict.run_checks import could_be_finer, run_checks
from taction.verification.verdict.simulation import Pending, begin
from taction.verification.verdict.warnings import all_warnings, find_contradiction, missing_witness

if TYPE_CHECKING:
    from taction.verification.verdict.active_sets import VisitedSet


@dataclass(frozen=True, slots=True)
class Effort:
    """Results that a verification computes in addition to the checks.

    No outcome and no reading of a check depends on these choices.

    Attributes
    ----------
    details : bool
        Whether to compute the error budget and the energy.
    full_margin : bool
        Whether to scan the stability margin up to `REACH`, not only up to the limit of the scene.
    """

    details: bool = True
    full_margin: bool = True


FULL = Effort()


@dataclass(frozen=True, eq=False, repr=False)
class Verdict(Result):
    """All results of `verify`; ``print`` shows one screen, `outcome` is the overall result."""

    VIEW = "taction.verification.report.views.verdict:view"
    SCREEN = "taction.verification.report.views.verdict_screen:screen"
    CARD = "Verdict"
    DOCUMENT = "taction.verification.report.documents.verdict:VerdictBody.of"

    recording: Recording
    ideal: IdealAnswer
    evidence: Evidence
    checks: tuple[Check, ...]
    answer: AnswerError
    energy: EnergyRise | None
    budget: ErrorBudget
    failures: tuple[str, ...]
    timing: dict[str, float]

    @property
    def outcome(self) -> Outcome:
        """The outcome of all checks."""
        return overall(self.checks)

    @property
    def scene(self) -> Scene:
        """The scene, with a number for lambda."""
        return self.recording.design.scene

    @property
    def problem(self) -> InverseProblem:
        """The problem of the scene."""
        return self.recording.design.problem

    @property
    def circuit(self) -> Circuit:
        """The circuit of the board."""
        return self.recording.design.circuit

    @property
    def transient(self) -> Transient:
        """The transient that was simulated."""
        return self.recording.design.transient

    @property
    def poles(self) -> Poles:
        """The poles of the board."""
        return self.evidence.poles

    @property
    def steady(self) -> SteadyState:
        """The equilibrium of the board at its outputs."""
        return self.evidence.steady

    @property
    def margin(self) -> Margin | None:
        """The stability margin; None if the scene asks for none."""
        return self.evidence.margin

    @property
    def measurements(self) -> Measurements:
        """The readings of the record, whose errors `error` bounds."""
        return self.recording.measurements

    @property
    def error(self) -> StepError:
        """Bounds on the errors of the readings."""
        return self.recording.error

    @property
    def agreement(self) -> Agreement | None:
        """How far the engines differ; None if only one ran, or if the board is unstable."""
        return self.evidence.agreement

    @property
    def parts(self) -> PartLoads:
        """What the op-amps have to do, beside their limits."""
        return self.evidence.parts

    @property
    def noise(self) -> OutputNoise | None:
        """Noise of the outputs; None if the scene has no limit for it."""
        return self.evidence.noise

    @property
    def waveforms(self) -> Waveforms:
        """The record, with the remarks of the engine."""
        return self.recording.waveforms

    @property
    def u(self) -> Floats:
        """Outputs over time, V, (P, N)."""
        return self.recording.u

    @property
    def accuracy(self) -> Accuracy:
        """The error of the transient over all time."""
        return self.recording.accuracy

    @cached_property
    def active_sets(self) -> tuple[VisitedSet, ...]:
        """The active sets of a board of piecewise linear amplifiers that the transient visits."""
        if self.circuit.is_linear:
            return ()
        from taction.verification.verdict.active_sets import visited_sets

        failures = list[str]()
        found = partial(visited_sets, self.recording)
        return attempt("the active sets", found, (), failures.append)

    @cached_property
    def warnings(self) -> tuple[str, ...]:
        """What makes no check fail, but may be wrong."""
        failures, nothing = list(self.failures), tuple[str, ...]()
        found = partial(all_warnings, self.evidence, self.recording)
        return (*attempt("the warnings", found, nothing, failures.append), *failures)

    def __str__(self) -> str:
        page = load(self.SCREEN)(self)
        text: str = load(f"{RENDERERS}.terminal:page_text")(page)
        return text

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
        engine = self.recording.ends.engine
        words = ", ".join(filter(None, parts))
        return f"Verdict({self.scene.name!r}, {outcome}, {engine}; {words})"


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
    with clock.listening():
        design = design_board(scene, clock, problem=problem, circuit=circuit)
        clock.begin("simulation", remark=design.plan.remark)
        pending = begin(design)
        clock.begin("reference", beside="simulation")
        ideal = ideal or ideal_answer(design.network, design.scene)
        evidence, recording = gather_evidence(design, ideal, pending, clock, effort)
        return judged(evidence, recording, ideal, clock, effort)


def gather_evidence(
    design: PlannedBoard,
    ideal: IdealAnswer,
    pending: Pending | None,
    clock: Clock,
    effort: Effort,
    known: Measurements | None = None,
    margin: Margin | None = None,
) -> tuple[Evidence, Recording]:
    """Measure the record, and gather what is judged; measurements and margin may be known.

    What needs no record is computed while the simulation runs.
    """
    steady = SteadyState.of(design.board, design.scales)
    margin = margin or _margin(design, effort)
    parts, noise, spread = design.loads(), OutputNoise.of(design), design.spread()
    recording = record_and_measure(design, ideal, pending, clock, known)
    evidence = Evidence(
        checks=design.scene.checks,
        measurements=recording.measurements,
        error=recording.error,
        steady=steady,
        end=float(recording.ends.time[-1]),
        forever=recording.forever,
        wanted=recording.design.plan.wanted,
        agreement=recording.agreement,
        poles=design.poles,
        margin=margin,
        reference_error=ideal.error,
        reference_problem=ideal.problem,
        contradiction=find_contradiction(design.circuit, ideal, recording.first_and_last[0]),
        parts=parts,
        noise=noise,
        spread=spread,
        unwitnessed=missing_witness(design.circuit, design.engine),
        recording=recording,
    )
    return evidence, recording


def _margin(design: PlannedBoard, effort: Effort) -> Margin | None:
    """Return the stability margin, if the scene asks for one."""
    search = margin_search(design, effort)
    if search is None:
        return None
    return find_margin(search.board, reach=search.reach, found=search.found)


def margin_search(design: PlannedBoard, effort: Effort) -> MarginSearch | None:
    """Return the search for the stability margin; None if the scene asks for none."""
    required = design.scene.checks.stability.margin
    reach = max(required, REACH) if effort.full_margin else required
    return MarginSearch(design.board, reach=reach, found=design.poles) if required > 1.0 else None


def judged(
    evidence: Evidence, recording: Recording, ideal: IdealAnswer, clock: Clock, effort: Effort
) -> Verdict:
    """Judge the evidence, and add the details that the effort asks for.

    Where an error touches a limit that could be smaller, the finest readings are judged.
    """
    design, failures = recording.design, list[str]()
    detail = partial(attempt, tell=failures.append)
    checks = run_checks(evidence)
    if could_be_finer(evidence, checks):
        measured, error = finest(recording, ideal)
        evidence = replace(evidence, measurements=measured, error=error)
        checks = run_checks(evidence)
    answer = AnswerError.of(ideal.network, ideal.solution, design.problem.stress, ideal.problem)
    built = design if effort.details else None
    judge = partial(answer.judged, evidence, checks, built)
    answer = detail("the error of the board", judge, answer)
    clock.begin("error budget")
    energy, budget = None, ErrorBudget()
    if effort.details:
        more = evidence.noise, evidence.spread
        energy = detail(
            "the energy",
            lambda: energy_rise(design.network, recording.waveforms.time, recording.u),
            None,
        )
        budget = detail(
            "the error budget",
            lambda: error_budget(design, ideal, answer, recording, *more),
            budget,
        )
    clock.end()
    return Verdict(
        recording=recording,
        ideal=ideal,
        evidence=evidence,
        checks=checks,
        answer=answer,
        energy=energy,
        budget=budget,
        failures=tuple(failures),
        timing=clock.seconds,
    )
