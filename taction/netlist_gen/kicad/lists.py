"""The lists of a board as CSV: its parts in the columns of KiCad, and its wires pin by pin."""

from __future__ import annotations

import csv
import io
import re
from collections.abc import Iterable
from typing import Any

from taction.netlist_gen.board.circuit import GROUND
from taction.netlist_gen.kicad.part_symbols import BoardParts

# The columns of KiCad's own lists, then ours; parts that agree in GROUPED share a row.
COLUMNS = ("Reference", "Value", "Datasheet", "Footprint", "Qty", "DNP")
OWN = ("Tolerance", "MPN", "Description")
GROUPED = ("Value", "Tolerance", "MPN", "Description")
WIRES = ("Net", "Part", "Pin", "Name", "Unit", "Value", "Deck")


def parts_list(parts: BoardParts) -> str:
    """Return the parts of the whole board as CSV, as ``kicad-cli sch export bom`` writes it.

    Parts of one value, tolerance and kind share a row. Supplies have decoupling capacitors here,
    which the deck does not have.
    """
    rows: dict[tuple[str, ...], list[str]] = {}
    units = (*parts.signal, *parts.supply)
    drawn = {unit.part.reference: unit.part for unit in units if unit.part.symbol.bought}
    for part in drawn.values():
        key = (part.value, *(part.fields.get(name, "") for name in OWN))
        rows.setdefault(key, []).append(part.reference)
    lines = (
        (",".join(names), value, "", "", len(names), "", *own)
        for (value, *own), names in rows.items()
    )
    return _csv([(*COLUMNS, *OWN), *lines], quoting=csv.QUOTE_ALL)


def wiring(parts: BoardParts) -> str:
    """Return the list of wires as CSV: a row for every pin, by nets.

    Examples
    --------
    >>> import taction
    >>> scene = taction.load_scene("scenes/custom-matrix.toml")
    >>> rows = wiring(BoardParts(taction.synthesise(scene), scene)).splitlines()
    >>> rows[0], next(row for row in rows if row.startswith("v_1,U"))
    ('Net,Part,Pin,Name,Unit,Value,Deck', 'v_1,U1,6,out,A,OPA189,Xv_1')
    """
    rows = []
    for unit in (*parts.signal, *parts.supply):
        part = unit.part
        letter = chr(ord("A") + part.unit - 1) if len(part.symbol.units) > 1 and unit.deck else ""
        for pin, node in zip(part.pins, unit.nets, strict=True):
            net = "GND" if node == GROUND else node
            name = "" if pin.name == pin.number else {"~": "out"}.get(pin.name, pin.name)
            rows.append((net, part.reference, pin.number, name, letter, part.value, unit.deck))
    return _csv([WIRES, *sorted(rows, key=_natural)])


def _natural(row: tuple[str, ...]) -> list[list[tuple[int, str]]]:
    """Return the sort key of a row: net, part and pin, their numbers as numbers."""
    found = (re.findall(r"\d+|\D+", text) for text in row[:3])
    return [[(int(part) if part.isdigit() else -1, part) for part in name] for name in found]


def _csv(rows: Iterable[tuple[object, ...]], **form: Any) -> str:
    text = io.StringIO()
    csv.writer(text, lineterminator="\n", **form).writerows(rows)
    return text.getvalue()
