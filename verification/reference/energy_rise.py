"""Rise of the network's energy along the trajectory of a board, caused by op-amp dynamics.

Along an ideal trajectory the energy P(u) of eq (16) never increases. A board's op-amps have lags,
so its energy may rise for a while, and the energy of a ringing board rises in every period. The
rise measures how far the board is from the gradient flow that the paper proves stable.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from taction.system.array_types import Floats
from taction.verification.reference import IdealNetwork
from taction.verification.reference.dynamics import ScaledNetwork
from taction.verification.reference.regularisers import REGULARISERS

INSTANTS = 2000


@dataclass(frozen=True, slots=True)
class EnergyRise:
    """Largest rise of the energy above its least earlier value."""

    rise: float  # over the fall from the first instant to the lowest energy
    time: float  # instant of the peak, s


def energy_rise(network: IdealNetwork, time: Floats, u: Floats) -> EnergyRise | None:
    """Follow the energy of outputs `u` (P, N) in V over `time` (P,) in s.

    Return None if the energy never falls, or if an output leaves the amplifier's range (a
    positive amplifier's output becomes negative, say), where the energy is undefined.
    """
    every = max(len(time) // INSTANTS, 1)
    scaled, regulariser = ScaledNetwork(network), REGULARISERS[network.amplifier]
    with np.errstate(all="ignore"):
        x = regulariser.inverse(u[::every] / network.U0)
        energy = np.array([scaled.energy(row) for row in x])
    if not np.all(np.isfinite(energy)):
        return None
    above = energy - np.minimum.accumulate(energy)
    fall = energy[0] - energy.min()
    if fall <= 0:
        return None
    peak = int(np.argmax(above))
    return EnergyRise(float(above[peak] / fall), float(time[::every][peak]))
