"""Topology ``integrator``: every current flows into a virtual ground, so no resistor loads a node.

For ideal op-amps eq (9), in its corrected form, holds exactly::

    signal node n      op-amp, R || C from v_n to the summing node x_n
    signal amplifier   inverter (linear) or antilog stage, a_n = -u_n
    constraint node k  op-amp, feedback s, strain into c_k; w_k = s G0 (T u - eps U0)_k
    matrix forward     T_kn > 0: a_n -> c_k     T_kn < 0: +u_n -> c_k
    matrix feedback    T_kn > 0: w_k -> x_n     T_kn < 0: -w_k -> x_n
    bias               I_b as Ve through R into x_n (entropy only)
"""

from __future__ import annotations

from taction.netlist_gen.board.circuit import Role
from taction.netlist_gen.board.parts import VoltageSource
from taction.netlist_gen.topologies.frame.planes import Planes, PlanesBoard
from taction.netlist_gen.topologies.frame.topology import slope_of

BIAS = "bias"  # the node, and the voltage source of the bias currents


class Integrator(Planes):
    """An op-amp at every signal node."""

    name = "integrator"

    def signal_node(self, board: PlanesBoard, n: int) -> str:
        """Place op-amp, R, C and the bias of channel `n`; return its summing node."""
        x, v, scene = f"x_{n}", f"v_{n}", board.scene
        ohms = board.facts["R"].value
        board.opamp(f"v_{n}", x, v)
        board.resistor(Role.SIGNAL_RESISTOR, f"r_{n}", (v, x), ohms)
        board.capacitor(Role.SIGNAL_CAPACITOR, f"c_{n}", (v, x), board.facts["C"].value)
        if scene.design.biased:
            if n == 1:
                board.place(VoltageSource(BIAS, BIAS, slope_of(scene)))
            board.resistor(Role.BIAS_RESISTOR, f"bias_{n}", (BIAS, x), ohms)
        return x


TOPOLOGY = Integrator()
