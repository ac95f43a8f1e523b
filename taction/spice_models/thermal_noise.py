"""Thermal noise of resistors."""

from __future__ import annotations

BOLTZMANN = 1.380649e-23  # J/K
TEMPERATURE = 300.15  # K: 27 degrees C, ngspice's default
THERMAL = 4.0 * BOLTZMANN * TEMPERATURE
"""Spectral density for positive frequencies: V²/Hz of a resistance of 1 ohm, A²/Hz of 1 S."""
