"""The board of a scene, with its poles, time scales and plan, before any simulation.

Its op-amps have the simplest model that is true for this board. Where an op-amp of the small-signal
board would exceed `FULL` of a limit on the way, the board is built again with op-amps that have
their slew rate and swing and, where a current exceeds its limit, their largest output current. A
board that would rest beyond a limit stays as it is: no level of the model mends it.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import replace

from taction.netlist_gen.analysis import Transient
from taction.netlist_gen.board.circuit import Circuit
from taction.netlist_gen.board.synthesis import synthesise
from taction.netlist_gen.scene.inverse_problem import InverseProblem, make_problem
from taction.netlist_gen.scene.scene import Scene
from taction.system.errors import TactionError
from taction.system.progress import Clock
from taction.verification.engines.statespace.linearised.board import LinearBoard
from taction.verification.engines.statespace.linearised.time_scales import time_scales
from taction.verification.reference import IdealNetwork
from taction.verification.reference.ideal_answer import ideal_network, resolve_lambda
from taction.verification.stability.poles import poles_behind
from taction.verification.verdict.headroom import NOT_LIMITED, LoadRequest, PartLoads
from taction.verification.verdict.planned_board import PlannedBoard
from taction.verification.verdict.simulation import ENGINES, choose_engine
from taction.verification.verdict.transient_plan import plan_transient


def at_level(
    scene: Scene, board: LinearBoard, transient: Transient, *, stable: bool
) -> tuple[LinearBoard, PartLoads]:
    """Return the board at its level, and the loads of the small-signal board if it is stable.

    Parameters
    ----------
    board : LinearBoard
        The small-signal board.
    transient : Transient
        Its record, from which the loads of a board without exact solution are read.
    """
    if not _has_loads(scene, board, stable=stable):
        return _leveled(scene, board, NOT_LIMITED), NOT_LIMITED
    loads = PartLoads.of(board, initial=transient.initial, transient=transient)
    return _leveled(scene, board, loads), loads


def _has_loads(scene: Scene, board: LinearBoard, *, stable: bool) -> bool:
    """Whether the level of a board follows from the loads of its small-signal board."""
    level = scene.design.opamp.level
    given = level == "large-signal" and has_large_signal(board)
    return stable and not given and board.circuit.is_small_signal


def _leveled(scene: Scene, board: LinearBoard, loads: PartLoads) -> LinearBoard:
    """Return a small-signal board at its level."""
    level = scene.design.opamp.level
    if level == "large-signal" and has_large_signal(board):
        return LinearBoard(large_signal(board.circuit))
    above = {load.quantity for load in loads.loads if load.is_above}
    if level == "auto" and above and not loads.impossible and has_large_signal(board):
        return LinearBoard(large_signal(board.circuit, current="current" in above))
    return board


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
        place: LoadRequest(design.board, design.transient.initial, design.transient)
        for place, design in enumerate(designs)
        if _has_loads(design.scene, design.board, stable=design.poles.known_stable)
    }
    loads = dict(zip(loaded, PartLoads.together(list(loaded.values())), strict=True))
    found = list[PlannedBoard | TactionError]()
    for place, design in enumerate(designs):
        small = loads.get(place, NOT_LIMITED)
        try:
            leveled = _leveled(design.scene, design.board, small)
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
