"""The board of a scene, with its poles, time scales and plan, before any simulation."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

from taction.netlist_gen.board.circuit import Circuit
from taction.netlist_gen.board.synthesis import synthesise
from taction.netlist_gen.scene.inverse_problem import InverseProblem, make_problem
from taction.netlist_gen.scene.scene import Scene
from taction.system.errors import TactionError
from taction.system.progress import Clock
from taction.verification.engines.statespace.linearised.board import LinearBoard, solve_together
from taction.verification.engines.statespace.linearised.time_scales import time_scales
from taction.verification.reference.dynamics import IdealNetwork
from taction.verification.reference.ideal_answer import ideal_network
from taction.verification.reference.lambda_rule import resolve_lambda
from taction.verification.stability.poles import poles_behind
from taction.verification.verdict.headroom import NOT_LIMITED, PartLoads
from taction.verification.verdict.opamp_level import has_loads, leveled_board
from taction.verification.verdict.planned_board import PlannedBoard
from taction.verification.verdict.simulation import ENGINES, choose_engine
from taction.verification.verdict.transient_plan import plan_transient


def design_board(
    scene: Scene,
    clock: Clock,
    *,
    problem: InverseProblem | None = None,
    circuit: Circuit | LinearBoard | None = None,
) -> PlannedBoard:
    """Synthesise the board of `scene` and plan its transient.

    `problem` and `circuit` replace those of the scene.

    Raises
    ------
    InputError, NoVerdictError
        As `taction.verification.verdict.verify.verify`.
    """
    unplanned = synthesised_board(scene, clock, problem=problem, circuit=circuit)
    (design,) = at_their_levels([small_signal_board(unplanned, clock)])
    if isinstance(design, TactionError):
        raise design
    return design


@dataclass(frozen=True, slots=True, eq=False)
class UnplannedBoard:
    """The board of a scene, with a number for lambda, before anything is computed from it."""

    scene: Scene
    problem: InverseProblem
    board: LinearBoard
    network: IdealNetwork


def synthesised_board(
    scene: Scene,
    clock: Clock,
    *,
    problem: InverseProblem | None = None,
    circuit: Circuit | LinearBoard | None = None,
) -> UnplannedBoard:
    """Synthesise the board of `scene`; see `design_board`."""
    clock.begin("synthesis")
    scene = resolve_lambda(scene)
    problem = make_problem(scene) if problem is None else problem
    board = LinearBoard.of(synthesise(scene, problem) if circuit is None else circuit)
    return UnplannedBoard(scene, problem, board, ideal_network(problem, scene))


def small_signal_board(unplanned: UnplannedBoard, clock: Clock) -> PlannedBoard:
    """Plan the transient of a board, whatever its op-amps have to do.

    See `design_board`; `at_their_levels` is the last part of it.
    """
    clock.begin("poles")
    return _designed(unplanned)


def at_their_levels(designs: Sequence[PlannedBoard]) -> list[PlannedBoard | TactionError]:
    """Return small-signal boards at their levels, or why a board cannot be planned again.

    The loads of all boards are found together.
    """
    loaded = {
        place: (design.board, design.transient.initial, design.transient, design.plan.tolerance)
        for place, design in enumerate(designs)
        if has_loads(design.scene, design.board, stable=design.poles.known_stable)
    }
    loads = dict(zip(loaded, PartLoads.together(list(loaded.values())), strict=True))
    leveled = [
        _leveled(design, loads.get(place, NOT_LIMITED)) for place, design in enumerate(designs)
    ]
    solve_together([each.board for each in leveled if isinstance(each, UnplannedBoard)])
    found = list[PlannedBoard | TactionError]()
    for place, (design, each) in enumerate(zip(designs, leveled, strict=True)):
        if isinstance(each, TactionError):
            found.append(each)
            continue
        try:
            planned = design if each is None else _designed(each)
            found.append(replace(planned, small=loads.get(place, NOT_LIMITED)))
        except TactionError as error:
            found.append(error)
    return found


def _leveled(design: PlannedBoard, small: PartLoads) -> UnplannedBoard | TactionError | None:
    """Return the board at its level, or why there is none; None if it is at its level."""
    try:
        board = leveled_board(design.scene, design.board, small)
    except TactionError as error:
        return error
    if board is design.board:
        return None
    return UnplannedBoard(design.scene, design.problem, board, design.network)


def _designed(unplanned: UnplannedBoard) -> PlannedBoard:
    scene, board = unplanned.scene, unplanned.board
    scales = time_scales(board, initial=scene.analysis.initial)
    poles = poles_behind(board, scales)
    scales = scales.with_slower(poles.rightmost)
    engine = choose_engine(scene)
    stable = not poles.known_unstable
    plan = plan_transient(
        scene,
        board,
        scales,
        steps=ENGINES[engine].error is None,
        stable=stable,
        resolution=poles.resolution,
    )
    problem, network = unplanned.problem, unplanned.network
    return PlannedBoard(scene, problem, board, network, scales, poles, engine, plan)
