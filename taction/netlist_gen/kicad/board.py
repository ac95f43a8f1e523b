"""A whole board as one KiCad project: a sheet for each channel and each sensor row.

The first sheet has these as boxes, and the supplies of all packages; labels join nets.
"""

from __future__ import annotations

import json
from collections import Counter
from collections.abc import Iterator
from dataclasses import dataclass, field
from itertools import count

from taction.netlist_gen.board.circuit import Circuit
from taction.netlist_gen.kicad.drawing import LEFT, TOP, BranchDrawing, branches
from taction.netlist_gen.kicad.part_symbols import BoardParts, printed_value
from taction.netlist_gen.kicad.sheet import TITLE, Label, SchematicSheet, library
from taction.netlist_gen.kicad.symbols import FLAG
from taction.netlist_gen.scene.scene import Scene

ACROSS, CELL = 8, (30, 22)  # places of a row of the first sheet, and their size on the grid
TABLE = """(sym_lib_table
  (version 7)
  (lib (name "taction")(type "KiCad")(uri "${{KIPRJMOD}}/{}.kicad_sym")(options "")(descr ""))
)
"""


@dataclass(frozen=True, slots=True)
class KicadProject:
    """The drawing of a board, and the files that were written."""

    DOCUMENT = ("scene = scene.name", "files = written", "not_drawn")

    scene: Scene = field(repr=False)
    files: dict[str, str] = field(repr=False)
    not_drawn: tuple[str, ...] = field(repr=False)
    written: tuple[str, ...] = ()


def kicad_project(circuit: Circuit, scene: Scene) -> KicadProject:
    """Return the KiCad project of the board of `scene`; its first file is the schematic to open."""
    parts, ports, name = BoardParts(circuit, scene), count(1), circuit.name
    sheets = {}
    for branch in branches(parts):
        sheets[branch.name] = SchematicSheet(name, branch.name)
        BranchDrawing(parts, sheets[branch.name], ports).branch(TOP, branch)
    first = BranchDrawing(parts, SchematicSheet(name), ports)
    _draw_first(first, list(sheets))
    drawn = {name: first.sheet} | sheets
    named = Counter(net for sheet in drawn.values() for net in sheet.nets)
    shared = {net for net, sheets in named.items() if sheets > 1}
    comments = (
        _knob_values(circuit),
        "Field Deck: the name in the deck; packages U as in taction export bom",
    )
    titles = {sheet: f"{scene.name}: {sheet}" for sheet in sheets} | {name: scene.name}
    files = {
        f"{title}.kicad_sch": sheet.schematic(titles[title], comments, shared)
        for title, sheet in drawn.items()
    }
    symbols = {unit.part.symbol.name: unit.part.symbol for unit in (*parts.supply, *parts.signal)}
    symbols |= {each.name: each for each in (FLAG, *first.supplies.values())}
    # KiCad takes its defaults for all that is missing in the file of the project.
    settings = {"meta": {"filename": f"{name}.kicad_pro", "version": 3}, "sheets": []}
    files |= {
        f"{name}.kicad_pro": f"{json.dumps(settings, indent=2)}\n",
        f"{scene.name}.kicad_sym": library(symbols.values()),
        "sym-lib-table": TABLE.format(scene.name),
    }
    return KicadProject(scene, files, tuple(_not_drawn(circuit)))


def _knob_values(circuit: Circuit) -> str:
    """Return the values of the knobs with a margin, and lambda, as a schematic has them."""
    facts = (circuit.facts[knob.name] for knob in circuit.knobs if knob.margin)
    values = [f"{fact.words} = {printed_value(fact.value)}{fact.unit}" for fact in facts]
    return ", ".join([*values, f"lambda = {circuit.value('lambda'):.4g}"])


def _not_drawn(circuit: Circuit) -> Iterator[str]:
    strays = len(circuit.capacitors) - len(circuit.real_capacitors)
    if strays:
        yield f"{strays} stray capacitances, which are no parts"
    if any(matrix.wires is not None for matrix in circuit.matrices):
        yield "the wires of the arrays, which are no parts"
    for model in circuit.models.values():
        if model.external_part:
            yield f"the {model.external_part} of each op-amp"
    if circuit.amplifiers:
        yield f"parts of the {circuit.amplifier} amplifier, which is ideal in this scene"


def _draw_first(drawing: BranchDrawing, names: list[str]) -> None:
    """Draw the sheets as boxes, the supplies, which KiCad must know as driven, and their parts."""
    sheet, units = drawing.sheet, drawing.parts.supply
    across = max(ACROSS, round((len(units) + len(names)) ** 0.5))
    places = ((LEFT + CELL[0] * (k % across), TOP + 6 + CELL[1] * (k // across)) for k in count())
    sheet.labels.append(Label("Channels and sensor rows, supplies", (LEFT, TOP), size=TITLE))
    for name, at in zip(names, places, strict=False):
        sheet.below[name] = at
    for symbol, (x, y) in zip(drawing.supplies.values(), places, strict=False):
        drawing.port(symbol, (x + 6, y + 6))
        drawing.port(FLAG, sheet.wire((x + 6, y + 6), (x + 12, y + 6)))
    for unit, (x, y) in zip(units, places, strict=False):
        drawing.named(unit, (x + 12, y + 8))
