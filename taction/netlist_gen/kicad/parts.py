"""The parts of a board as symbols with reference, value and fields."""

from __future__ import annotations

import re
from dataclasses import dataclass
from functools import cache, cached_property

from taction.netlist_gen.board import parts as boards
from taction.netlist_gen.board.bill_of_materials import changed_figures, packages, tolerance_of
from taction.netlist_gen.board.circuit import Circuit
from taction.netlist_gen.kicad import symbols
from taction.netlist_gen.kicad.sheet import SymbolPart
from taction.netlist_gen.kicad.symbols import Symbol
from taction.netlist_gen.scene.open_tables import OPAMPS
from taction.netlist_gen.scene.scene import Scene
from taction.system.quantities import percent, show

INNER = re.compile(r"(_\d+)(_[a-z]+)$")
ODD = re.compile(r"[^A-Za-z0-9_.+-]")  # not in the name of a symbol
DIGITS = 4  # of a value; the field Exact has all of them
DECOUPLING = 100e-9  # F, from each supply pin to ground: no part of the deck
TwoEnded = boards.Resistor | boards.Capacitor | boards.CurrentSource | boards.VoltageSource
KINDS: dict[type, tuple[Symbol, str, str, str, str]] = {  # field, unit, letter of the value, words
    boards.Resistor: (symbols.RESISTOR, "ohms", "ohm", "", "resistor"),
    boards.Capacitor: (symbols.CAPACITOR, "farads", "F", "", "capacitor"),
    boards.CurrentSource: (symbols.CURRENT, "amps", "A", "A", "strain, from t = 0"),
    boards.VoltageSource: (symbols.VOLTAGE, "volts", "V", "V", "constant voltage"),
}


@cache
def printed_value(value: float, digits: int = DIGITS) -> str:
    """Return a value as a schematic has it.

    Examples
    --------
    >>> printed_value(52631.578947), printed_value(1e-11), printed_value(-2e-6)
    ('52.63k', '10p', '-2u')
    """
    return show(value, "", digits).replace(" ", "")


def knob_values(circuit: Circuit) -> str:
    """Return the values of the knobs with a margin, and lambda, as a schematic has them."""
    facts = (circuit.facts[knob.name] for knob in circuit.knobs if knob.margin)
    values = [f"{fact.words} = {printed_value(fact.value)}{fact.unit}" for fact in facts]
    return ", ".join([*values, f"lambda = {circuit.value('lambda'):.4g}"])


def reference(name: str) -> str:
    """Return the reference of a part of the deck: KiCad wants a number at the end.

    Examples
    --------
    >>> reference("Rf_2_3"), reference("Ra_1_in"), reference("Vbias")
    ('Rf_2_3', 'Ra_in_1', 'Vbias_1')
    """
    moved = INNER.sub(r"\2\1", name)
    return moved if moved[-1].isdigit() else f"{moved}_1"


def spare_node(package: str, unit: int) -> str:
    """Return the net at the output of an op-amp without use, which is a follower at ground."""
    return f"unused_{package}_{unit}"


@dataclass(frozen=True)
class Catalogue:
    """The parts of a board as symbols; op-amps are named as in ``taction export bom``."""

    circuit: Circuit
    scene: Scene | None = None  # without it op-amps have the name of their model

    @cached_property
    def _opamp(self) -> tuple[Symbol, str, dict[str, str]]:
        """The symbol of a package of op-amps, their name, and their fields.

        Op-amps with figures that no part of this name has are no parts that can be bought.
        """
        count = next(iter(self.circuit.models.values())).channels_per_package
        name, preset, changed = next(iter(self.circuit.models)), "", True
        if self.scene is not None:
            choice = self.scene.design.opamp
            name = (choice.file or choice.base).rpartition("/")[2].partition(".")[0].upper()
            preset = "" if choice.file else choice.base
            changed = bool(changed_figures(self.scene))
        usual = preset in symbols.USUAL_PINS and count == OPAMPS[preset].channels_per_package
        symbol = symbols.opamp(ODD.sub("_", name), count, usual=usual)
        if changed or preset in ("", "ideal"):
            text = "op-amp: no part with exactly these figures is known"
            return symbol, name, {"MPN": "", "Description": text}
        return symbol, name, {"MPN": name, "Description": "op-amp"}

    @cached_property
    def units(self) -> dict[str, tuple[str, int]]:
        """Package and unit, from 1, of each op-amp by its name."""
        return {
            name: (package.reference, unit)
            for package in packages(self.circuit)
            for unit, name in enumerate(package.opamps, 1)
        }

    @cached_property
    def rails(self) -> tuple[Symbol, Symbol]:
        """The symbols of both supplies."""
        supply = f"{self.circuit.supply:g}V"
        return symbols.rail(f"+{supply}"), symbols.rail(f"-{supply}")

    def part(self, part: TwoEnded) -> SymbolPart:
        """Return a part with two ends; its field Deck has the name in the deck."""
        symbol, key, unit, letter, words = KINDS[type(part)]
        value: float = getattr(part, key)
        if isinstance(part, boards.VoltageSource) and part.switched:
            words = KINDS[boards.CurrentSource][-1]
        fields = {"Deck": part.card, "Exact": f"{value!r} {unit}", "Description": words}
        if words in ("resistor", "capacitor"):
            share = None if self.scene is None else tolerance_of(self.scene, words, part.card)
            fields["Tolerance"] = "" if share is None else percent(share)
        return SymbolPart(symbol, reference(part.card), f"{printed_value(value)}{letter}", fields)

    def decoupling(self, package: str, number: int) -> SymbolPart:
        """Return the first or second capacitor from the supply pins of a package to ground."""
        fields = {"Exact": f"{DECOUPLING!r} F", "Description": "decoupling, not in the deck"}
        name = f"C{package}_{number}"
        return SymbolPart(symbols.CAPACITOR, name, printed_value(DECOUPLING), fields)

    def opamp(self, package: str, unit: int | None = None) -> SymbolPart:
        """Return a unit of a package of op-amps, by default that with the supply pins."""
        symbol, name, fields = self._opamp
        return SymbolPart(symbol, package, name, fields, unit or len(symbol.units))

    def transistor(self, place: int) -> SymbolPart:
        """Return a transistor by its place in the circuit; two are a pair."""
        name, pair = next(iter(self.circuit.transistor_models.items()))
        symbol = symbols.transistor_pair(name.upper(), pair.polarity)
        fields = {"MPN": name.upper(), "Description": "matched pair"}
        return SymbolPart(symbol, f"Q{place // 2 + 1}", name.upper(), fields, place % 2 + 1)

    def function(self, part: boards.SignalAmplifier) -> SymbolPart:
        """Return an ideal amplifier, which is no part that can be bought."""
        fields = {"Deck": part.card, "Description": f"ideal {part.kind} amplifier, no part"}
        value = f"{printed_value(-part.u_scale)}V {part.kind}(v/{printed_value(part.v_scale)}V)"
        return SymbolPart(symbols.FUNCTION, reference(part.card), value, fields)
