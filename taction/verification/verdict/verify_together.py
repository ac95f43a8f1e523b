"""Verify several scenes at once: boards that are alike are planned, simulated and read together."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager, suppress
from dataclasses import dataclass, replace
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
from taction.verification.engines.statespace.linearised.modes import find_share_errors
from taction.verification.engines.statespace.transients.exact import is_exact
from taction.verification.readings.exact_measures import ExactResponse, measure_responses
from taction.verification.readings.measurements import Measurements
from taction.verification.reference.ideal_answer import IdealAnswer, ideal_answer
from taction.verification.stability.margin import Families, Margin, MarginSearch, margins_together
from taction.verification.verdict.companion import beside_steps, exact_response
from taction.verification.verdict.design import (
    at_their_levels,
    small_signal_board,
    synthesised_board,
)
from taction.verification.verdict.planned_board import PlannedBoard, UnplannedBoard
from taction.verification.verdict.simulation import ENGINES, Pending, begin_together, choose_engine
from taction.verification.verdict.verify import (
    FULL,
    Effort,
    Verdict,
    begin_with_reference,
    gather_evidence,
    judged,
    margin_search,
)


@dataclass(frozen=True, slots=True, eq=False)
class Request:
    """What `verify` gets."""

    scene: Scene
    problem: InverseProblem | None = None
    circuit: Circuit | LinearBoard | None = None
    ideal: IdealAnswer | None = None
    effort: Effort = FULL


BRIEF = 1.0  # s: a longer run of ngspice gains nothing, and is not repeated if it fails
TOGETHER = 600_000  # squared numbers of parts of the boards that are computed together


def verify_together(requests: Sequence[Request]) -> Iterator[tuple[int, Verdict]]:
    """Verify scenes; boards that an engine simulates together are, and read together if exact.

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
    made: dict[int, tuple[Request, UnplannedBoard, Clock]] = {}
    size = 0
    for place, request in enumerate(requests):
        clock = Clock(lambda stage: None)
        with suppress(Exception):
            unplanned = synthesised_board(
                request.scene, clock, problem=request.problem, circuit=request.circuit
            )
            if not _gains(unplanned):
                continue
            clock.pause()
            made[place] = request, unplanned, clock
            size += parts_of(unplanned.board) ** 2
        if size > TOGETHER:
            yield from _verified_together(_planned(made))
            made, size = {}, 0
    yield from _verified_together(_planned(made))


def _gains(unplanned: UnplannedBoard) -> bool:
    """Whether a board is simulated, or read on its exact solution, together with others."""
    together = ENGINES[choose_engine(unplanned.scene)].together
    return together is not None or unplanned.board.circuit.is_linear


@dataclass(frozen=True, slots=True, eq=False)
class _Planned:
    """A request whose board is planned."""

    request: Request
    design: PlannedBoard
    clock: Clock

    def verdict(
        self,
        pending: Pending | None,
        ideal: IdealAnswer,
        known: Measurements | None = None,
        margin: Margin | None = None,
    ) -> Verdict:
        """Return the verdict of a simulation that runs, or begins here, and of what is known."""
        clock, effort = self.clock, self.request.effort
        found = gather_evidence(self.design, ideal, pending, clock, effort, known, margin)
        return judged(*found, ideal, clock, effort)


def _planned(made: Mapping[int, tuple[Request, UnplannedBoard, Clock]]) -> dict[int, _Planned]:
    """Plan the transients of boards at the small-signal level; leave out those that have none."""
    with suppress(Exception):  # each alone says why
        solve_together([unplanned.board for _, unplanned, _ in made.values()])
    planned: dict[int, _Planned] = {}
    for place, (request, unplanned, clock) in made.items():
        with suppress(Exception):
            if unplanned.board.descriptor.is_large:
                continue
            design = small_signal_board(unplanned, clock)
            if design.plan.seconds < BRIEF or ENGINES[design.engine].together is not None:
                planned[place] = _Planned(request, design, clock)
            clock.pause()
    boards = [one.design.board for one in planned.values()]
    find_share_errors([board.state_space.modes for board in boards if is_exact(board)])
    return planned


def _verified_together(planned: Mapping[int, _Planned]) -> Iterator[tuple[int, Verdict]]:
    """Yield the verdicts of small-signal boards: first those that are not exact at their level."""
    try:
        designs = at_their_levels([one.design for one in planned.values()])
    except Exception:  # each alone says why
        return
    planned = {
        place: replace(one, design=design)
        for (place, one), design in zip(planned.items(), designs, strict=True)
        if isinstance(design, PlannedBoard)
    }
    exact = {place: one for place, one in planned.items() if is_exact(one.design.board)}
    others = {place: one for place, one in planned.items() if place not in exact}
    for engine in {one.design.engine for one in others.values()}:
        same = {place: one for place, one in others.items() if one.design.engine == engine}
        simulations = begin_together([one.design for one in same.values()])
        alone = ENGINES[engine].together is None
        for (place, one), pending in zip(same.items(), simulations, strict=True):
            if pending is not None or alone:
                with _left_out():
                    known = begin_with_reference(one.design, one.clock, pending, one.request.ideal)
                    yield place, one.verdict(*known)
    begun: dict[int, tuple[Pending | None, IdealAnswer]] = {}
    responses: dict[int, ExactResponse] = {}
    searches: dict[int, MarginSearch] = {}
    for place, one in exact.items():
        with _left_out():
            pending, ideal, response = _response(one)
            if response is None or not response.is_stable:
                yield place, one.verdict(pending, ideal)
                continue
            search = margin_search(one.design, one.request.effort)
            one.clock.pause()
            begun[place], responses[place] = (pending, ideal), response
            searches |= {} if search is None else {place: search}
    found = margins_together([*searches.values()], Families())
    margins = dict(zip(searches, found, strict=True))
    measured = measure_responses([*responses.values()])
    for place, readings in zip(responses, measured, strict=True):
        margin = margins.get(place)
        if not isinstance(margin, TactionError):
            with _left_out():
                yield place, exact[place].verdict(*begun[place], readings, margin)


@contextmanager
def _left_out() -> Iterator[None]:
    """Leave out a board that fails: alone it says why, with a run folder of its own."""
    try:
        yield
    except Exception as error:
        folder = getattr(error, "folder", None)
        if isinstance(folder, Path):
            remove_own_folder(folder)


def _response(one: _Planned) -> tuple[Pending | None, IdealAnswer, ExactResponse | None]:
    """Return what is measured of a board with an exact solution, and its simulation.

    A simulation that takes a process begins when its record is needed, one after the other.
    """
    design, ideal = one.design, one.request.ideal
    if ENGINES[design.engine].together is not None:
        pending, ideal = begin_with_reference(design, one.clock, ideal=ideal)
        return pending, ideal, exact_response(design, ideal)
    ideal = ideal or ideal_answer(design.network, design.scene)
    response = exact_response(design, ideal)
    return None, ideal, response if response is None else beside_steps(response)
