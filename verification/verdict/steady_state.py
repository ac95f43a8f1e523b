"""The steady state that the equations of a board give, before any transient.

The equilibrium is where a stable board comes to rest, and its modes tell how much of the transient
is left at an instant. So a record is needed only to confirm the steady state, and what a record
happens to end on decides nothing.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from taction.system.array_types import Floats
from taction.verification.engines.statespace.linearised.board import LinearBoard
from taction.verification.engines.statespace.linearised.time_scales import TimeScales


@dataclass(frozen=True, slots=True, eq=False)
class SteadyState:
    """The equilibrium of a board at its outputs.

    Attributes
    ----------
    values : ndarray (N,)
        Outputs at the equilibrium, V.
    error : float
        Bound on the rounding error of `values`, V.
    scales : TimeScales
        Modes of the board.
    linear : bool
        Whether the board has no behavioural amplifiers.
    estimated : bool
        Whether `left` is an estimate: for a board with behavioural amplifiers, and for the coarse
        image of a large board.
    """

    values: Floats
    error: float
    scales: TimeScales
    linear: bool
    estimated: bool = False

    @classmethod
    def of(cls, board: LinearBoard, scales: TimeScales) -> SteadyState:
        """Return the steady state of `board`, whose modes are in `scales`.

        Raises
        ------
        EngineError
            The board has no equilibrium.
        """
        rest, outputs = board.equilibrium, board.circuit.outputs
        places = [board.descriptor.place(output.node) for output in outputs]
        signs = np.array([output.sign for output in outputs])
        error = float(board.rounding[places].max(initial=0.0))
        linear = board.circuit.is_linear
        estimated = not linear or board.descriptor.is_large
        return cls(signs * rest.values[places], error, scales, linear, estimated)

    def left(self, time: float) -> float:
        """Return the largest distance of an output from `values` at an instant, s; V."""
        return self.scales.step * self.scales.left(time)

    def stop_for(self, volts: float) -> float:
        """Return the instant after which every output stays within `volts` of `values`, s."""
        return self.scales.stop_for(volts / (self.scales.step or 1.0))
