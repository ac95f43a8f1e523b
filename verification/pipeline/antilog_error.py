"""What transistors in the place of ideal antilog stages do to a board."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from netlist_gen.board.circuit import Circuit
from netlist_gen.board.synthesis import synthesise
from netlist_gen.scene.antilog_choice import AntilogChoice
from spice_models.array_types import Floats
from verification.engines.statespace.linearised.board import LinearBoard
from verification.engines.statespace.linearised.equilibrium import Equilibrium
from verification.pipeline.design import Design


@dataclass(frozen=True, slots=True)
class AntilogError:
    """Effect of the stages of a board.

    Attributes
    ----------
    outputs : ndarray (N,)
        Equilibrium of the same board with ideal stages, V.
    deviation : float
        Largest ``|u / (U0 exp(v / Ve)) - 1|`` of any channel at both ends of its working range, the
        equilibria with and without strain.
    lowest, highest : float
        Smallest and largest u there, V.
    """

    outputs: Floats
    deviation: float
    lowest: float
    highest: float


def antilog_error(design: Design) -> AntilogError | None:
    """Compare the stages of a board with ideal ones; None if its stages are ideal.

    Raises
    ------
    EngineError
        A board has no equilibrium.
    """
    scene, circuit = design.scene, design.circuit
    if not circuit.transistors:
        return None
    ideal = {"antilog": AntilogChoice()}
    other = scene.model_copy(update={"design": scene.design.model_copy(update=ideal)})
    board = LinearBoard(synthesise(other, design.problem))
    points = (design.board.rest, design.board.equilibrium)
    u = np.array([outputs_at(circuit, point) for point in points])
    v = np.array([[point[node] for node in circuit.signal_nodes] for point in points])
    scalings = circuit.scalings
    wanted = scalings.unit_voltage * np.exp(v / scalings.exponential_slope)
    return AntilogError(
        outputs=outputs_at(board.circuit, board.equilibrium),
        deviation=float(np.max(np.abs(u / wanted - 1.0))),
        lowest=float(u.min()),
        highest=float(u.max()),
    )


def outputs_at(circuit: Circuit, point: Equilibrium) -> Floats:
    """Return the outputs (N,), V, at an equilibrium of a circuit."""
    return np.array([out.sign * point[out.node] for out in circuit.outputs])
