"""How far antilog stages of transistors are from the ideal function, on their board."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from taction.system.array_types import Floats
from taction.system.quantities import show
from taction.verification.engines.statespace.linearised.board import LinearBoard
from taction.verification.engines.statespace.linearised.equilibrium import Equilibrium


@dataclass(frozen=True, slots=True)
class StageDeviation:
    """Deviation of the stages at both ends of their working range, with and without strain.

    Attributes
    ----------
    largest : float
        ``|u / (U0 exp(v / Ve)) - 1|`` of any channel.
    lowest, highest : float
        Smallest and largest u there, V.
    """

    largest: float
    lowest: float
    highest: float

    def __str__(self) -> str:
        return (
            f"up to {100.0 * self.largest:.2g} % from U0 exp(v/Ve), measured at u from"
            f" {show(self.lowest, 'V', 3)} to {show(self.highest, 'V', 3)}"
        )


def stage_deviation(board: LinearBoard) -> StageDeviation:
    """Measure the stages of a board at its two equilibria.

    Raises
    ------
    EngineError
        The board has no equilibrium.
    """
    circuit = board.circuit
    points = (board.rest, board.equilibrium)
    u = np.array([_outputs(board, point) for point in points])
    v = np.array([[point[node] for node in circuit.signal_nodes] for point in points])
    wanted = circuit.value("U0") * np.exp(v / circuit.value("Ve"))
    largest = float(np.max(np.abs(u / wanted - 1.0)))
    return StageDeviation(largest, float(u.min()), float(u.max()))


def _outputs(board: LinearBoard, point: Equilibrium) -> Floats:
    return np.array([out.sign * point[out.node] for out in board.circuit.outputs])
