"""`build`: from a scene to its board, with poles, time scales, engine, level and plan.

Where an op-amp of the small-signal board would exceed `FULL` of a limit on the way, the board is
built again with op-amps that have their limits. A board that would rest beyond a limit stays as it
is: no level of the model mends it.
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
from taction.verification.reference.ideal_answer import IdealAnswer, ideal_network
from taction.verification.reference.lambda_rule import resolve_lambda
from taction.verification.stability.poles import poles
from taction.verification.verdict.board import Board
from taction.verification.verdict.headroom import PartLoads
from taction.verification.verdict.simulation import ENGINES, choose_engine
from taction.verification.verdict.transient_plan import plan_transient


def build(
    scene: Scene,
    clock: Clock | None = None,
    *,
    problem: InverseProblem | None = None,
    circuit: Circuit | LinearBoard | None = None,
    ideal: IdealAnswer | None = None,
    full_margin: bool = True,
) -> Board:
    """Synthesise the board of `scene` at its level, and plan its transient; errors as `verify`."""
    clock = clock or Clock(lambda stage: None)
    clock.begin("synthesis")
    scene = resolve_lambda(scene)
    problem = make_problem(scene) if problem is None else problem
    linear = LinearBoard.of(synthesise(scene, problem) if circuit is None else circuit)
    network = ideal_network(problem, scene)
    clock.begin("poles")

    def planned(linear: LinearBoard) -> Board:
        found = poles(linear)
        scales = time_scales(linear, initial=scene.analysis.initial).with_slower(found.rightmost)
        engine = choose_engine(scene)
        plan = plan_transient(
            scene,
            linear,
            scales,
            steps=ENGINES[engine].error is None,
            stable=not found.known_unstable,
            resolution=found.resolution,
        )
        return Board(
            scene, problem, network, linear, scales, found, engine, plan, ideal, full_margin
        )

    level, able = scene.design.opamp.level, has_large_signal(linear)
    if level == "large-signal" and able:
        return planned(LinearBoard(large_signal(linear.circuit)))
    board = planned(linear)
    if not (board.poles.known_stable and board.circuit.is_small_signal):
        return board
    small = PartLoads.of(
        linear,
        initial=board.transient.initial,
        transient=board.transient,
        tolerance=board.plan.tolerance,
    )
    above = {load.quantity for load in small.loads if load.is_above}
    if level == "auto" and above and able and not small.impossible:
        limited = large_signal(linear.circuit, current="current" in above)
        board = planned(LinearBoard(limited))
    return replace(board, small=small)


def large_signal(circuit: Circuit, *, current: bool = True) -> Circuit:
    """Return the circuit with the limits of its op-amps; that of the `current` is an extra part."""
    models = {
        name: replace(m, large_signal=True, limits_current=current and m.has_largest_current)
        for name, m in circuit.models.items()
    }
    return replace(circuit, models=models)


def has_large_signal(board: LinearBoard) -> bool:
    """Whether both engines have the large-signal level of a board."""
    return all(
        math.isfinite(model.input_range) and model.imported is None
        for model in board.circuit.models.values()
    )
