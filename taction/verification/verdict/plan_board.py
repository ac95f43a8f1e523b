"""The board of a scene, with its poles, time scales and plan, before any simulation.

The level of its op-amps is the simplest model that is true for the board. Where an op-amp of the
small-signal board would exceed `FULL` of a limit on the way, the board is built again with op-amps
that have their slew rate and swing and, where a current exceeds its limit, their largest output
current. A board that would rest beyond a limit stays as it is: no level of the model mends it.
"""

from __future__ import annotations

import math
from dataclasses import replace

from taction.netlist_gen.board.circuit import Circuit
from taction.netlist_gen.board.synthesis import synthesise
from taction.netlist_gen.scene.inverse_problem import InverseProblem, make_problem
from taction.netlist_gen.scene.scene import Scene
from taction.system.progress import Clock
from taction.verification.engines.statespace.linearised.linear_board import LinearBoard
from taction.verification.engines.statespace.linearised.time_scales import time_scales
from taction.verification.reference.ideal_answer import ideal_network
from taction.verification.reference.lambda_rule import resolve_lambda
from taction.verification.stability.poles import poles
from taction.verification.verdict.headroom import NOT_LIMITED, PartLoads
from taction.verification.verdict.planned_board import PlannedBoard, UnplannedBoard
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

    InputError, NoVerdictError: as `taction.verification.verdict.verify.verify`.
    """
    return planned_board(synthesised_board(scene, clock, problem=problem, circuit=circuit), clock)


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


def planned_board(unplanned: UnplannedBoard, clock: Clock) -> PlannedBoard:
    """Plan the transient of a board at its level; errors as `design_board`."""
    clock.begin("poles")
    design = _designed(unplanned)
    if not _has_loads(design):
        small = NOT_LIMITED
    else:
        small = PartLoads.of(
            design.board,
            initial=design.transient.initial,
            transient=design.transient,
            tolerance=design.plan.tolerance,
        )
    leveled = _leveled(design, small)
    return replace(design if leveled is None else _designed(leveled), small=small)


def _leveled(design: PlannedBoard, small: PartLoads) -> UnplannedBoard | None:
    """Return the board at its level; None if it is at its level."""
    scene, board = design.scene, design.board
    level, able = scene.design.opamp.level, has_large_signal(board)
    above = {load.quantity for load in small.loads if load.is_above}
    given = level == "large-signal" and able
    if not given and not (level == "auto" and above and not small.impossible and able):
        return None
    limited = large_signal(board.circuit, current=given or "current" in above)
    return UnplannedBoard(scene, design.problem, LinearBoard(limited), design.network)


def _has_loads(design: PlannedBoard) -> bool:
    """Whether the level of a board follows from the loads of its small-signal board."""
    given = design.scene.design.opamp.level == "large-signal" and has_large_signal(design.board)
    return design.poles.known_stable and not given and design.circuit.is_small_signal


def large_signal(circuit: Circuit, *, current: bool = True) -> Circuit:
    """Return the circuit with the limits of its op-amps; that of the `current` is an extra part."""
    models = {
        name: replace(m, large_signal=True, limits_current=current and m.has_largest_current)
        for name, m in circuit.models.items()
    }
    return replace(circuit, models=models)


def has_large_signal(board: LinearBoard) -> bool:
    """Whether both engines have the large-signal level of a board.

    An op-amp needs a slew rate and a first pole; the limits of an imported one are in its netlist.
    """
    return all(
        math.isfinite(model.input_range) and model.imported is None
        for model in board.circuit.models.values()
    )


def _designed(unplanned: UnplannedBoard) -> PlannedBoard:
    scene, board = unplanned.scene, unplanned.board
    scales = time_scales(board, initial=scene.analysis.initial)
    found = poles(board)
    scales = scales.with_slower(found.rightmost)
    engine = choose_engine(scene)
    stable = not found.known_unstable
    plan = plan_transient(
        scene,
        board,
        scales,
        steps=ENGINES[engine].error is None,
        stable=stable,
        resolution=found.resolution,
    )
    problem, network = unplanned.problem, unplanned.network
    return PlannedBoard(scene, problem, board, network, scales, found, engine, plan)
