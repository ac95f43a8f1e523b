"""The level of the op-amps of a board: the simplest model that is true for this board.

Where an op-amp of the small-signal board would exceed `FULL` of a limit on the way, the board is
built again with op-amps that have their slew rate and swing and, where a current exceeds its limit,
their largest output current. A board that would rest beyond a limit stays as it is: no level of the
model mends it.
"""

from __future__ import annotations

import math
from dataclasses import replace

from taction.netlist_gen.analysis import Transient
from taction.netlist_gen.board.circuit import Circuit
from taction.netlist_gen.scene.scene import Scene
from taction.verification.engines.statespace.linearised.board import LinearBoard
from taction.verification.verdict.headroom import NOT_LIMITED, PartLoads


def at_level(
    scene: Scene, board: LinearBoard, transient: Transient, *, stable: bool
) -> LinearBoard:
    """Return a small-signal board at its level.

    The loads of a board without exact solution are read from its record, `transient`.
    """
    loads = NOT_LIMITED
    if has_loads(scene, board, stable=stable):
        loads = PartLoads.of(board, initial=transient.initial, transient=transient)
    return leveled_board(scene, board, loads)


def has_loads(scene: Scene, board: LinearBoard, *, stable: bool) -> bool:
    """Whether the level of a board follows from the loads of its small-signal board."""
    level = scene.design.opamp.level
    given = level == "large-signal" and has_large_signal(board)
    return stable and not given and board.circuit.is_small_signal


def leveled_board(scene: Scene, board: LinearBoard, loads: PartLoads) -> LinearBoard:
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
