"""The parts of a board as units of symbols: reference, value, fields, and the net of each pin.

The drawing, the list of wires and the library of symbols are all of this one list.
"""

from __future__ import annotations

import csv
import io
import re
from collections import defaultdict
from collections.abc import Iterable, Iterator
from dataclasses import dataclass
from functools import cache, cached_property

from taction.netlist_gen.board import parts as boards
from taction.netlist_gen.board.bill_of_materials import packages, tolerance_of
from taction.netlist_gen.board.circuit import GROUND, Circuit
from taction.netlist_gen.kicad import symbols
from taction.netlist_gen.kicad.symbols import Symbol, SymbolPart
from taction.netlist_gen.scene.open_tables import OPAMPS
from taction.netlist_gen.scene.scene import Scene, own_figures
from taction.system.quantities import percent, show

INNER = re.compile(r"(_\d+)(_[a-z]+)$")
ODD = re.compile(r"[^A-Za-z0-9_.+-]")  # not in the name of a symbol
DIGITS = 4  # of a value; the field Exact has all of them
DECOUPLING = 100e-9  # F, from each supply pin to ground: no part of the deck
Passive = boards.Resistor | boards.Capacitor
TwoEnded = Passive | boards.CurrentSource | boards.VoltageSource
KINDS: dict[type, tuple[Symbol, str, str, str, str]] = {  # field, unit, letter of the value, words
    boards.Resistor: (symbols.RESISTOR, "ohms", "ohm", "", "resistor"),
    boards.Capacitor: (symbols.CAPACITOR, "farads", "F", "", "capacitor"),
    boards.CurrentSource: (symbols.CURRENT, "amps", "A", "A", "strain, from t = 0"),
    boards.VoltageSource: (symbols.VOLTAGE, "volts", "V", "V", "constant voltage"),
}


@cache
def printed_value(value: float, digits: int = DIGITS) -> str:
    """Return a value as a schematic has it."""
    return show(value, "", digits).replace(" ", "")


def reference(name: str) -> str:
    """Return the reference of a part of the deck, with a number at the end: Ra_1_in, Ra_in_1."""
    moved = INNER.sub(r"\2\1", name)
    return moved if moved[-1].isdigit() else f"{moved}_1"


@dataclass(frozen=True, slots=True)
class PartUnit:
    """A unit of a part, its name in the deck, and the net of each of its pins."""

    part: SymbolPart
    deck: str  # empty for supply pins and decoupling, which the deck does not have
    nets: tuple[str, ...]
    entry: bool = False  # a resistor of a matrix, from its driver into its summing node

    @property
    def two_ended(self) -> bool:
        """Whether it is a resistor, a capacitor or a source."""
        return self.part.symbol.prefix in ("R", "C", "I", "V")

    @property
    def entrance(self) -> str:
        """The net at which the stage of an amplifier begins; empty for other parts."""
        if all(pin.kind != "output" for pin in self.part.pins):
            return ""
        *inputs, output = self.nets
        return inputs[-1] if inputs[0] in (output, GROUND) else inputs[0]


