"""The stages of a branch, drawn on a sheet: wires within a stage, labels between stages.

A stage has the parts into its summing node, one below the other, and its amplifier. Places are in
steps of the grid; what is drawn starts at a point on its left and returns where its output is on
its right.
"""

from __future__ import annotations

from collections.abc import Collection, Iterator, Sequence
from itertools import count
from typing import Literal

from taction.netlist_gen.board.circuit import GROUND, Circuit
from taction.netlist_gen.board.parts import OpAmpCell, SignalAmplifier, TransistorCell
from taction.netlist_gen.kicad import symbols
from taction.netlist_gen.kicad.parts import Catalogue, spare_node
from taction.netlist_gen.kicad.sheet import TITLE, Label, Placed, SchematicSheet, SymbolPart
from taction.netlist_gen.kicad.stages import (
    DrawnBranch,
    Passive,
    Rung,
    Stage,
    branch,
    branches,
    shared_nodes,
)
from taction.netlist_gen.kicad.symbols import Point, Symbol

LEFT, TOP = 12, 14  # of the drawing
RUNG, WIDTH = 4, 31  # distance of the parts into a node, and their width with wires and label
WIDE = 120  # of a row: more stages begin the next one
LEVEL = 8  # height of one feedback part over an op-amp


def channel_sheet(circuit: Circuit, n: int, k: int) -> SchematicSheet:
    """Draw channel `n` with row `k`, counted from 1, for a picture.

    It has one resistor of each matrix, that between channel and row, and no supplies.
    """
    drawing = BranchDrawing(Catalogue(circuit), SchematicSheet(circuit.name))
    hidden = {each.card for matrix in circuit.matrices for each in matrix.resistors()}
    hidden -= {f"{matrix.name}_{k}_{n}" for matrix in circuit.matrices}
    y = TOP
    for name, start, title in branches(circuit):
        if name in (f"channel-{n}", f"row-{k}"):
            y = drawing.branch(y, title, start, hidden)
    return drawing.sheet


