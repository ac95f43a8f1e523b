"""The parts of a schematic and of its list: symbol, reference, value and fields of each."""

from __future__ import annotations

import re
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from functools import cache, cached_property

from taction.netlist_gen.board.bill_of_materials import packages, tolerance_of
from taction.netlist_gen.board.circuit import (
    Capacitor,
    Circuit,
    CurrentSource,
    OpAmpCell,
    Resistor,
    SignalAmplifier,
    VoltageSource,
)
from taction.netlist_gen.kicad.sheet import Part
from taction.netlist_gen.kicad.symbols import (
    CAPACITOR,
    CURRENT,
    FLAG,
    FUNCTION,
    GROUND,
    RESISTOR,
    USUAL_PINS,
    VOLTAGE,
    Symbol,
    opamp,
    rail,
    transistor_pair,
)
from taction.netlist_gen.scene.open_tables import OPAMPS
from taction.netlist_gen.scene.scene import Scene
from taction.system.quantities import show

INNER = re.compile(r"(_\d+)(_[a-z]+)$")
ODD = re.compile(r"[^A-Za-z0-9_.+-]")  # not in the name of a symbol
DIGITS = 4  # of a value; the field Exact has all of them
DECOUPLING = 100e-9  # F, from each supply pin to ground: no part of the deck


@cache
def value_text(value: float) -> str:
    """Return a value as a schematic has it.

    Examples
    --------
    >>> value_text(52631.578947), value_text(1e-11), value_text(4.7e6), value_text(-2e-6)
    ('52.63k', '10p', '4.7M', '-2u')
    """
    return show(value, "", DIGITS).replace(" ", "")


def reference(name: str) -> str:
    """Return the reference of a part of the deck: KiCad wants a number at the end.

    Examples
    --------
    >>> reference("Rf_2_3"), reference("Ra_1_in"), reference("Vbias")
    ('Rf_2_3', 'Ra_in_1', 'Vbias_1')
    """
    moved = INNER.sub(r"\2\1", name)
    return moved if moved[-1].isdigit() else f"{moved}_1"