@dataclass(frozen=True)
class BoardParts:
    """The parts of a board; op-amps are named as in ``taction export bom``."""

    circuit: Circuit
    scene: Scene

    @cached_property
    def signal(self) -> tuple[PartUnit, ...]:
        """The units between the signals of a board."""
        return tuple(self._signal())

    @cached_property
    def supply(self) -> tuple[PartUnit, ...]:
        """Voltages, supply pins and their capacitors, and op-amps without use."""
        return tuple(self._supply())

    @property
    def rails(self) -> tuple[str, str]:
        """The nets of both supplies."""
        return f"+{self.circuit.supply:g}V", f"-{self.circuit.supply:g}V"

    @cached_property
    def _at(self) -> dict[str, list[PartUnit]]:
        """The units at each net; a resistor of a matrix only at its summing node."""
        found: dict[str, list[PartUnit]] = defaultdict(list)
        for unit in self.signal:
            for net in unit.nets[-1:] if unit.entry else unit.nets:
                found[net].append(unit)
        return found

    def of(self, nets: Iterable[str]) -> list[PartUnit]:
        """Return the units at some nets, each once, with the matrix resistors that end there."""
        return list({unit.deck: unit for net in nets for unit in self._at.get(net, ())}.values())

    def _signal(self) -> Iterator[PartUnit]:
        circuit = self.circuit
        passives: tuple[Passive, ...] = (*circuit.resistors, *circuit.real_capacitors)
        for passive in passives:
            yield self._two_ended(passive, (passive.a, passive.b))
        for matrix in circuit.matrices:
            for each in matrix.resistors():
                yield self._two_ended(each, (each.a, each.b), entry=True)
        for current in circuit.currents:
            yield self._two_ended(current, (GROUND, current.node))
        for amplifier in circuit.amplifiers:
            kind, out = amplifier.kind, printed_value(-amplifier.u_scale)
            fields = {"Deck": amplifier.card, "Description": f"ideal {kind} amplifier, no part"}
            value = f"{out}V {kind}(v/{printed_value(amplifier.v_scale)}V)"
            part = SymbolPart(symbols.FUNCTION, reference(amplifier.card), value, fields)
            yield PartUnit(part, amplifier.card, (amplifier.input, amplifier.output))
        for place, cell in enumerate(circuit.transistors):
            name, pair = next(iter(circuit.transistor_models.items()))
            symbol = symbols.transistor_pair(name.upper(), pair.polarity)
            fields = {"MPN": name.upper(), "Description": "matched pair"}
            part = SymbolPart(symbol, f"Q{place // 2 + 1}", name.upper(), fields, place % 2 + 1)
            yield PartUnit(part, cell.card, (cell.base, cell.collector, cell.emitter))
        cells = {cell.name: cell for cell in circuit.opamps}
        for package in packages(circuit):
            for unit, held in enumerate(package.opamps, 1):
                nets = cells[held].inverting, cells[held].noninverting, cells[held].output
                yield PartUnit(self._opamp(package.reference, unit), cells[held].card, nets)

    def _supply(self) -> Iterator[PartUnit]:
        (plus, minus), size = self.rails, len(self._package[0].units)
        for voltage in self.circuit.voltages:
            yield self._two_ended(voltage, (voltage.node, GROUND))
        fields = {"Exact": f"{DECOUPLING!r} F", "Description": "decoupling, not in the deck"}
        for package in packages(self.circuit):
            name = package.reference
            yield PartUnit(self._opamp(name, size), "", self.rails)
            for number, nets in enumerate(((plus, GROUND), (GROUND, minus)), 1):
                value = printed_value(DECOUPLING)
                part = SymbolPart(symbols.CAPACITOR, f"C{name}_{number}", value, fields)
                yield PartUnit(part, "", nets)
            for unit in range(size - package.spare, size):  # a follower at ground, so that it rests
                node = f"unused_{name}_{unit}"
                yield PartUnit(self._opamp(name, unit), "not used", (node, GROUND, node))

    @cached_property
    def _package(self) -> tuple[Symbol, str, dict[str, str]]:
        """The symbol of a package of op-amps, their name, and their fields."""
        count = next(iter(self.circuit.models.values())).channels_per_package
        choice = self.scene.design.opamp
        name = (choice.file or choice.base).rpartition("/")[2].partition(".")[0].upper()
        preset = "" if choice.file else choice.base
        usual = preset in symbols.USUAL_PINS and count == OPAMPS[preset].channels_per_package
        symbol = symbols.opamp(ODD.sub("_", name), count, usual=usual)
        if own_figures(choice) or preset in ("", "ideal"):
            text = "op-amp: no part with exactly these figures is known"
            return symbol, name, {"MPN": "", "Description": text}
        return symbol, name, {"MPN": name, "Description": "op-amp"}

    def _opamp(self, package: str, unit: int) -> SymbolPart:
        symbol, name, fields = self._package
        return SymbolPart(symbol, package, name, fields, unit)

    def _two_ended(self, part: TwoEnded, nets: tuple[str, str], *, entry: bool = False) -> PartUnit:
        """Return a part with two ends; its field Deck has the name in the deck."""
        symbol, key, unit, letter, words = KINDS[type(part)]
        value: float = getattr(part, key)
        if isinstance(part, boards.VoltageSource) and part.switched:
            words = KINDS[boards.CurrentSource][-1]
        fields = {"Deck": part.card, "Exact": f"{value!r} {unit}", "Description": words}
        if words in ("resistor", "capacitor"):
            share = tolerance_of(self.scene, words, part.card)
            fields["Tolerance"] = "" if share is None else percent(share)
        shown = f"{printed_value(value)}{letter}"
        return PartUnit(
            SymbolPart(symbol, reference(part.card), shown, fields), part.card, nets, entry
        )


WIRES = ("Net", "Part", "Pin", "Name", "Unit", "Value", "Deck")


def wiring(parts: BoardParts) -> str:
    """Return the list of wires as CSV: a row for every pin, by nets."""
    rows = []
    for unit in (*parts.signal, *parts.supply):
        part = unit.part
        letter = chr(ord("A") + part.unit - 1) if len(part.symbol.units) > 1 and unit.deck else ""
        for pin, node in zip(part.pins, unit.nets, strict=True):
            net = "GND" if node == GROUND else node
            name = "" if pin.name == pin.number else {"~": "out"}.get(pin.name, pin.name)
            rows.append((net, part.reference, pin.number, name, letter, part.value, unit.deck))
    text = io.StringIO()
    csv.writer(text, lineterminator="\n").writerows([WIRES, *sorted(rows, key=_natural)])
    return text.getvalue()


def _natural(row: tuple[str, ...]) -> list[list[tuple[int, str]]]:
    """Return the sort key of a row: net, part and pin, their numbers as numbers."""
    found = (re.findall(r"\d+|\D+", text) for text in row[:3])
    return [[(int(part) if part.isdigit() else -1, part) for part in name] for name in found]
