"""A whole board as one KiCad project: a sheet for each channel and each sensor row.

The first sheet has these as boxes, whose pins are joined by the names of their nets, and the
supplies of all packages.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, field, replace
from itertools import count
from typing import Literal

from taction.netlist_gen.board.bill_of_materials import packages
from taction.netlist_gen.board.circuit import Circuit
from taction.netlist_gen.kicad.drawing import LEFT, TOP, BranchDrawing
from taction.netlist_gen.kicad.parts import Catalogue, knob_values
from taction.netlist_gen.kicad.project import project_files
from taction.netlist_gen.kicad.sheet import TITLE, Below, Label, SchematicSheet
from taction.netlist_gen.kicad.stages import branches
from taction.netlist_gen.scene.scene import Scene

ROW = 270  # width of the first sheet, steps of the grid; a large board has a wider one


@dataclass(frozen=True, slots=True)
class KicadProject:
    """The drawing of a board, and the files that were written."""

    DOCUMENT = ("scene = scene.name", "files = written", "not_drawn")

    scene: Scene = field(repr=False)
    files: dict[str, str] = field(repr=False)
    not_drawn: tuple[str, ...] = field(repr=False)
    written: tuple[str, ...] = ()


def kicad_project(circuit: Circuit, scene: Scene) -> KicadProject:
    """Return the KiCad project of the board of `scene`; its first file is the schematic to open.

    Examples
    --------
    >>> import taction
    >>> scene = taction.load_scene("scenes/custom-matrix.toml")
    >>> files = list(kicad_project(taction.synthesise(scene), scene).files)
    >>> files[0], files[1], len(files)
    ('custom-matrix.kicad_sch', 'channel-1.kicad_sch', 15)
    """
    catalogue, ports, name = Catalogue(circuit, scene), count(1), circuit.name
    first = BranchDrawing(catalogue, SchematicSheet(name), ports)
    first.shared = set()  # nets of the first sheet, which no sheet above shares
    sheets = {}
    for title, start, words in branches(circuit):
        drawing = BranchDrawing(catalogue, SchematicSheet(name, title), ports)
        drawing.branch(TOP, words, start)
        sheets[title] = drawing.sheet
    _supplies(first, _boxes(first, list(sheets.values())))
    comments = (
        knob_values(circuit),
        "Field Deck: the name in the deck; packages U as in taction export bom",
    )
    drawn = {name: first.sheet} | sheets
    schematics = {
        f"{title}.kicad_sch": sheet.schematic(
            scene.name if sheet.name == "" else f"{scene.name}: {title}", comments
        )
        for title, sheet in drawn.items()
    }
    files = schematics | project_files(catalogue, scene, name)
    return KicadProject(scene, files, tuple(_not_drawn(circuit)))


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


def _boxes(drawing: BranchDrawing, sheets: list[SchematicSheet]) -> int:
    """Draw the boxes of `sheets` in rows, each net named at the pins; return the end below."""
    root = drawing.sheet
    root.labels.append(Label("Channels and sensor rows", (LEFT, TOP), size=TITLE))
    boxes = [_box(sheet) for sheet in sheets]
    margins = [
        [max(map(len, nets), default=0) + 4 for nets in (box.inputs, box.outputs)] for box in boxes
    ]
    widths = [sum(aside) + round(box.size[0]) for box, aside in zip(boxes, margins, strict=True)]
    area = sum(wide * box.size[1] for box, wide in zip(boxes, widths, strict=True))
    row = max(ROW, round((2.0 * area) ** 0.5))
    x, y, height = LEFT, TOP + 6, 0
    for box, aside, width in zip(boxes, margins, widths, strict=True):
        if x > LEFT and x + width > row:
            x, y, height = LEFT, y + height + 10, 0
        placed = replace(box, at=(x + aside[0], y))
        root.below.append(placed)
        for net, side, pin in placed.pins:
            end = root.wire(pin, (pin[0] + (2 if side == "right" else -2), pin[1]))
            anchor: Literal["left", "right"] = "left" if side == "right" else "right"
            root.labels.append(Label(net, end, anchor, "label"))
        x, height = x + width + 4, max(height, round(box.size[1]))
    return y + height


def _box(sheet: SchematicSheet) -> Below:
    """Return the box of a sheet, its shared nets as pins: a net that it drives is an output."""
    named = {kind: dict.fromkeys(label.text for label in sheet.labels if label.kind == kind)
             for kind in ("input", "output")}  # fmt: skip
    inputs = tuple(net for net in named["input"] if net not in named["output"])
    return Below(sheet.name, (0, 0), inputs, tuple(named["output"]))


def _supplies(drawing: BranchDrawing, top: int) -> None:
    """Draw the supplies, all voltages, and the op-amps without use, below `top`."""
    held = list(packages(drawing.circuit))
    across = max(ROW // 30, round(len(held) ** 0.5))
    names = [each.reference for each in held]
    end = drawing.supplies((LEFT + 6, top + 8), names, across)
    spare = [(each.reference, 1 + len(each.opamps) + more)
             for each in held for more in range(each.spare)]  # fmt: skip
    for place, each in enumerate(spare):
        row, column = divmod(place, across)
        drawing.unused((LEFT + 16 + 30 * column, end + 24 * row), *each)
