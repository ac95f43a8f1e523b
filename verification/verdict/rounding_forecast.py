"""What the deviations of resistors do to the solution, predicted to first order."""

from __future__ import annotations

import numpy as np

from taction.netlist_gen.board.circuit import Circuit
from taction.netlist_gen.board.synthesis import synthesise
from taction.netlist_gen.topologies.frame.antilog import with_ideal_stages
from taction.system.array_types import Floats
from taction.verification.engines.statespace.linearised.board import LinearBoard
from taction.verification.engines.statespace.linearised.rest_sensitivity import RestSensitivity
from taction.verification.verdict.opamp_links import with_ideal_opamps
from taction.verification.verdict.planned_board import PlannedBoard


def predicted_change(design: PlannedBoard) -> Floats | None:
    """Return how far the resistors of a board move the optimum, to first order, V, (N,).

    The board with the exact resistors that the scene asks for, and with ideal op-amps, rests at the
    optimum. Its sensitivities, with the conductances' deviations, predict the outputs of the board
    as built: rounded to a series, or varied.

    Returns
    -------
    ndarray (N,) or None
        None where no resistor deviates, and for a board with other resistors than the scene's.

    Raises
    ------
    InputError
        The board with exact resistors cannot be built.
    EngineError
        It has no equilibrium.
    """
    chosen = design.scene.design.model_copy(update={"resistor_series": "exact"})
    scene = design.scene.model_copy(update={"design": chosen})
    exact = with_ideal_stages(synthesise(scene, design.problem))
    wanted, built = resistances(exact), resistances(with_ideal_stages(design.circuit))
    if wanted.keys() != built.keys():
        return None
    deviations = {name: 1.0 - ohms / built[name] for name, ohms in wanted.items()}
    if not any(deviations.values()):
        return None
    slopes = RestSensitivity.of(LinearBoard(with_ideal_opamps(exact))).resistors()
    moves = [deviation * slopes[name] for name, deviation in deviations.items()]
    return np.asarray(np.sum(moves, axis=0))


def resistances(circuit: Circuit) -> dict[str, float]:
    """Return the resistance of every resistor by its name in the deck, ohm."""
    found = {f"R{part.name}": part.ohms for part in circuit.resistors}
    for matrix in circuit.matrices:
        for k, n, *_, ohms in matrix.elements():
            found[f"{matrix.name}_{k + 1}_{n + 1}"] = ohms
    return found
