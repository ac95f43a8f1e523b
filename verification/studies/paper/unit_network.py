"""Ideal networks in the units of the paper: unit conductance, voltage, capacitance and slope."""

from __future__ import annotations

from spice_models.array_types import Floats
from verification.reference import IdealNetwork


def unit_network(
    T: Floats,
    strain: Floats,
    mu: float,
    amplifier: str = "exponential",
    *,
    bias: bool = True,
    C: float = 1.0,
) -> IdealNetwork:
    """Return the network with R = 1 and ``s = 1 / mu``, so that times are in units of R C.

    `mu` is ``1 / (s R)``: lambda for linear amplifiers, half of lambda for exponential ones.
    """
    biased = bias and amplifier == "exponential"
    return IdealNetwork(T, strain, 1.0, 1.0, 1.0, C, 1.0 / mu, amplifier, 1.0, biased)
