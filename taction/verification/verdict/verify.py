"""Verify a scene: circuit, deck, waveforms, measurements, checks, verdict.

Of several scenes, boards that are alike are built and read together.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from contextlib import contextmanager, suppress
from dataclasses import dataclass, replace
from functools import cached_property, partial
from pathlib import Path
from typing import TYPE_CHECKING

from taction.netlist_gen.analysis import Transient
from taction.netlist_gen.board.circuit import Circuit
from taction.netlist_gen.scene.inverse_problem import InverseProblem
from taction.netlist_gen.scene.scene import Scene, opamp_words
from taction.system.array_types import Floats
from taction.system.errors import TactionError
from taction.system.own_folders import remove_own_folder
from taction.system.progress import Clock, Progress, attempt
from taction.system.quantities import sizes
from taction.system.results import RENDERERS, Result, load
from taction.system.waveforms import Waveforms
from taction.verification.engines.statespace.linearised.linear_board import (
    LinearBoard,
    parts_of,
)
from taction.verification.readings.exact_measures import ExactResponse, measure_responses
from taction.verification.readings.measurements import Measurements
from taction.verification.reference.ideal_answer import (
    EnergyRise,
    IdealAnswer,
    energy_rise,
    ideal_answer,
)
from taction.verification.stability.margin import (
    REACH,
    Margin,
    MarginSearch,
    find_margin,
    margins_together,
)
from taction.verification.stability.poles import Poles
from taction.verification.verdict.answer_error import AnswerError
from taction.verification.verdict.checks import Check, Evidence, Outcome, overall
from taction.verification.verdict.companion import (
    Agreement,
    StepError,
    beside_steps,
    exact_response,
)
from taction.verification.verdict.error_budget import ErrorBudget, error_budget
from taction.verification.verdict.headroom import PartLoads
from taction.verification.verdict.output_noise import OutputNoise
from taction.verification.verdict.plan_board import design_board, planned_board, synthesised_board
from taction.verification.verdict.planned_board import PlannedBoard, SteadyState, UnplannedBoard
from taction.verification.verdict.recording import Accuracy, Recording, finest, record_and_measure
from taction.verification.verdict.run_checks import could_be_finer, run_checks
from taction.verification.verdict.simulation import ENGINES, Pending, begin, begin_together
from taction.verification.verdict.warnings import all_warnings, find_contradiction, missing_witness

if TYPE_CHECKING:
    from taction.verification.verdict.active_sets import VisitedSet


@dataclass(frozen=True, slots=True)
class Effort:
    """Results that a verification computes in addition to the checks.

    No outcome and no reading of a check depends on these choices.
    """

    details: bool = True  # whether to compute the error budget and the energy
    # Whether to scan the stability margin up to `REACH`, not only up to the limit of the scene.
    full_margin: bool = True


FULL = Effort()


@dataclass(frozen=True, eq=False, repr=False)
class Verdict(Result):
    """All results of `verify`; ``print`` shows one screen, `outcome` is the overall result."""

    VIEW = "taction.verification.report.views.verdict_view:view"
    SCREEN = "taction.verification.report.views.verdict_screen_view:screen"
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


@dataclass(frozen=True, slots=True, eq=False)
class Request:
    """What `verify` gets."""

    scene: Scene
    problem: InverseProblem | None = None
    circuit: Circuit | LinearBoard | None = None
    ideal: IdealAnswer | None = None
    effort: Effort = FULL

    def verdict(self) -> Verdict:
        """Return the verdict of this board alone; errors as `verify`."""
        return verify(
            self.scene,
            problem=self.problem,
            circuit=self.circuit,
            ideal=self.ideal,
            effort=self.effort,
        )


BRIEF = 1.0  # s: a longer run of ngspice gains nothing, and is not repeated if it fails
TOGETHER = 600_000  # squared numbers of parts of the boards that are computed together

Built = tuple[Request, UnplannedBoard, Clock]


def verify_together(requests: Sequence[Request]) -> Iterator[tuple[int, Verdict]]:
    """Verify scenes; boards that are alike are built, and simulated or read if exact, in one go.

    Yields
    ------
    int, Verdict
        Place of a request, and its verdict. A request is left out where it gains nothing from
        other ones, and where `verify` raises. Simulations in processes run one after the other.

    Examples
    --------
    >>> import taction
    >>> scene = taction.load_scene("scenes/custom-matrix.toml").with_engine("statespace")
    >>> ((place, verdict),) = verify_together([Request(scene)])
    >>> place, verdict.outcome is taction.verify(scene).outcome
    (0, True)
    """
    built, size = dict[int, Built](), 0
    for place, request in enumerate(requests):
        clock = Clock(lambda stage: None)
        with suppress(Exception):
            board = synthesised_board(
                request.scene, clock, problem=request.problem, circuit=request.circuit
            )
            clock.pause()
            built[place] = request, board, clock
            size += parts_of(board.board) ** 2
        if size > TOGETHER:
            yield from _verified(built)
            built, size = {}, 0
    yield from _verified(built)


def _verified(built: dict[int, Built]) -> Iterator[tuple[int, Verdict]]:
    """Yield the verdicts of boards whose run is brief; their readings and margins are known."""
    designs = dict[int, tuple[PlannedBoard, IdealAnswer]]()
    responses, searches = dict[int, ExactResponse](), dict[int, MarginSearch]()
    for place, (request, board, clock) in built.items():
        with suppress(Exception):
            design = planned_board(board, clock)
            if design.board.descriptor.is_large or design.plan.seconds >= BRIEF:
                continue
            ideal = request.ideal or ideal_answer(design.network, design.scene)
            response, search = exact_response(design, ideal), margin_search(design, request.effort)
            if response is not None and response.is_stable:
                bounds_itself = ENGINES[design.engine].error is not None
                responses[place] = response if bounds_itself else beside_steps(response)
                searches |= {} if search is None else {place: search}
            designs[place] = design, ideal
            clock.pause()
    found = margins_together([*searches.values()])
    margins = dict(zip(searches, found, strict=True))
    readings = dict(zip(responses, measure_responses([*responses.values()]), strict=True))
    runs = begin_together([design for design, _ in designs.values()])
    for run, (place, (design, ideal)) in zip(runs, designs.items(), strict=True):
        (request, _, clock), margin = built[place], margins.get(place)
        if not isinstance(margin, TactionError):
            with _left_out():
                known = readings.get(place), margin
                evidence = gather_evidence(design, ideal, run, clock, request.effort, *known)
                yield place, judged(*evidence, ideal, clock, request.effort)


@contextmanager
def _left_out() -> Iterator[None]:
    """Leave out a board that fails: alone it says why, with a run folder of its own."""
    try:
        yield
    except Exception as error:
        folder = getattr(error, "folder", None)
        if isinstance(folder, Path):
            remove_own_folder(folder)