class BranchDrawing:
    """A sheet on which branches of a board are drawn; `ports` counts the symbols of supplies."""

    def __init__(
        self, catalogue: Catalogue, sheet: SchematicSheet, ports: Iterator[int] | None = None
    ) -> None:
        self.catalogue, self.sheet = catalogue, sheet
        self.circuit, self.shared = catalogue.circuit, shared_nodes(catalogue.circuit)
        self.ports = count(1) if ports is None else ports

    def branch(self, top: int, title: str, start: str, hidden: Collection[str] = ()) -> int:
        """Draw a branch below `top`; return the top of the next one."""
        self.sheet.labels.append(Label(title, (LEFT, top), size=TITLE))
        found, x, y, bottom = branch(self.circuit, start), LEFT, top, top
        above = max((LEVEL * len(stage.feedback) for stage in found.stages), default=0)
        for stage in found.stages:
            rungs = [rung for rung in stage.rungs if rung[1].card not in hidden]
            if x == LEFT or len(stage.rungs) > 1 or x > WIDE:
                x, y = LEFT, bottom + max(above, LEVEL + 2) + 6
            bottom = max(bottom, y + max(RUNG * (len(rungs) + 1), 22))
            x = self.stage((x, y), stage, rungs) + 2
        return self.others(bottom, found)

    def stage(self, at: Point, stage: Stage, rungs: Sequence[Rung]) -> int:
        """Draw a stage with some of its rungs; return the right end."""
        end = self.amplifier(self.ladder(at, stage.node, rungs), stage)
        end = self.sheet.wire(end, (end[0] + 4, end[1]))
        self.label(stage.output, end, "right")
        return round(end[0]) + len(stage.output)

    def ladder(self, at: Point, node: str, rungs: Sequence[Rung]) -> Point:
        """Draw parts from signals to one node; return the node at the upper right."""
        if not rungs:
            self.label(node, at, "left")
            return at
        x, y = at
        for place, (signal, part) in enumerate(rungs):
            self.rung((x, y + RUNG * place), signal, self.catalogue.part(part))
        bus = x + WIDTH, y
        self.sheet.wire(bus, (bus[0], y + RUNG * (len(rungs) - 1)))
        return self.sheet.wire(bus, (bus[0] + 4, y))

    def rung(self, at: Point, signal: str, part: SymbolPart) -> Point:
        """Draw a part from a signal to the right, its texts above its wires; return its end."""
        x, y = at
        texts = {"reference": (x + 13.0, y - 1.0), "value": (x + 26.0, y - 1.0)}
        drawn = self.sheet.place(part, (x + 20, y), angle=90, **texts)
        self.label(signal, self.sheet.wire(drawn.pin(0), (x + 9, y)), "left")
        return self.sheet.wire(drawn.pin(1), (x + WIDTH, y))

    def amplifier(self, at: Point, stage: Stage) -> Point:
        """Draw the parts from the input of a stage to ground, and its amplifier."""
        cell = stage.cell
        for part in stage.shunts:
            place = at[0] + 6
            drawn = self.down(self.catalogue.part(part), (place, at[1] + 6))
            self.sheet.wire((place, at[1]), drawn.pin(0))
            self.port(symbols.GROUND, drawn.pin(1))
            at = self.sheet.wire(at, (at[0] + 14, at[1]))
        if cell is not None and stage.rungs and stage.node not in self.shared:
            self.name(stage.node, (at[0] + 1, at[1]))
        if cell is None:
            return at
        if isinstance(cell, SignalAmplifier):
            return self.function(at, cell)
        if cell.inverting == stage.node:
            return self.summing(at, cell, stage.feedback)
        return self.open(at, cell)

    def function(self, at: Point, cell: SignalAmplifier) -> Point:
        """Draw an ideal amplifier."""
        x, y = at[0] + 20, at[1]
        part = self.catalogue.function(cell)
        drawn = self.sheet.place(part, (x, y), reference=(x, y - 5.2), value=(x, y + 5.2))
        self.sheet.labels.append(Label("ideal: no part", (x, y), "middle"))
        self.sheet.wire(at, drawn.pin(0))
        return drawn.pin(1)

    def summing(self, at: Point, cell: OpAmpCell, feedback: Sequence[Passive]) -> Point:
        """Draw an op-amp from its summing node, its feedback parts above it."""
        y, left, right = at[1], at[0] + 8, at[0] + 24
        self.sheet.wire(at, (left, y), (left + 2, y))
        drawn = self.cell(cell, (left + 8, y + 2))
        output = self.sheet.wire(drawn.pin(2), (right, drawn.pin(2)[1]))
        self.label(cell.noninverting, self.sheet.wire(drawn.pin(1), (left + 2, y + 6)), "left")
        for number, each in enumerate(feedback, 1):
            level = y - LEVEL * number
            over = self.across(self.catalogue.part(each), ((left + right) // 2, level))
            self.sheet.wire((left, level), over.pin(0))
            self.sheet.wire(over.pin(1), (right, level))
        if feedback:
            self.sheet.wire((left, y), (left, y - LEVEL * len(feedback)))
            self.sheet.wire(output, (right, y - LEVEL * len(feedback)))
        return output

    def open(self, at: Point, cell: OpAmpCell) -> Point:
        """Draw an op-amp from its non-inverting input: a buffer, or without feedback of its own."""
        drawn = self.cell(cell, (at[0] + 12, at[1] - 2))
        self.sheet.wire(at, drawn.pin(1))
        (left, y), (x, out) = drawn.pin(0), drawn.pin(2)
        if cell.inverting == cell.output:
            self.sheet.wire((left, y), (left, y - 6), (x + 2, y - 6), (x + 2, out))
        else:
            self.label(cell.inverting, self.sheet.wire((left, y), (left - 2, y)), "left")
        return self.sheet.wire((x, out), (x + 2, out))

    def cell(self, cell: OpAmpCell, at: Point) -> Placed:
        """Place an op-amp with the name of the deck in it."""
        x, y = at
        part = self.catalogue.opamp(*self.catalogue.units[cell.name])
        self.sheet.labels.append(Label(cell.name, (x - 1, y), "middle"))
        return self.sheet.place(part, at, reference=(x + 3, y - 4.2), value=(x + 3, y + 4.2))

    def others(self, top: int, found: DrawnBranch) -> int:
        """Draw parts between labels, and the transistors, below `top`; return the next top."""
        y = top + 10 * bool(found.loose or found.transistors)
        for place, part in enumerate(found.loose):
            at = LEFT, y + RUNG * place
            self.label(part.b, self.rung(at, part.a, self.catalogue.part(part)), "right")
        for place, cell in enumerate(found.transistors):
            self.transistor((LEFT + 64 + 26 * place, y + 4), cell)
        size = max(RUNG * len(found.loose), 14 * bool(found.transistors))
        return y + size + 6 * bool(size)

    def transistor(self, at: Point, cell: TransistorCell) -> None:
        """Draw a transistor, its pins named."""
        x, y = at
        part = self.catalogue.transistor(self.circuit.transistors.index(cell))
        self.sheet.labels.append(Label(cell.card, (x + 8, y - 2), "middle"))
        drawn = self.sheet.place(part, at, reference=(x + 8, y), value=(x + 8, y + 2))
        for place, node in enumerate((cell.base, cell.collector, cell.emitter)):
            end = drawn.pin(place)
            self.label(node, end, "right" if place else "left")

    def supplies(self, at: Point, packages: Sequence[str], across: int) -> int:
        """Draw the supplies of packages, their sources for KiCad, and voltages; return the end."""
        x, y = at
        self.sheet.labels.append(Label("Supplies", (x - 6, y), size=TITLE))
        for place, symbol in enumerate((*self.catalogue.rails, symbols.GROUND)):
            start = (x + 12 * place, y + 10)
            self.port(symbol, start)
            self.port(symbols.FLAG, self.sheet.wire(start, (start[0] + 4, start[1])))
        y += 30
        for place, package in enumerate(packages):
            self.supply((x + 30 * (place % across), y + 34 * (place // across)), package)
        y += 34 * -(-len(packages) // across)
        sources = self.circuit.voltages
        for place, source in enumerate(sources):
            column, row = place % (2 * across), place // (2 * across)
            drawn = self.down(self.catalogue.part(source), (x + 24 * column, y + 20 * row))
            (left, top) = drawn.pin(0)
            end = self.sheet.wire((left, top), (left, top - 3), (left + 2, top - 3))
            self.label(source.node, end, "right")
            self.port(symbols.GROUND, drawn.pin(1))
        return round(y + 20 * -(-len(sources) // (2 * across)))

    def unused(self, at: Point, package: str, unit: int) -> None:
        """Draw an op-amp without use: a follower at ground, so that it rests."""
        part = self.catalogue.opamp(package, unit)
        drawn = self.sheet.place(part, at, reference=(at[0] + 3, at[1] - 4.2))
        self.sheet.labels.append(Label("not used", (at[0] - 1, at[1]), "middle"))
        (x, y), ground = drawn.pin(2), drawn.pin(1)
        end = self.sheet.wire(drawn.pin(0), (at[0] - 8, at[1] - 2), (at[0] - 8, at[1] - 8),
                              (x + 2, at[1] - 8), (x + 2, y))  # fmt: skip
        self.sheet.wire((x, y), end)
        self.name(spare_node(package, unit), end)
        self.port(symbols.GROUND, self.sheet.wire(ground, (ground[0], ground[1] + 4)))

    def supply(self, at: Point, package: str) -> None:
        """Draw the supply pins of a package with two decoupling capacitors."""
        x, y = at
        texts = {"reference": (x - 5, y - 1), "value": (x - 5, y + 1)}
        drawn = self.sheet.place(self.catalogue.opamp(package), at, **texts)
        upper = self.down(self.catalogue.decoupling(package, 1), (x + 10, y - 6))
        lower = self.down(self.catalogue.decoupling(package, 2), (x + 10, y + 6))
        ends = (drawn.pin(0), upper.pin(0), y - 10), (drawn.pin(1), lower.pin(1), y + 10)
        for symbol, (end, part, level) in zip(self.catalogue.rails, ends, strict=True):
            self.sheet.wire(end, (x, level), (x + 10, level), part)
            self.port(symbol, (x, level))
        self.sheet.wire(upper.pin(1), (x + 10, y), lower.pin(0))
        self.port(symbols.GROUND, self.sheet.wire((x + 10, y), (x + 16, y)))

    def port(self, symbol: Symbol, at: Point) -> None:
        """Place the symbol of ground, of a supply or of a power flag, with its name."""
        shown = symbol.name not in (symbols.GROUND.name, symbols.FLAG.name)
        up = -3.2 if symbol.name.startswith("+") else 3.2
        part = SymbolPart(symbol, f"{symbol.prefix}{next(self.ports):03d}", symbol.name)
        self.sheet.place(part, at, value=(at[0], at[1] + up) if shown else None)

    def across(self, part: SymbolPart, at: Point) -> Placed:
        """Place a part with two pins from left to right, its texts above and below it."""
        (x, y), away = at, 2.8 if part.symbol is symbols.CAPACITOR else 2.2
        return self.sheet.place(part, at, angle=90, reference=(x, y - away), value=(x, y + away))

    def down(self, part: SymbolPart, at: Point) -> Placed:
        """Place a part with two pins from above to below, its texts on the right."""
        (x, y), letters = at, max(len(part.reference), len(part.value))
        right = x + 0.45 * letters + (3.0 if part.symbol.radius else 2.4)
        return self.sheet.place(part, at, reference=(right, y - 1.0), value=(right, y + 1.0))

    def name(self, net: str, at: Point) -> None:
        """Name a net of this sheet above its wire."""
        self.sheet.labels.append(Label(net, at, "left", "label"))

    def label(self, net: str, at: Point, side: Literal["left", "right"]) -> None:
        """Name a net at an end of its wire, the text on a `side` of it; ground has a symbol."""
        anchor: Literal["left", "right"] = "left" if side == "right" else "right"
        if net == GROUND:
            self.port(symbols.GROUND, at)
        elif net in self.shared:
            kind: Literal["input", "output"] = "output" if side == "right" else "input"
            self.sheet.labels.append(Label(net, at, anchor, kind))
        else:
            self.sheet.labels.append(Label(net, at, anchor, "label"))
