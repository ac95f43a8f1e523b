"""Bipolar transistors as data: a matched pair's figures, its model card, and the presets."""

from __future__ import annotations

import math
import re
import tomllib
from dataclasses import dataclass, fields
from functools import cache
from pathlib import Path

from taction.spice_models.opamp import BOLTZMANN

ELECTRON = 1.602176634e-19  # A s
ZERO_CELSIUS = 273.15  # K
NOMINAL = 27.0  # degrees C: ngspice's default

_NAME = re.compile(r"[A-Za-z][A-Za-z0-9_]*")


@dataclass(frozen=True, slots=True)
class Transistor:
    """Figures of one transistor, SI base units.

    The transport current is ``IS (exp(v_be / V_T) - exp(v_bc / V_T))``, the base current
    ``IS/BF (exp(v_be / V_T) - 1) + IS/BR (exp(v_bc / V_T) - 1)``, at the inner emitter behind RE;
    the junction capacitances are constant. This is ngspice's Gummel-Poon model without its other
    effects.

    ValueError: a figure is out of its range; the text has its name, its value and the accepted
      range.
    """

    name: str  # of the model card: a letter, then letters, digits and '_'
    polarity: str  # "npn" or "pnp"
    saturation_current: float  # IS, A
    forward_gain: float  # BF
    reverse_gain: float  # BR
    emitter_resistance: float  # RE, ohm
    emitter_capacitance: float  # base to inner emitter, F
    collector_capacitance: float  # base to collector, F
    source: str = ""  # publication of the figures

    def __post_init__(self) -> None:
        if not _NAME.fullmatch(self.name):
            raise ValueError(f"name = {self.name!r}: expected a letter, then letters, digits, '_'")
        if self.polarity not in ("npn", "pnp"):
            raise ValueError(f"polarity = {self.polarity!r}: expected 'npn' or 'pnp'")
        for figure in fields(self)[2:-1]:
            if not 0.0 < getattr(self, figure.name) < math.inf:
                value = getattr(self, figure.name)
                raise ValueError(f"{figure.name} = {value!r}: must be finite and above 0")

    @property
    def sign(self) -> float:
        """1 for NPN, -1 for PNP: the sign of its voltages and currents."""
        return 1.0 if self.polarity == "npn" else -1.0


def thermal_voltage(celsius: float) -> float:
    """Return ``k T / q`` in V at a temperature in degrees C."""
    return BOLTZMANN * (celsius + ZERO_CELSIUS) / ELECTRON


def model_card(transistor: Transistor) -> str:
    """Return the ``.model`` card; an exponent of 0 makes a junction capacitance constant."""
    t = transistor
    return (
        f".model {t.name} {t.polarity}(is={t.saturation_current!r} bf={t.forward_gain!r}"
        f" br={t.reverse_gain!r} re={t.emitter_resistance!r} cje={t.emitter_capacitance!r} mje=0"
        f" cjc={t.collector_capacitance!r} mjc=0)"
    )


@cache
def load_pairs() -> dict[str, Transistor]:
    """Return the presets of ``devices.toml`` by name; the file is read once."""
    text = (Path(__file__).parent / "devices.toml").read_text("utf-8")
    tables = tomllib.loads(text)["transistors"]
    return {name: Transistor(name=name, **table) for name, table in tables.items()}
