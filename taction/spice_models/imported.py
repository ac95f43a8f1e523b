"""An imported op-amp as data: a vendor's subcircuit, its measured figures, its linear model."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Annotated

from taction.spice_models.branches import Branch

ROLES = ("inp", "inn", "vcc", "vee", "out")
"""What a port of the subcircuit is: inputs, supplies, output; `REST` for a port left open."""
REST = "nc"
DEVICE = "xdevice"  # the instance of a subcircuit on its bench, and in the deck of a board
COMPENSATION = "comp"  # role of two ports between which a part needs its compensation capacitor


@dataclass(frozen=True, slots=True)
class Subcircuit:
    """A subcircuit that was checked: its ports, and its text with those that it calls."""

    name: str
    ports: tuple[str, ...]
    lines: tuple[str, ...]


@dataclass(frozen=True, slots=True)
class LinearModel:
    """The circuit of an op-amp at its operating point: its cards, each linear or measured alone.

    The ports are the nodes ``inp``, ``inn`` and ``out``; the supplies are among the `parts`.
    `error` is the largest relative difference from ngspice's own small signal over the `band`
    (lowest and highest frequency, Hz).
    """

    parts: tuple[Branch, ...]
    error: float
    band: Annotated[tuple[float, float], "Hz"]


@dataclass(frozen=True, slots=True)
class Figures:
    """What the simulation of an imported op-amp shows, SI base units, degrees, dB.

    None: the netlist has no such limit, or it is not known.
    """

    dc_gain: float
    unity_gain_bandwidth: Annotated[float, "Hz"]
    phase_margin: float
    output_resistance: Annotated[float, "ohm"]  # open loop, at the unity-gain bandwidth
    supply_current: Annotated[float, "A"]
    offset_voltage: Annotated[float | None, "V"] = None  # adds to v_p
    bias_current: Annotated[float | None, "A"] = None  # mean of the currents into the inputs
    offset_current: Annotated[float | None, "A"] = None  # of inp less inn
    common_mode_rejection: float | None = None  # at DC
    slew_rate: Annotated[float | None, "V/s"] = None  # the smaller one of rise and fall
    swing: Annotated[float | None, "V"] = None  # of the output, the smaller one of both signs
    differential_resistance: Annotated[float | None, "ohm"] = None  # between the inputs
    common_resistance: Annotated[float | None, "ohm"] = None  # of each input to ground
    differential_capacitance: Annotated[float | None, "F"] = None
    common_capacitance: Annotated[float | None, "F"] = None


@dataclass(frozen=True, slots=True)
class ImportedOpAmp:
    """An imported op-amp; without a `linear` model, `missing` says why there is none."""

    subcircuit: Subcircuit
    pins: tuple[str, ...]  # the role of each port
    supply: float  # of each supply voltage at which it was measured, V
    figures: Figures
    linear: LinearModel | None
    missing: str = ""
    compensation: float = 0.0  # capacitor between the ports `COMPENSATION`, F
    doubts: tuple[str, ...] = ()  # what is unusual for an op-amp

    def text(self, name: str) -> str:
        """Return the cards of the op-amp `name` with the ports inp, inn, out and own supplies."""
        return "\n".join(
            [
                *self.subcircuit.lines,
                f".subckt {name} inp inn out",
                f"Vcc vcc 0 {self.supply!r}",
                f"Vee vee 0 {-self.supply!r}",
                instance(self.subcircuit, self.pins, self.compensation),
                f".ends {name}",
                "",
            ]
        )


def port_nodes(pins: tuple[str, ...]) -> list[str]:
    """Return the nodes of the ports, named after their roles."""
    return [f"{role}{k}" if role in (REST, COMPENSATION) else role for k, role in enumerate(pins)]


def instance(subcircuit: Subcircuit, pins: tuple[str, ...], compensation: float = 0.0) -> str:
    """Return the card that calls a subcircuit with nodes named after the roles of its ports."""
    nodes = port_nodes(pins)
    cards = [" ".join((DEVICE.capitalize(), *nodes, subcircuit.name))]
    cards += [f"R{node} {node} 0 1e12" for node in nodes if node.startswith(REST)]
    if COMPENSATION in pins:
        both = " ".join(node for node in nodes if node.startswith(COMPENSATION))
        cards.append(f"Ccomp {both} {compensation!r}")
    return "\n".join(cards)


def check_pins(pins: tuple[str, ...], ports: tuple[str, ...]) -> None:
    """Raise ValueError unless every port has a role, and every role but `REST` one port."""
    named = [role for role in pins if role not in (REST, COMPENSATION)]
    if len(pins) != len(ports) or sorted(named) != sorted(ROLES):
        raise ValueError(
            f"expected one role for each of the {len(ports)} ports ({' '.join(ports)}):"
            f" {', '.join(ROLES)}, each once, {REST!r} for a port that stays open, and"
            f" {COMPENSATION!r} for the two ports of a compensation capacitor"
        )
    if pins.count(COMPENSATION) not in (0, 2):
        raise ValueError(f"a capacitor needs two ports {COMPENSATION!r}, or there are none")
