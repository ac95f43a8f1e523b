"""Knobs of a board: numbers that move its parts without a new synthesis."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field

from taction.netlist_gen.board.circuit import Capacitor, Circuit, Resistor, Role
from taction.netlist_gen.scene.keys import Value

Parts = tuple[Capacitor | Resistor, ...]


@dataclass(frozen=True, slots=True)
class Knob:
    """A number of a board that is proportional to the values of some parts.

    Attributes
    ----------
    path, unit : str
        The key of the scene, and its SI unit.
    name, symbol : str
        How results and sentences call it.
    upwards : bool
        Whether a stable board becomes unstable as the number grows (else as it falls).
    own : callable
        The number of a circuit.
    parts : callable
        The parts of a circuit that follow the number; all of one kind.
    moved : callable
        A circuit with another number.
    unrounded : mapping
        Keys of the scene with which no series rounds the number.
    """

    path: str
    unit: str
    name: str
    symbol: str
    upwards: bool
    own: Callable[[Circuit], float]
    parts: Callable[[Circuit], Parts]
    moved: Callable[[Circuit, float], Circuit]
    unrounded: Mapping[str, Value] = field(default_factory=dict)


def with_capacitance(circuit: Circuit, farads: float) -> Circuit:
    """Return `circuit` with another C; all signal-plane capacitors scale by one factor."""
    return circuit.turned("C", farads)


def with_gain(circuit: Circuit, ohms: float) -> Circuit:
    """Return `circuit` with another gain s and the same R; all resistors s scale by one factor."""
    return circuit.turned("gain", ohms)


def signal_capacitors(circuit: Circuit) -> tuple[Capacitor, ...]:
    """Return the capacitors C, one for each signal node."""
    return circuit.capacitors_of(Role.SIGNAL_CAPACITOR)


def gain_resistors(circuit: Circuit) -> tuple[Resistor, ...]:
    """Return the feedback resistors s, one for each constraint node."""
    return circuit.resistors_of(Role.CONSTRAINT_RESISTOR)


CAPACITANCE = Knob(
    path="design.capacitance",
    unit="F",
    name="capacitance",
    symbol="C",
    upwards=False,
    own=lambda circuit: circuit.value("C"),
    parts=signal_capacitors,
    moved=with_capacitance,
    unrounded={"design.capacitor_series": "exact"},
)
GAIN = Knob(
    path="design.gain",
    unit="ohm",
    name="gain",
    symbol="the gain",
    upwards=True,
    own=lambda circuit: circuit.value("gain"),
    parts=gain_resistors,
    moved=with_gain,
)
KNOBS = {knob.path: knob for knob in (CAPACITANCE, GAIN)}
