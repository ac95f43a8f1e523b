"""Verify several scenes at once: boards that are alike are built and read together."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from contextlib import contextmanager, suppress
from dataclasses import dataclass
from pathlib import Path

from taction.netlist_gen.board.circuit import Circuit
from taction.netlist_gen.scene.inverse_problem import InverseProblem
from taction.netlist_gen.scene.scene import Scene
from taction.system.errors import TactionError
from taction.system.own_folders import remove_own_folder
from taction.system.progress import Clock
from taction.verification.engines.statespace.linearised.board import (
    LinearBoard,
    parts_of,
    solve_together,
)
from taction.verification.readings.exact_measures import ExactResponse, measure_responses
from taction.verification.reference.ideal_answer import IdealAnswer, ideal_answer
from taction.verification.stability.margin import MarginSearch, margins_together
from taction.verification.verdict.companion import beside_steps, exact_response
from taction.verification.verdict.design import planned_board, synthesised_board
from taction.verification.verdict.planned_board import PlannedBoard, UnplannedBoard
from taction.verification.verdict.simulation import ENGINES, begin_together
from taction.verification.verdict.verify import (
    FULL,
    Effort,
    Verdict,
    gather_evidence,
    judged,
    margin_search,
    verify,
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
    with suppress(Exception):  # each alone says why
        solve_together([board.board for _, board, _ in built.values()])
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