@dataclass(frozen=True)
class Catalogue:
    """The parts of a board as symbols; references of op-amps are those of ``taction bom``."""

    circuit: Circuit
    scene: Scene | None = None  # without it op-amps have the name of their model

    @cached_property
    def opamp_name(self) -> str:
        """The name of the op-amps: a preset, or the file of an imported one without its folder."""
        if self.scene is None:
            return next(iter(self.circuit.models))
        choice = self.scene.design.opamp
        return (choice.file or choice.base).rpartition("/")[2].partition(".")[0].upper()

    @cached_property
    def changed(self) -> bool:
        """Whether the op-amps have figures that no part of this name has."""
        return self.scene is None or bool(
            self.scene.design.opamp.model_fields_set - {"base", "file"}
        )

    @cached_property
    def opamp_symbol(self) -> Symbol:
        """The symbol of a package of op-amps."""
        count = next(iter(self.circuit.models.values())).channels_per_package
        choice = None if self.scene is None else self.scene.design.opamp
        preset = "" if choice is None or choice.file else choice.base
        usual = preset in USUAL_PINS and count == OPAMPS[preset].channels_per_package
        return opamp(ODD.sub("_", self.opamp_name), count, usual=usual)

    @cached_property
    def units(self) -> dict[str, tuple[str, int]]:
        """Package and unit, from 1, of each op-amp by its name."""
        return {
            name: (package.reference, unit)
            for package in packages(self.circuit)
            for unit, name in enumerate(package.opamps, 1)
        }

    def resistor(self, part: Resistor) -> Part:
        """Return a resistor."""
        fields = self._fields("resistor", part.card, part.ohms)
        return _named(RESISTOR, part.card, value_text(part.ohms), fields)

    def capacitor(self, part: Capacitor) -> Part:
        """Return a capacitor."""
        fields = self._fields("capacitor", part.card, part.farads)
        return _named(CAPACITOR, part.card, value_text(part.farads), fields)

    @property
    def symbols(self) -> Iterator[Symbol]:
        """The symbols that drawings of this board's channels need."""
        yield from (RESISTOR, CAPACITOR, CURRENT, VOLTAGE, FUNCTION, GROUND, FLAG)
        yield from (*self.rails, self.opamp_symbol)
        if self.circuit.transistors:
            yield self.transistor(1, 1).symbol

    @property
    def rails(self) -> tuple[Symbol, Symbol]:
        """The symbols of both supplies."""
        return rail(f"+{self.circuit.supply:g}V"), rail(f"-{self.circuit.supply:g}V")

    def part(self, part: Resistor | Capacitor) -> Part:
        """Return a resistor or a capacitor."""
        return self.resistor(part) if isinstance(part, Resistor) else self.capacitor(part)

    def decoupling(self, package: str, number: int) -> Part:
        """Return the first or second capacitor from the supply pins of a package to ground."""
        fields = {"Exact": f"{DECOUPLING!r} F", "Description": "decoupling, not in the deck"}
        name = f"C{package}_{number}"
        return Part(CAPACITOR, name, value_text(DECOUPLING), fields)

    def _fields(self, kind: str, name: str, value: float) -> dict[str, str]:
        unit = {"resistor": "ohm", "capacitor": "F"}[kind]
        tolerance = None if self.scene is None else tolerance_of(self.scene, kind, name)
        return {
            "Tolerance": "" if tolerance is None else f"{100 * tolerance:.3g} %",
            "Exact": f"{value!r} {unit}",
            "Description": kind,
        }

    def opamp(self, cell: OpAmpCell) -> Part:
        """Return an op-amp as a unit of its package."""
        package, unit = self.units[cell.name]
        return self.opamp_unit(package, unit)

    def opamp_unit(self, package: str, unit: int | None = None) -> Part:
        """Return a unit of a package, by default that with the supply pins."""
        symbol = self.opamp_symbol
        choice = None if self.scene is None or self.changed else self.scene.design.opamp
        real = choice is not None and choice.file is None and choice.base != "ideal"
        text = "op-amp" if real else "op-amp: no part with exactly these figures is known"
        fields = {"MPN": self.opamp_name if real else "", "Description": text}
        return Part(symbol, package, self.opamp_name, fields, unit or len(symbol.units))

    def transistor(self, n: int, unit: int) -> Part:
        """Return a transistor of the pair of channel `n`."""
        name, pair = next(iter(self.circuit.transistor_models.items()))
        symbol = transistor_pair(name.upper(), pair.polarity)
        fields = {"MPN": name.upper(), "Description": "matched pair"}
        return Part(symbol, f"Q{n}", name.upper(), fields, unit)

    def function(self, part: SignalAmplifier) -> Part:
        """Return an ideal amplifier, which is no part that can be bought."""
        fields = {"Description": f"ideal {part.kind} amplifier, no part"}
        value = f"{value_text(-part.u_scale)}V {part.kind}(v/{value_text(part.v_scale)}V)"
        return _named(FUNCTION, part.card, value, fields)

    def strain(self, part: CurrentSource) -> Part:
        """Return the strain current of a row, which a sensor gives."""
        fields = {"Exact": f"{part.amps!r} A", "Description": "strain, from t = 0"}
        return _named(CURRENT, part.card, f"{value_text(part.amps)}A", fields)

    def voltage(self, part: VoltageSource) -> Part:
        """Return a constant voltage of the board."""
        fields = {"Exact": f"{part.volts!r} V", "Description": "constant voltage"}
        return _named(VOLTAGE, part.card, f"{value_text(part.volts)}V", fields)


def _named(symbol: Symbol, name: str, value: str, fields: Mapping[str, str]) -> Part:
    """Return a part of the deck; its field Deck has the name there."""
    return Part(symbol, reference(name), value, {"Deck": name, **fields})
