"""The amplifiers of a board as functions of their inputs.

Where the straight pieces of an amplifier meet, the solution bends, and the integrator's steps are
short there. The right-hand side of a board with a continuous g is Lipschitz continuous, so one
solution passes through every state: it neither slides along a break nor chatters there. Only an
amplifier that drives its own input without any delay, by a gain above 1, makes the equations
ambiguous, as a Schmitt trigger's are; `JUMPS` refuses in words what comes near that.
"""

from __future__ import annotations

import numpy as np

from taction.system.array_types import Floats
from taction.verification.engines.statespace.equations.amplifier_gains import GAINS, gain_of
from taction.verification.engines.statespace.equations.descriptor import Devices

BEYOND = "an amplifier is beyond the range of floats in the initial state"
JUMPS = (
    "some of its amplifiers drive their own inputs without delay, by a gain above 1/2: the board"
    " may have several voltages for one state, and jump. Give the op-amps a bandwidth, or the"
    " signal nodes a capacitance"
)


class Amplifiers:
    """The amplifiers of a board as functions of their inputs (m, s), V.

    `steepest` (m,) are the largest slopes of those of straight pieces, V/V, and 0 of all others.
    """

    def __init__(self, devices: Devices) -> None:
        self.gain, self.count = gain_of(devices.kinds), devices.count
        self.u_scale, self.v_scale = devices.u_scale[:, None], devices.v_scale[:, None]
        rises = [float(GAINS[kind].rises.max(initial=0.0)) for kind in devices.kinds]
        self.steepest: Floats = devices.u_scale / devices.v_scale * rises

    @property
    def bends(self) -> bool:
        """Whether any amplifier has straight pieces."""
        return bool(self.steepest.any())

    def outputs(self, inputs: Floats) -> Floats:
        """Return the outputs, V; not finite beyond the range of floats."""
        return np.asarray(-self.u_scale * self.gain.outputs(inputs / self.v_scale))

    def slopes(self, inputs: Floats) -> Floats:
        """Return the slopes, V/V; not finite beyond the range of floats."""
        with np.errstate(over="ignore"):
            slope = self.gain.slope(inputs / self.v_scale)
            return np.asarray(-self.u_scale / self.v_scale * slope)
