"""Topology ``ridge``: `pinv` with a row ``sqrt(lambda)`` for every channel, without strain.

The rows ``[T; sqrt(lambda) 1]`` and the strain ``[eps; 0]`` have the least squares solution
``(T^T T + lambda)^-1 T^T eps``: the answer of the topologies with capacitors. Each row is one more
op-amp and three resistors::

    row n        op-amp with feedback gf, its inverting input l_n, its output y_n
                 1/(sqrt(lambda) G0) from v_n to l_n, and from y_n to b_n
"""

from __future__ import annotations

import math

from taction.netlist_gen.board.circuit import GROUND, Role
from taction.netlist_gen.topologies.frame.loops import Inputs, LoopBoard
from taction.netlist_gen.topologies.pinv import PseudoInverse


class Ridge(PseudoInverse):
    """`PseudoInverse` with a row for every channel that adds lambda."""

    name = "ridge"
    regularised = True

    def more_rows(self, board: LoopBoard, columns: dict[int, Inputs]) -> None:
        """Place the rows that add lambda."""
        conductance = board.facts["G0"].value
        ohms = 1.0 / (math.sqrt(board.facts["lambda"].value) * conductance)
        for n, stage in columns.items():
            board.first_stage(f"l_{n}", Inputs(f"l_{n}", GROUND), f"y_{n}")
            for end, nodes in (("in", (f"v_{n}", f"l_{n}")), ("out", (f"y_{n}", stage.first))):
                board.resistor(Role.REGULARISING, f"l_{n}_{end}", nodes, ohms)


TOPOLOGY = Ridge()
