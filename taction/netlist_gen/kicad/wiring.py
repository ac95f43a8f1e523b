"""What is joined to what on a board, pin by pin of real packages, from the circuit alone.

Op-amps fill the packages in the order of the circuit; those that are left are followers at ground.
References, pins and nets are those of the drawing.
"""

from __future__ import annotations

import csv
import io
import re
from collections.abc import Iterator

from taction.netlist_gen.board.bill_of_materials import packages
from taction.netlist_gen.board.circuit import GROUND
from taction.netlist_gen.kicad.parts import Catalogue, spare_node
from taction.netlist_gen.kicad.sheet import SymbolPart
from taction.netlist_gen.kicad.stages import Passive

COLUMNS = ("Net", "Part", "Pin", "Name", "Unit", "Value", "Deck")
Joined = tuple[SymbolPart, str, tuple[str, ...]]
"""A unit of a part, its name in the deck, and the net of each of its pins."""


def joined_parts(catalogue: Catalogue) -> Iterator[Joined]:
    """Yield every part of a board with its nets; a package once for each unit and its supply."""
    circuit = catalogue.circuit
    matrices = (part for each in circuit.matrices for part in each.resistors())
    passives: tuple[Passive, ...] = *circuit.resistors, *matrices, *circuit.real_capacitors
    for part in passives:
        yield catalogue.part(part), part.card, (part.a, part.b)
    for current in circuit.currents:
        yield catalogue.part(current), current.card, (GROUND, current.node)
    for voltage in circuit.voltages:
        yield catalogue.part(voltage), voltage.card, (voltage.node, GROUND)
    for amplifier in circuit.amplifiers:
        yield catalogue.function(amplifier), amplifier.card, (amplifier.input, amplifier.output)
    for place, cell in enumerate(circuit.transistors):
        nodes = cell.base, cell.collector, cell.emitter
        yield catalogue.transistor(place), cell.card, nodes
    yield from _opamps(catalogue)


def _opamps(catalogue: Catalogue) -> Iterator[Joined]:
    cells = {cell.name: cell for cell in catalogue.circuit.opamps}
    plus, minus = (symbol.name for symbol in catalogue.rails)
    for package in packages(catalogue.circuit):
        name = package.reference
        for unit, held in enumerate(package.opamps, 1):
            cell = cells[held]
            nodes = cell.inverting, cell.noninverting, cell.output
            yield catalogue.opamp(name, unit), cell.card, nodes
        first = 1 + len(package.opamps)
        for unit in range(first, first + package.spare):
            node = spare_node(name, unit)
            yield catalogue.opamp(name, unit), "not used", (node, GROUND, node)
        yield catalogue.opamp(name), "", (plus, minus)
        yield catalogue.decoupling(name, 1), "", (plus, GROUND)
        yield catalogue.decoupling(name, 2), "", (GROUND, minus)


def wiring(catalogue: Catalogue) -> str:
    """Return the list of wires as CSV: a row for every pin, by nets.

    Examples
    --------
    >>> import taction
    >>> scene = taction.load_scene("scenes/custom-matrix.toml")
    >>> rows = wiring(Catalogue(taction.synthesise(scene), scene)).splitlines()
    >>> rows[0], next(row for row in rows if row.startswith("v_1,U"))
    ('Net,Part,Pin,Name,Unit,Value,Deck', 'v_1,U1,6,out,A,OPA189,Xv_1')
    """
    rows: list[tuple[str, ...]] = []
    for part, deck, nodes in joined_parts(catalogue):
        several = len(part.symbol.units) > 1
        unit = chr(ord("A") + part.unit - 1) if several and deck else ""
        for pin, node in zip(part.symbol.units[part.unit - 1], nodes, strict=True):
            net = "GND" if node == GROUND else node
            name = "" if pin.name == pin.number else {"~": "out"}.get(pin.name, pin.name)
            rows.append((net, part.reference, pin.number, name, unit, part.value, deck))
    rows.sort(key=_natural)
    text = io.StringIO()
    table = csv.writer(text, lineterminator="\n")
    table.writerow(COLUMNS)
    table.writerows(rows)
    return text.getvalue()


def _natural(row: tuple[str, ...]) -> list[list[tuple[int, str]]]:
    """Return the sort key of a row: net, part and pin, their numbers as numbers."""
    found = ([str(part) for part in re.findall(r"\d+|\D+", text)] for text in row[:3])
    return [[(int(part) if part.isdigit() else -1, part) for part in name] for name in found]
