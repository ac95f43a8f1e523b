"""Topology ``pinv``: two arrays with the same T solve ``T u = eps`` by least squares.

::

    sensor k     op-amp with feedback gf, its inverting input c_k summing row k of array 1
    strain       eps_k G0 U0 into c_k;  w_k = -(G0 T v + G0 U0 eps)_k / gf
    channel n    op-amp, its non-inverting input b_n summing column n of array 2, its output v_n
    at rest      T^T w = 0, so v = -pinv(T) eps U0,   u = -v/U0

gf decides speed and stability and drops out of the answer (`docs/closed-loop.md`).
"""

from __future__ import annotations

import numpy as np

from taction.netlist_gen.board.circuit import Role
from taction.netlist_gen.scene.scene import Scene
from taction.netlist_gen.topologies.frame.loops import Inputs, Loop, LoopBoard
from taction.system.array_types import Floats
from taction.system.errors import Complaint, InputError


class PseudoInverse(Loop):
    """A first stage for every sensor, and an op-amp for every channel."""

    name = "pinv"

    def check(self, scene: Scene, T: Floats) -> None:
        """Refuse a matrix that leaves a channel undetermined."""
        M, N = T.shape
        if M < N and not self.regularised:
            text = (
                f"T has {M} rows and {N} columns, so many answers fit alike; expected at least as"
                " many rows as columns, or topology 'ridge'"
            )
            raise InputError(scene.file, Complaint("design.topology", repr(self.name), text))
        for n in (1 + np.flatnonzero(~np.any(T, axis=0))).tolist():
            if not self.regularised:
                text = f"column {n} of T is all zeros, so channel {n} has no answer"
                raise InputError(scene.file, Complaint("problem", "", text))

    def place(self, board: LoopBoard) -> None:
        """Place both kinds of stages, the strains and both arrays."""
        rows = {k: board.inputs(f"c_{k}", f"cp_{k}", board.T[k - 1]) for k in board.sensors}
        columns = {n: board.inputs(f"b_{n}", f"bm_{n}", board.T[:, n - 1]) for n in board.channels}
        for k, stage in rows.items():
            board.first_stage(f"c_{k}", stage, f"w_{k}")
            board.place_strain(k, stage.first)
        for n, stage in columns.items():
            board.opamp(f"v_{n}", stage.other, f"v_{n}", stage.first)
        self.more_rows(board, columns)
        board.array(Role.FORWARD, {n: f"v_{n}" for n in board.channels}, rows)
        board.array(Role.FEEDBACK, {k: f"w_{k}" for k in board.sensors}, columns)

    def more_rows(self, board: LoopBoard, columns: dict[int, Inputs]) -> None:
        """Place rows of both arrays besides those of T."""


TOPOLOGY = PseudoInverse()
