"""A board as a KiCad project: a sheet for each channel and each sensor row.

A branch is a part of the board that is connected without the matrices, ground and the constant
voltages: a channel, or a sensor row. A stage is an amplifier with the parts into its input node and
its feedback; a branch is drawn as its stages, one below the other. All this is found from the
board's nets alone. The first sheet has the others as boxes, and the supplies of all packages;
labels join nets.
"""

from __future__ import annotations

import json
from collections import Counter, defaultdict
from collections.abc import Collection, Iterator
from dataclasses import dataclass, field, replace
from itertools import count
from typing import Literal

import numpy as np

from taction.netlist_gen.board.circuit import GROUND, Circuit, Role
from taction.netlist_gen.kicad import symbols
from taction.netlist_gen.kicad.part_symbols import BoardParts, PartUnit
from taction.netlist_gen.kicad.sheet import TITLE, Label, Placed, SchematicSheet, library
from taction.netlist_gen.kicad.symbols import FLAG, Point, Symbol, SymbolPart
from taction.netlist_gen.scene.scene import Scene

LEFT, TOP = 12, 14  # of the drawing
RUNG, WIDTH = 4, 31  # distance of the parts into a node, and their width with wires and label
LEVEL = 8  # height of one feedback part over an op-amp
ROW, COLUMN = 14, 72  # least height of a stage, and its width
KINDS = {Role.FEEDBACK: ("channel", "Signal plane, channel"),
         Role.FORWARD: ("row", "Constraint plane, sensor row")}  # fmt: skip


@dataclass(frozen=True, slots=True)
class Stage:
    """A node with the parts into it, its amplifier, and the parts from the output to the node."""

    node: str
    rungs: tuple[PartUnit, ...]
    amplifier: PartUnit | None = None
    feedback: tuple[PartUnit, ...] = ()


@dataclass(frozen=True, slots=True)
class DrawnBranch:
    """A channel or a sensor row: the name of its sheet, its title, and its nodes in their order."""

    name: str
    title: str
    nodes: tuple[str, ...]


def branches(parts: BoardParts) -> Iterator[DrawnBranch]:
    """Yield each branch of a board once."""
    circuit = parts.circuit
    fixed = {GROUND, *(source.node for source in circuit.voltages)}
    joined: dict[str, list[str]] = defaultdict(list)
    for unit in parts.signal:
        if not unit.entry:
            for net in unit.nets:
                joined[net] += (each for each in unit.nets if each not in fixed)
    known = set(fixed)

    def found(start: str) -> tuple[str, ...]:
        """Return the nodes of a branch, in the order in which a signal reaches them."""
        nodes = {start: None}
        for node in iter(waiting := [start]):
            new = [net for net in dict.fromkeys(joined[node]) if net not in nodes]
            nodes |= dict.fromkeys(new)
            waiting += new
        known.update(nodes)
        return tuple(nodes)

    for role, (word, title) in KINDS.items():
        matrices = [each for each in circuit.matrices if each.name in circuit.named(role)]
        for number, start in (pair for each in matrices for pair in enumerate(each.sinks, 1)):
            if start and start not in known:
                yield DrawnBranch(f"{word}-{number}", f"{title} {number}", found(start))
    for number, start in enumerate(filter(None, (unit.entrance for unit in parts.signal)), 1):
        if start not in known:
            yield DrawnBranch(f"more-{number}", f"More stages, {number}", found(start))


def _stages(branch: DrawnBranch, units: Collection[PartUnit]) -> tuple[list[Stage], list[PartUnit]]:
    """Return the stages of a branch in the order of the signal, and its transistors."""
    left = {unit.deck: unit for unit in units}
    stages = []

    def taken(node: str) -> list[PartUnit]:
        """Take the parts with two ends at a node."""
        found = [each for each in left.values() if node in each.nets and each.two_ended]
        for each in found:
            del left[each.deck]
        return found

    for node in branch.nodes:
        for amplifier in [each for each in left.values() if each.entrance == node]:
            del left[amplifier.deck]
            ends, over = {node, amplifier.nets[-1]}, amplifier.nets[0] == node
            passives = taken(node)
            feedback = [each for each in passives if over and set(each.nets) == ends]
            rungs = [each for each in passives if each not in feedback]
            stages.append(Stage(node, tuple(rungs), amplifier, tuple(feedback)))
    for node in branch.nodes:
        if rungs := taken(node):
            stages.append(Stage(node, tuple(rungs)))
    return stages, list(left.values())


