"""Topology ``inv``: one op-amp a row solves ``T u = eps``, without regularisation.

Row n of the array is at the inverting input of op-amp n, whose output drives column n::

    channel n    op-amp, its input x_n summing row n, its output v_n
    strain       eps_n G0 U0 into x_n
    at rest      (G0 T + E/A0) V = -G0 U0 eps,   u = -V/U0        E: conductance at each input

The loop is closed through T itself: the board is stable only if T has the right sign of all its
modes (`docs/closed-loop.md`).
"""

from __future__ import annotations

import numpy as np

from taction.netlist_gen.board.circuit import Role
from taction.netlist_gen.scene.scene import Scene
from taction.netlist_gen.topologies.frame.loops import Loop, LoopBoard
from taction.system.array_types import Floats
from taction.system.errors import Complaint, InputError


class Inverse(Loop):
    """An op-amp for every row of a square matrix."""

    name = "inv"
    has_first_stages = False
    exact = True
    searched = ("design.unit_conductance", "design.unit_voltage")

    def check(self, scene: Scene, T: Floats) -> None:
        """Refuse a matrix that is not square, or that has a row or a column of zeros."""
        M, N = T.shape
        if M != N:
            text = (
                f"T has {M} rows and {N} columns; 'inv' needs as many rows as columns ('pinv'"
                " solves by least squares)"
            )
            raise InputError(scene.file, Complaint("design.topology", repr(self.name), text))
        for axis, line in ((1, "row"), (0, "column")):
            for number in (1 + np.flatnonzero(~np.any(T, axis=axis))).tolist():
                text = f"{line} {number} of T is all zeros, so there is no solution"
                raise InputError(scene.file, Complaint("problem", "", text))

    def place(self, board: LoopBoard) -> None:
        """Place op-amps, strains and the array."""
        stages = {n: board.inputs(f"x_{n}", f"xp_{n}", board.T[n - 1]) for n in board.channels}
        for n, stage in stages.items():
            board.opamp(f"v_{n}", stage.first, f"v_{n}", stage.other)
            board.place_strain(n, stage.first)
        board.array(Role.FORWARD, {n: f"v_{n}" for n in board.channels}, stages)


TOPOLOGY = Inverse()
