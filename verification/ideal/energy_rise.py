"""The network's energy along a board's own trajectory, and where op-amp dynamics make it rise.

Along an ideal trajectory the energy P(u) of eq (16) never increases. A board's op-amps have lags,
so its energy may rise for a while, and on a ringing board it does in every period: by how much is
a measure of how far the board is from the gradient flow that the paper proves stable.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from spice_models.array_types import Floats
from verification.reference import IdealNetwork
from verification.reference.dynamics import ScaledNetwork
from verification.reference.regularisers import REGULARISERS

INSTANTS = 2000


@dataclass(frozen=True, slots=True)
class EnergyRise:
    """How far the energy of a board's outputs rises above what it had been already.

    Attributes
    ----------
    rise : float
        Largest rise over the fall from the first instant to the lowest energy.
    time : float
        Where it peaks, s.
    """

    rise: float
    time: float


def energy_rise(network: IdealNetwork, time: Floats, u: Floats) -> EnergyRise | None:
    """Follow the energy of outputs `u` (P, N) in V over `time` (P,) in s.

    Returns None where an output leaves the amplifier's range (a positive one's became negative,
    say), for such outputs have no energy, and where the energy never falls.
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
