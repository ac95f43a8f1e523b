"""Topology ``passive`` (Hopfield's): R and C from v_n to ground, and a buffer.

The feedback resistors end at v_n, with the opposite signs of topology ``integrator``. R_n is larger
than R to compensate the load of these resistors.
"""

from __future__ import annotations

import numpy as np

from taction.netlist_gen.board.circuit import GROUND, Role
from taction.netlist_gen.scene.scene import Scene
from taction.netlist_gen.topologies.frame.planes import Planes, PlanesBoard
from taction.netlist_gen.topologies.frame.topology import matrix_resistors
from taction.system.errors import Complaint, InputError


class Passive(Planes):
    """R and C at every signal node, without an op-amp."""

    name = "passive"
    feedback_inverts = False

    def check(self, scene: Scene) -> None:
        """Refuse antilog stages of transistors, whose dividers would load the signal nodes."""
        if scene.design.antilog.has_devices:
            text = f"a divider would load the nodes of {self.name!r}; expected 'integrator'"
            raise InputError(scene.file, Complaint("design.topology", repr(self.name), text))

    def signal_node(self, board: PlanesBoard, n: int) -> str:
        """Place R and C of channel `n`; return the signal node itself."""
        v, scene, resistance = f"v_{n}", board.scene, board.facts["R"].value
        ohms, _ = matrix_resistors(board.T[:, n - 1], scene)
        load = float(np.sum(1.0 / ohms)) + 1.0 / board.ridge_ohms
        left = 1.0 / resistance - load
        if left <= 0:
            text = (
                f"the matrix loads channel {n} of the passive topology with {load:.6g} S, so R must"
                f" be below {1.0 / load:.6g} ohm; increase lambda or use topology = 'integrator'"
            )
            value = f"{resistance:.6g} ohm"
            raise InputError(scene.file, Complaint("design.resistance", value, text))
        board.resistor(Role.SIGNAL_RESISTOR, f"r_{n}", (v, GROUND), 1.0 / left)
        board.capacitor(Role.SIGNAL_CAPACITOR, f"c_{n}", (v, GROUND), board.facts["C"].value)
        board.stray_at(v)
        if scene.design.biased:
            text = "topology 'passive' has no virtual ground for a bias current; set bias = false"
            raise InputError(scene.file, Complaint("design.bias", "true", text))
        return v

    def linear_output(self, board: PlanesBoard, n: int) -> str:
        """Place a buffer, since the matrix must not load the node; return its output."""
        board.follower(f"u_{n}", f"v_{n}", f"u_{n}")
        return f"u_{n}"


TOPOLOGY = Passive()
