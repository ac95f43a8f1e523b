"""Verify a scene: circuit, deck, waveforms, measurements, checks, verdict.

Of several scenes, boards that are alike are built and read together.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from contextlib import suppress
from dataclasses import dataclass, fields, replace
from functools import cached_property, partial
from pathlib import Path
from typing import TYPE_CHECKING, TypeVar

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
from taction.verification.readings.exact_measures import ExactResponse
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
from taction.verification.verdict.answer_error import AnswerError, BuiltBoards
from taction.verification.verdict.checks import Check, Evidence, Outcome, overall
from taction.verification.verdict.companion import (
    beside_steps,
    exact_response,
)
from taction.verification.verdict.error_budget import ErrorBudget, error_budget
from taction.verification.verdict.output_noise import OutputNoise
from taction.verification.verdict.plan_board import design_board, planned_board, synthesised_board
from taction.verification.verdict.planned_board import PlannedBoard, SteadyState, UnplannedBoard
from taction.verification.verdict.recording import Accuracy, Recording, finest, record_and_measure
from taction.verification.verdict.run_checks import could_be_finer, run_checks
from taction.verification.verdict.simulation import ENGINES, Pending, begin, begin_together
from taction.verification.verdict.warnings import all_warnings, find_contradiction, missing_witness

if TYPE_CHECKING:
    from taction.verification.verdict.active_sets import VisitedSet

T = TypeVar("T")
DETAILS = ("answer", "energy", "budget", "active_sets")


@dataclass(frozen=True, eq=False, repr=False, kw_only=True)
class Verdict(Evidence, Result):
    """All results of `verify`; ``print`` shows one screen, `outcome` is the overall result.

    It is the evidence with the checks that follow from it; details are computed when they are read.
    """

    VIEW = "taction.verification.report.views.verdict_view:view"
    SCREEN = "taction.verification.report.views.verdict_view:screen"
    CARD = "Verdict"
    DOCUMENT = "taction.verification.report.documents.verdict:VerdictBody.of"

    recording: Recording
    ideal: IdealAnswer
    checks: tuple[Check, ...]
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
    def _failures(self) -> list[str]:
        """What could not be found of the details."""
        return []

    def _detail(self, what: str, find: Callable[[], T], otherwise: T) -> T:
        """Return a detail; one that cannot be found is a warning, and the verdict stands."""
        return attempt(what, find, otherwise, self._failures.append)

    @cached_property
    def drawn_answer(self) -> AnswerError:
        """The errors of the answer, and of the board as drawn."""
        ideal, stress = self.ideal, self.problem.stress
        answer = AnswerError.of(ideal.network, ideal.solution, stress, ideal.problem)
        return answer.judged(self, self.checks)

    @cached_property
    def answer(self) -> AnswerError:
        """The errors of the answer, of the board as drawn, and of boards as built."""
        found, design = self.drawn_answer, self.recording.design
        if found.board is None:
            return found
        built = self._detail(
            "the error of built boards", partial(BuiltBoards.of, design, self), None
        )
        return replace(found, built=built)

    @cached_property
    def energy(self) -> EnergyRise | None:
        """Where the energy rises along the record; None where it is not known."""
        network, time = self.recording.design.network, self.waveforms.time
        return self._detail("the energy", lambda: energy_rise(network, time, self.u), None)

    @cached_property
    def budget(self) -> ErrorBudget:
        """The parts of the difference of the record's end and the true stress."""
        ways = self.noise, self.spread
        find = partial(error_budget, self.recording, self.ideal, self.answer, *ways)
        return self._detail("the error budget", find, ErrorBudget())

    @cached_property
    def active_sets(self) -> tuple[VisitedSet, ...]:
        """The active sets of a board of piecewise linear amplifiers that the transient visits."""
        nothing: tuple[VisitedSet, ...] = ()
        if self.circuit.is_linear:
            return nothing
        from taction.verification.verdict.active_sets import visited_sets

        return self._detail("the active sets", partial(visited_sets, self.recording), nothing)

    @cached_property
    def warnings(self) -> tuple[str, ...]:
        """What makes no check fail, but may be wrong; last the details that are not known."""
        nothing: tuple[str, ...] = ()
        found = self._detail("the warnings", partial(all_warnings, self), nothing)
        for detail in DETAILS:
            getattr(self, detail)
        return (*found, *self._failures)

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
    full_margin: bool = True,
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
    full_margin : bool, optional
        Whether to scan the stability margin up to `REACH`, not only up to the limit of the scene;
        no check depends on it.

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
        search = margin_search(design, full_margin)
        evidence = gather_evidence(design, ideal, pending, clock, search)
        return judged(evidence, ideal, clock)


