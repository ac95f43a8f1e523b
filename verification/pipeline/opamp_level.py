"""The level of the op-amps' macromodel: the least that is true for a board.

Where an op-amp of the small-signal board would exceed `FULL` of a limit on the way, the board is
built again with op-amps that have their slew rate and swing. A board that would rest
beyond a limit, or whose currents exceed one, stays as it is: no level of the model mends it.
"""

from __future__ import annotations

import math
from dataclasses import replace

from netlist_gen.analysis import Transient
from netlist_gen.board.circuit import GROUND, Circuit
from netlist_gen.scene.scene import Scene
from verification.engines.statespace.linearised.board import LinearBoard
from verification.pipeline.part_limits import NOT_LIMITED, PartLoads


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
    level = scene.design.opamp.level
    if level == "large-signal" and has_large_signal(board):
        return LinearBoard(large_signal(board.circuit)), NOT_LIMITED
    if not stable or not board.circuit.is_small_signal:
        return board, NOT_LIMITED
    loads = PartLoads.of(board, initial=transient.initial, transient=transient)
    if level == "auto" and _only_on_the_way(loads) and has_large_signal(board):
        return LinearBoard(large_signal(board.circuit)), loads
    return board, loads


def large_signal(circuit: Circuit) -> Circuit:
    """Return the circuit with the limits of its op-amps."""
    models = {name: replace(m, large_signal=True) for name, m in circuit.models.items()}
    return replace(circuit, models=models)


def has_large_signal(board: LinearBoard) -> bool:
    """Whether both engines have the large-signal level of a board.

    Op-amps as followers have none, and boards of over 600 unknowns would take minutes.
    """
    circuit = board.circuit
    known = all(math.isfinite(model.input_range) for model in circuit.models.values())
    inverting = all(cell.noninverting == GROUND for cell in circuit.opamps)
    return known and inverting and not board.descriptor.is_large


def _only_on_the_way(parts: PartLoads) -> bool:
    """Whether slopes or voltages exceed their limits, but neither a current nor the rest."""
    beyond = {load.quantity for load in parts.loads if load.is_above}
    return bool(beyond) and "current" not in beyond and not parts.impossible
