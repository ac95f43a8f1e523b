"""The board of a scene, with its poles, time scales and plan, before any simulation.

The level of its op-amps is the simplest model that is true for the board. Where an op-amp of the
small-signal board would exceed `FULL` of a limit on the way, the board is built again with op-amps
that have their slew rate and swing and, where a current exceeds its limit, their largest output
current. A board that would rest beyond a limit stays as it is: no level of the model mends it.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import replace

from taction.netlist_gen.board.circuit import Circuit
from taction.netlist_gen.board.synthesis import synthesise
from taction.netlist_gen.scene.inverse_problem import InverseProblem, make_problem
from taction.netlist_gen.scene.scene import Scene
from taction.system.errors import TactionError
from taction.system.progress import Clock
from taction.verification.engines.statespace.linearised.board import LinearBoard, solve_together
from taction.verification.engines.statespace.linearised.time_scales import time_scales
from taction.verification.reference.ideal_answer import ideal_network
from taction.verification.reference.lambda_rule import resolve_lambda
from taction.verification.stability.poles import poles_behind
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
        if _has_loads(design)
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
    scene, board = design.scene, design.board
    level, able = scene.design.opamp.level, has_large_signal(board)
    above = {load.quantity for load in small.loads if load.is_above}
    given = level == "large-signal" and able
    if not given and not (level == "auto" and above and not small.impossible and able):
        return None
    try:
        limited = large_signal(board.circuit, current=given or "current" in above)
        leveled = LinearBoard(limited)
    except TactionError as error:
        return error
    return UnplannedBoard(scene, design.problem, leveled, design.network)


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