def margin_search(design: PlannedBoard, full_margin: bool) -> MarginSearch | None:
    """Return the search for the stability margin; None if the scene asks for none."""
    required = design.scene.checks.stability.margin
    reach = max(required, REACH) if full_margin else required
    return MarginSearch(design.board, reach=reach, found=design.poles) if required > 1.0 else None


def gather_evidence(
    design: PlannedBoard,
    ideal: IdealAnswer,
    pending: Pending | None,
    clock: Clock,
    search: MarginSearch | None,
    known: Measurements | None = None,
    margin: Margin | None = None,
) -> Evidence:
    """Measure the record, and gather what is judged; measurements and margin may be known.

    What needs no record is computed while the simulation runs.
    """
    steady = SteadyState.of(design.board, design.scales)
    if search is not None and margin is None:
        margin = find_margin(search.board, reach=search.reach, found=search.found)
    parts, noise, spread = design.loads(), OutputNoise.of(design), design.spread()
    recording = record_and_measure(design, ideal, pending, clock, known)
    return Evidence(
        limits=design.scene.checks,
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


def judged(evidence: Evidence, ideal: IdealAnswer, clock: Clock) -> Verdict:
    """Judge the evidence of a scene.

    Where an error touches a limit that could be smaller, the finest readings are judged.
    """
    checks = run_checks(evidence)
    if evidence.recording is not None and could_be_finer(evidence, checks):
        measured, error = finest(evidence.recording, ideal)
        evidence = replace(evidence, measurements=measured, error=error)
        checks = run_checks(evidence)
    clock.end()
    facts = {each.name: getattr(evidence, each.name) for each in fields(Evidence)}
    return Verdict(**facts, ideal=ideal, checks=checks, timing=clock.seconds)


@dataclass(frozen=True, slots=True, eq=False)
class Request:
    """What `verify` gets."""

    scene: Scene
    problem: InverseProblem | None = None
    circuit: Circuit | LinearBoard | None = None
    ideal: IdealAnswer | None = None
    full_margin: bool = True

    def verdict(self) -> Verdict:
        """Return the verdict of this board alone; errors as `verify`."""
        return verify(
            self.scene,
            problem=self.problem,
            circuit=self.circuit,
            ideal=self.ideal,
            full_margin=self.full_margin,
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
    designs = dict[int, tuple[PlannedBoard, IdealAnswer, MarginSearch | None]]()
    responses = dict[int, ExactResponse]()
    for place, (request, board, clock) in built.items():
        with suppress(Exception):
            design = planned_board(board, clock)
            if design.board.descriptor.is_large or design.plan.seconds >= BRIEF:
                continue
            ideal = request.ideal or ideal_answer(design.network, design.scene)
            response = exact_response(design, ideal)
            if response is not None and response.is_stable:
                bounds_itself = ENGINES[design.engine].error is not None
                responses[place] = response if bounds_itself else beside_steps(response)
            designs[place] = design, ideal, margin_search(design, request.full_margin)
            clock.pause()
    searches = {k: search for k in responses if (search := designs[k][2]) is not None}
    margins = dict(zip(searches, margins_together([*searches.values()]), strict=True))
    readings = {place: response.measured() for place, response in responses.items()}
    runs = begin_together([design for design, _, _ in designs.values()])
    for run, (place, (design, ideal, search)) in zip(runs, designs.items(), strict=True):
        clock, margin = built[place][2], margins.get(place)
        if isinstance(margin, TactionError):
            continue
        try:
            known = search, readings.get(place), margin
            verdict = judged(gather_evidence(design, ideal, run, clock, *known), ideal, clock)
        except Exception as error:  # alone it says why, with a run folder of its own
            if isinstance(folder := getattr(error, "folder", None), Path):
                remove_own_folder(folder)
        else:
            yield place, verdict