@dataclass
class BranchDrawing:
    """A sheet on which branches of a board are drawn; `ports` counts the symbols of supplies."""

    parts: BoardParts
    sheet: SchematicSheet
    ports: Iterator[int] = field(default_factory=lambda: count(1))

    def branch(self, top: int, branch: DrawnBranch) -> int:
        """Draw a branch below `top`; return the top of the next one."""
        self.sheet.labels.append(Label(branch.title, (LEFT, top), size=TITLE))
        stages, others = _stages(branch, self.parts.of(branch.nodes))
        y = top + 6
        for pair in (stages[k : k + 2] for k in range(0, len(stages), 2)):
            y += LEVEL * max(len(stage.feedback) for stage in pair)
            for column, stage in enumerate(pair):
                self.stage((LEFT + COLUMN * column, y), stage)
            y += max(ROW, *(RUNG * len(stage.rungs) + 4 for stage in pair))
        for place, unit in enumerate(others):
            self.named(unit, (LEFT + 20 + 30 * place, y + 8))
        return y + 22 * bool(others)

    def stage(self, at: Point, stage: Stage) -> None:
        """Draw the parts into a node, one below the other, and its amplifier on their right."""
        x, y = at
        ends = [
            self.rung((x, y + RUNG * k), stage.node, part) for k, part in enumerate(stage.rungs)
        ]
        node = x + WIDTH + 4, y
        self.sheet.wire(*reversed(ends), node)
        self.label(stage.node, node, "right" if ends else "left")
        if stage.amplifier is not None:
            self.amplifier(node, stage, stage.amplifier)

    def rung(self, at: Point, node: str, unit: PartUnit) -> Point:
        """Draw a part from its other net to the right; return its end at the node."""
        x, y = at
        texts = {"reference": (x + 13.0, y - 1.0), "value": (x + 26.0, y - 1.0)}
        drawn = self.sheet.place(unit.part, (x + 20, y), angle=90, **texts)
        signal = unit.nets[0] if unit.nets[1] == node else unit.nets[1]
        self.label(signal, self.sheet.wire(drawn.pin(0), (x + 9, y)), "left")
        return self.sheet.wire(drawn.pin(1), (x + WIDTH, y))

    def amplifier(self, node: Point, stage: Stage, unit: PartUnit) -> None:
        """Draw an amplifier with its input at the right of a node, its feedback above it."""
        place = unit.nets.index(stage.node)
        begin = self.sheet.wire(node, (node[0] + 8, node[1]))
        x, y = Placed(unit.part, (0, 0)).pin(place)
        drawn = self.block(unit, (begin[0] + 2 - x, begin[1] - y))
        self.sheet.wire(begin, drawn.pin(place))
        for other, net in enumerate(unit.nets[:-1]):
            if other != place:
                self.label(net, drawn.pin(other), "left")
        end = drawn.pin(len(unit.nets) - 1)
        left, right = begin, self.sheet.wire(end, (end[0] + 2, end[1]))
        for number, part in enumerate(stage.feedback, 1):
            level = node[1] - LEVEL * number
            over = self.across(part.part, ((begin[0] + right[0]) // 2, level))
            left = self.sheet.wire(left, (begin[0], level))
            right = self.sheet.wire(right, (right[0], level))
            self.sheet.wire(left, over.pin(0))
            self.sheet.wire(over.pin(1), right)
        end = self.sheet.wire((end[0] + 2, end[1]), (end[0] + 6, end[1]))
        self.label(unit.nets[-1], end, "right")

    def named(self, unit: PartUnit, at: Point) -> None:
        """Draw a part alone, each of its pins named."""
        drawn = self.across(unit.part, at) if unit.two_ended else self.block(unit, at)
        for place, net in enumerate(unit.nets):
            x, y = drawn.pin(place)
            side: Literal["left", "right"] = "left" if x < at[0] else "right"
            out = 4 * unit.two_ended * (1 if side == "right" else -1)
            self.label(net, self.sheet.wire((x, y), (x + out, y)), side)

    def block(self, unit: PartUnit, at: Point) -> Placed:
        """Place a part with its name in the deck, for an amplifier in it, else on its right."""
        (x, y), inside = at, bool(unit.entrance)
        middle, above, below = (
            ((x - 1, y), (x + 3, y - 4.2), (x + 3, y + 4.2))
            if inside
            else ((x + 8, y - 2), (x + 8, y), (x + 8, y + 2))
        )
        self.sheet.labels.append(Label(unit.deck.removeprefix("X"), middle, "middle"))
        return self.sheet.place(unit.part, at, reference=above, value=below)

    def across(self, part: SymbolPart, at: Point) -> Placed:
        """Place a part with two pins from left to right, its texts above and below it."""
        (x, y), away = at, 2.8 if part.symbol is symbols.CAPACITOR else 2.2
        return self.sheet.place(part, at, angle=90, reference=(x, y - away), value=(x, y + away))

    def label(self, net: str, at: Point, side: Literal["left", "right"]) -> None:
        """Name a net at an end of its wire, the text on a `side` of it; supplies have symbols."""
        if net in self.supplies:
            self.port(self.supplies[net], at)
        else:
            self.sheet.labels.append(
                Label(net, at, "left" if side == "right" else "right", "label")
            )

    @property
    def supplies(self) -> dict[str, Symbol]:
        """The symbols of ground and of both supplies, by their nets."""
        rails = {net: symbols.rail(net) for net in self.parts.rails}
        return {GROUND: symbols.GROUND} | rails

    def port(self, symbol: Symbol, at: Point) -> None:
        """Place the symbol of ground, of a supply or of a power flag, with its name."""
        shown = symbol.name not in (symbols.GROUND.name, symbols.FLAG.name)
        up = -3.2 if symbol.name.startswith("+") else 3.2
        part = SymbolPart(symbol, f"{symbol.prefix}{next(self.ports):03d}", symbol.name)
        self.sheet.place(part, at, value=(at[0], at[1] + up) if shown else None)


ACROSS, CELL = 8, (30, 22)  # places of a row of the first sheet, and their size on the grid
COMMENTS = ("Field Deck: the name in the deck; packages U as in taction export bom",)
TABLE = """(sym_lib_table
  (version 7)
  (lib (name "taction")(type "KiCad")(uri "${{KIPRJMOD}}/{}.kicad_sym")(options "")(descr ""))
)
"""


def kicad_project(circuit: Circuit, scene: Scene) -> dict[str, str]:
    """Return the files of the KiCad project of a board, first the schematic to open.

    Not drawn are stray capacitances, the wires of the arrays and the inside of ideal amplifiers,
    which are no parts.
    """
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
    titles = {sheet: f"{scene.name}: {sheet}" for sheet in sheets} | {name: scene.name}
    files = {
        f"{title}.kicad_sch": sheet.schematic(titles[title], COMMENTS, shared)
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
    return files


def channel_sheet(circuit: Circuit, scene: Scene, k: int, n: int) -> SchematicSheet:
    """Draw sensor row k and channel n, from 0; of each matrix only the resistor of both."""
    only = np.zeros(circuit.shape, dtype=np.bool_)
    only[k, n] = True
    few = (replace(each, ohms=np.where(only, each.ohms, np.inf)) for each in circuit.matrices)
    parts = BoardParts(replace(circuit, matrices=tuple(few)), scene)
    drawing, top = BranchDrawing(parts, SchematicSheet(circuit.name)), TOP
    for branch in branches(parts):
        if branch.name in (f"channel-{n + 1}", f"row-{k + 1}"):
            top = drawing.branch(top, branch)
    return drawing.sheet


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
