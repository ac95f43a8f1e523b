"""The drawing of one channel: the KiCad sheets of a channel and a sensor row, in brief."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass, replace

import numpy as np

from taction.netlist_gen.board.circuit import Circuit
from taction.netlist_gen.kicad.board import TOP, BranchDrawing, branches
from taction.netlist_gen.kicad.part_symbols import BoardParts, PartUnit
from taction.netlist_gen.kicad.sheet import GRID, Label, SchematicSheet
from taction.netlist_gen.scene.scene import Scene
from taction.system.quantities import counted, quantity
from taction.verification.report.blocks import Drawing, Path

DIRECTION = {0: (1.0, 0.0), 90: (0.0, 1.0), 180: (-1.0, 0.0), 270: (0.0, -1.0)}
DOT, ABOVE = 0.35, 0.8  # radius of a junction; the name of a net above its wire: grid steps


@dataclass(frozen=True)
class BriefParts(BoardParts):
    """The parts of a board with one resistor of each matrix into a node, `entry` if it ends so."""

    entry: str = ""

    def of(self, nets: Iterable[str]) -> list[PartUnit]:
        """Return the units at some nets."""
        kept = dict[object, PartUnit]()
        for unit in sorted(super().of(nets), key=lambda unit: not unit.deck.endswith(self.entry)):
            matrix = unit.deck.partition("_")[0], unit.nets[-1]
            kept.setdefault(matrix if unit.entry else unit.deck, unit)
        return list(kept.values())


def schematic(circuit: Circuit, scene: Scene) -> Drawing:
    """Return the middle channel of a board, with the sensor row that it drives most."""
    ohms = circuit.forward_ohms
    n = (ohms.shape[1] + 1) // 2
    k = int(np.argmin(ohms[:, n - 1])) + 1
    other = np.ones(ohms.shape, dtype=np.bool_)  # resistors that are not looked at: most of many
    other[k - 1], other[:, n - 1] = False, False
    few = (replace(m, ohms=np.where(other, np.inf, m.ohms)) for m in circuit.matrices)
    circuit = replace(circuit, matrices=tuple(few))
    parts, sheet = BriefParts(circuit, scene, f"_{k}_{n}"), SchematicSheet(circuit.name)
    found, top = {branch.name: branch for branch in branches(parts)}, TOP
    drawn = BranchDrawing(parts, sheet)
    for name in (f"channel-{n}", f"row-{k}"):
        if name in found:
            top = drawn.branch(top, found[name])
    into, out = (np.isfinite(each).sum() for each in (ohms[:, n - 1], ohms[k - 1]))
    summary = (
        f"Channel {n} and sensor row {k}: column {n} of T has {counted(into, 'resistor')}, row {k}"
        f" has {out}; one of each matrix is drawn. Stray capacitances and supplies are not drawn."
    )
    lines: list[Path] = [*sheet.segments]
    circles = [(x, y, DOT, True) for x, y in sheet.junctions()]
    texts = [replace(e, at=(e.at[0], e.at[1] - ABOVE * (e.kind == "label"))) for e in sheet.labels]
    for placed in sheet.placed:
        part, symbol, unit = placed.part, placed.part.symbol, placed.part.unit - 1
        lines += (tuple(map(placed.turned, path)) for path in symbol.lines[unit])
        if symbol.radius:
            circles.append((*placed.at, symbol.radius / GRID, False))
        for pin in symbol.units[unit]:
            (x, y), (right, up) = pin.at, DIRECTION[pin.direction]
            end = x + right * pin.length, y + up * pin.length
            lines.append((placed.turned(pin.at), placed.turned(end)))
        if symbol.prefix != "U":  # a package says nothing about the channel
            exact = part.fields.get("Exact", "").split()
            value = quantity(float(exact[0]), exact[1]) if exact else part.value
            named = (part.fields.get("Deck", part.reference), placed.reference)
            texts += [Label(t, at, "middle") for t, at in (named, (value, placed.value)) if at]
    marks = tuple((t.text, *t.at, t.anchor, t.size / GRID) for t in texts)
    return Drawing("One channel", tuple(lines), tuple(circles), marks, summary)
