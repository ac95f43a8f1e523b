"""The board of a scene, with its poles, time scales and plan, before any simulation."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

from taction.netlist_gen.board.circuit import Circuit
from taction.netlist_gen.board.synthesis import synthesise
from taction.netlist_gen.scene.inverse_problem import InverseProblem, make_problem
from taction.netlist_gen.scene.scene import Scene
from taction.system.errors import TactionError
from taction.system.progress import Clock
from taction.verification.engines.statespace.linearised.board import LinearBoard
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
    (design,) = at_their_levels(
        [small_signal_board(scene, clock, problem=problem, circuit=circuit)]
    )
    if isinstance(design, TactionError):
        raise design
    return design


def small_signal_board(
    scene: Scene,
    clock: Clock,
    *,
    problem: InverseProblem | None = None,
    circuit: Circuit | LinearBoard | None = None,
) -> PlannedBoard:
    """Synthesise the board of `scene` and plan its transient, whatever its op-amps have to do.

    See `design_board`; `at_their_levels` is the second half of it.
    """
    clock.begin("synthesis")
    scene = resolve_lambda(scene)
    problem = make_problem(scene) if problem is None else problem
    board = LinearBoard.of(synthesise(scene, problem) if circuit is None else circuit)
    network = ideal_network(problem, scene)
    clock.begin("poles")
    return _designed(scene, problem, board, network)


def at_their_levels(designs: Sequence[PlannedBoard]) -> list[PlannedBoard | TactionError]:
    """Return small-signal boards at their levels, or why a board cannot be planned again.

    The loads of all boards are found together.
    """
    loaded = {
        place: (design.board, design.transient.initial, design.transient)
        for place, design in enumerate(designs)
        if has_loads(design.scene, design.board, stable=design.poles.known_stable)
    }
    loads = dict(zip(loaded, PartLoads.together(list(loaded.values())), strict=True))
    found = list[PlannedBoard | TactionError]()
    for place, design in enumerate(designs):
        small = loads.get(place, NOT_LIMITED)
        try:
            leveled = leveled_board(design.scene, design.board, small)
            if leveled is not design.board:
                design = _designed(design.scene, design.problem, leveled, design.network)
            found.append(replace(design, small=small))
        except TactionError as error:
            found.append(error)
    return found


def _designed(
    scene: Scene, problem: InverseProblem, board: LinearBoard, network: IdealNetwork
) -> PlannedBoard:
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
    return PlannedBoard(scene, problem, board, network, scales, poles, engine, plan)
