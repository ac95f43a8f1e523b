"""The board of a scene, with its poles, time scales and plan, before any simulation."""

from __future__ import annotations

from dataclasses import replace

from taction.netlist_gen.board.circuit import Circuit
from taction.netlist_gen.board.synthesis import synthesise
from taction.netlist_gen.scene.inverse_problem import InverseProblem, make_problem
from taction.netlist_gen.scene.scene import Scene
from taction.verification.engines.statespace.linearised.board import LinearBoard
from taction.verification.engines.statespace.linearised.time_scales import time_scales
from taction.verification.reference import IdealNetwork
from taction.verification.reference.ideal_answer import ideal_network, resolve_lambda
from taction.verification.stability.poles import poles_behind
from taction.verification.verdict.clock import Clock
from taction.verification.verdict.opamp_level import at_level
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
    clock.begin("synthesis")
    scene = resolve_lambda(scene)
    problem = make_problem(scene) if problem is None else problem
    board = LinearBoard.of(synthesise(scene, problem) if circuit is None else circuit)
    network = ideal_network(problem, scene)
    clock.begin("poles")
    design = _designed(scene, problem, board, network)
    stable = design.poles.known_stable
    leveled, small = at_level(scene, board, design.transient, stable=stable)
    if leveled is not board:
        design = _designed(scene, problem, leveled, network)
    return replace(design, small=small)


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
