"""The drawing of one channel for a picture: the sheet of `drawing`, with fewer parts.

It has one resistor of each matrix, values as a person reads them, and no supplies.
"""

from __future__ import annotations

from dataclasses import dataclass

from taction.netlist_gen.board.circuit import Circuit
from taction.netlist_gen.kicad.drawing import channel_sheet, driven_row
from taction.netlist_gen.kicad.sheet import GRID, Label, SchematicSheet
from taction.netlist_gen.kicad.symbols import Point
from taction.spice_models.presets import opamp_name
from taction.system.quantities import quantity

MARGIN, WIDTH = 3.0, 0.62  # of the frame, and of a letter: in steps of the grid, and in heights
DIRECTION = {0: (1.0, 0.0), 90: (0.0, 1.0), 180: (-1.0, 0.0), 270: (0.0, -1.0)}
DOT = 0.35  # radius of a junction, in steps of the grid
SHARE = {"left": 0.0, "middle": 0.5, "right": 1.0}  # of a text, before its place


@dataclass(slots=True)
class Strokes:
    """Lines, circles (filled or not) and texts of a sheet, in steps of the grid, y downwards."""

    lines: list[list[Point]]
    circles: list[tuple[Point, float, bool]]
    texts: list[Label]

    @classmethod
    def of(cls, sheet: SchematicSheet) -> Strokes:
        """Return the strokes of a sheet."""
        drawn = cls([], [(point, DOT, True) for point in sheet.junctions()], [*sheet.labels])
        drawn.lines += [list(segment) for segment in sheet.segments]
        for placed in sheet.placed:
            part, symbol, unit = placed.part, placed.part.symbol, placed.part.unit - 1
            drawn.lines += [[*map(placed.turned, points)] for points in symbol.lines[unit]]
            if symbol.radius:
                drawn.circles.append((placed.at, symbol.radius / GRID, False))
            for pin in symbol.units[unit]:
                (x, y), (right, up) = pin.at, DIRECTION[pin.direction]
                end = x + right * pin.length, y + up * pin.length
                drawn.lines.append([placed.turned(pin.at), placed.turned(end)])
            exact = part.fields.get("Exact", "").split()
            value = quantity(float(exact[0]), exact[1]) if exact else part.value
            texts = (
                (part.fields.get("Deck", part.reference), placed.reference),
                (value, placed.value),
            )
            if symbol.prefix != "U":  # a package says nothing about the channel
                drawn.texts += [Label(text, at, "middle") for text, at in texts if at is not None]
        return drawn

    @property
    def frame(self) -> tuple[float, float, float, float]:
        """Left, top, right and bottom of everything."""
        points = [point for line in self.lines for point in line]
        for label in self.texts:
            (x, y), wide = label.at, WIDTH * label.size / GRID * len(label.text)
            left = x - SHARE[label.anchor] * wide
            points += [(left, y), (left + wide, y)]
        across, down = zip(*points, strict=True)
        return min(across) - MARGIN, min(down) - MARGIN, max(across) + MARGIN, max(down) + MARGIN


def schematic_strokes(circuit: Circuit) -> Strokes:
    """Return the drawing of the middle channel and the sensor row that it drives most."""
    n = _middle_channel(circuit)
    drawn = Strokes.of(channel_sheet(circuit, n, driven_row(circuit, n)))
    left, _, _, bottom = drawn.frame
    text = ", ".join(f"{fact.symbol} = {fact.text}" for fact in circuit.facts.values())
    drawn.texts.append(Label(text, (left + MARGIN, bottom), "left"))
    return drawn


def _middle_channel(circuit: Circuit) -> int:
    """Return the middle channel, or the first one that has a matrix resistor."""
    channels = range(1, 1 + circuit.shape[1])
    middle = channels[(len(channels) - 1) // 2]
    return int(next(n for n in (middle, *channels) if driven_row(circuit, n)))


def schematic_summary(circuit: Circuit) -> str:
    """Return in words what the schematic shows."""
    n = _middle_channel(circuit)
    k = driven_row(circuit, n)
    ohms = circuit.forward_ohms
    present = ohms < float("inf")
    entry = quantity(float(ohms[k - 1, n - 1]), "ohm")
    facts = (circuit.facts[knob.name] for knob in circuit.knobs if knob.margin)
    values = "".join(f"{fact.words} = {fact.text}, " for fact in facts)
    return (
        f"Channel {n} with sensor row {k}, one of {present[:, n - 1].sum()} resistors into the"
        f" channel and of {present[k - 1].sum()} resistors into the row. {values}"
        f"matrix resistor {entry}"
        f" (T is {'negative' if circuit.realised[k - 1, n - 1] < 0.0 else 'positive'}), op-amps"
        f" {opamp_name(next(iter(circuit.models)))}. Stray capacitances are not drawn."
    )
