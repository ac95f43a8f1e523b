"""The drawing of one channel as a picture: the sheet of `schematic`, with fewer parts.

It has one resistor of each matrix, values as a person reads them, and no supplies.
"""

from __future__ import annotations

import html
import textwrap
from collections.abc import Iterator
from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING

from taction.netlist_gen.board.channel import Channel
from taction.netlist_gen.board.circuit import Circuit
from taction.netlist_gen.kicad.schematic import channel_sheet
from taction.netlist_gen.kicad.sheet import GRID, Label, Placed, Sheet
from taction.netlist_gen.kicad.symbols import Point
from taction.spice_models.presets import opamp_name
from taction.system.picture import figure_file
from taction.system.quantities import quantity

if TYPE_CHECKING:
    from matplotlib.figure import Figure

MARGIN, WIDTH = 3.0, 0.62  # of the frame, and of a letter: in steps of the grid, and in heights
DIRECTION = {0: (1.0, 0.0), 90: (0.0, 1.0), 180: (-1.0, 0.0), 270: (0.0, -1.0)}
DOT = 0.35  # radius of a junction, in steps of the grid
SIDES = {"left": "start", "middle": "middle", "right": "end"}


@dataclass(slots=True)
class Strokes:
    """Lines, circles and texts of a picture, in steps of the grid, y downwards."""

    lines: list[list[Point]] = field(default_factory=list)
    circles: list[tuple[Point, float, bool]] = field(default_factory=list)  # filled or not
    texts: list[Label] = field(default_factory=list)

    @property
    def frame(self) -> tuple[float, float, float, float]:
        """Left, top, right and bottom of everything."""
        points = [point for line in self.lines for point in line]
        for label in self.texts:
            (x, y), wide = label.at, WIDTH * label.size / GRID * len(label.text)
            left = x - {"left": 0.0, "middle": 0.5, "right": 1.0}[label.anchor] * wide
            points += [(left, y), (left + wide, y)]
        across, down = zip(*points, strict=True)
        return min(across) - MARGIN, min(down) - MARGIN, max(across) + MARGIN, max(down) + MARGIN


def strokes(sheet: Sheet) -> Strokes:
    """Return the lines and texts of a sheet."""
    drawn = Strokes(texts=list(sheet.labels))
    drawn.lines += [list(segment) for segment in sheet.segments]
    drawn.circles += [(point, DOT, True) for point in sheet.junctions()]
    for placed in sheet.placed:
        symbol, unit = placed.part.symbol, placed.part.unit - 1
        for points in symbol.lines[unit]:
            drawn.lines.append([placed.turned(point) for point in points])
        for x, y, radius in symbol.circles:
            drawn.circles.append((placed.turned((x, y)), radius / GRID, False))
        for pin in symbol.units[unit]:
            (x, y), (right, up) = pin.at, DIRECTION[pin.direction]
            end = x + right * pin.length, y + up * pin.length
            drawn.lines.append([placed.turned(pin.at), placed.turned(end)])
        drawn.texts += _texts(placed)
    return drawn


def _texts(placed: Placed) -> Iterator[Label]:
    """Yield the name in the deck and the value of a part; a package of op-amps has neither."""
    part = placed.part
    if part.symbol.prefix == "U":
        return
    exact = part.fields.get("Exact", "").split()
    value = quantity(float(exact[0]), exact[1]) if exact else part.value
    for text, at in ((part.fields.get("Deck", part.reference), placed.reference),
                     (value, placed.value)):  # fmt: skip
        if at is not None:
            yield Label(text, at, "middle")


def _drawing(circuit: Circuit) -> Strokes:
    drawn = strokes(channel_sheet(Channel.of(circuit), brief=True))
    left, _, _, bottom = drawn.frame
    text = ", ".join(f"{fact.symbol} = {fact.text}" for fact in circuit.facts.values())
    drawn.texts.append(Label(text, (left + MARGIN, bottom), "left"))
    return drawn


def schematic_svg(circuit: Circuit) -> str:
    """Return the drawing of the middle channel and the sensor row that it drives most, as SVG.

    Its colour is that of the page's text.

    Examples
    --------
    >>> import taction
    >>> board = taction.synthesise(taction.load_scene("scenes/paper-breadboard.toml"))
    >>> "1.9 MΩ" in schematic_svg(board)
    True
    """
    drawn = _drawing(circuit)
    left, top, right, bottom = drawn.frame
    width, height = right - left, bottom - top
    parts = [
        f'<svg xmlns="http://www.w3.org/2000/svg" viewBox="{left:g} {top:g} {width:g} {height:g}"'
        f' width="{10 * width:g}" height="{10 * height:g}" fill="none" stroke="currentColor"'
        ' stroke-width="0.18" stroke-linejoin="round" font-family="sans-serif">'
    ]
    for line in drawn.lines:
        points = " ".join(f"{x:g},{y:g}" for x, y in line)
        parts.append(f'<polyline points="{points}"/>')
    for (x, y), radius, filled in drawn.circles:
        fill = ' fill="currentColor"' if filled else ""
        parts.append(f'<circle cx="{x:g}" cy="{y:g}" r="{radius:g}"{fill}/>')
    for label in drawn.texts:
        (x, y), size = label.at, label.size / GRID
        down = y - 0.25 if label.above else y + 0.35 * size
        parts.append(
            f'<text x="{x:g}" y="{down:g}" font-size="{1.1 * size:g}" fill="currentColor"'
            f' stroke="none" text-anchor="{SIDES[label.anchor]}">{html.escape(label.text)}</text>'
        )
    return "\n".join([*parts, "</svg>"])


def plot_schematic(circuit: Circuit, path: str | Path | None = None) -> Figure:
    """Draw the schematic of one channel as a figure; write it to `path`, if there is one.

    Raises
    ------
    InputError
        See `taction.system.picture.figure_file`.
    """
    title = f"{circuit.name}: one of {len(circuit.outputs)} channels"
    drawn = _drawing(circuit)
    left, top, right, bottom = drawn.frame
    with figure_file(path, 11.0, 1.6 + 11.0 * (bottom - top) / (right - left), title) as figure:
        from matplotlib.patches import Circle

        axes = figure.add_subplot(aspect="equal")
        axes.set_axis_off()
        axes.set_xlim(left, right)
        axes.set_ylim(bottom, top)
        for line in drawn.lines:
            axes.plot(*zip(*line, strict=True), color="black", lw=0.9)
        for centre, radius, filled in drawn.circles:
            axes.add_patch(Circle(centre, radius, fill=filled, color="black", lw=0.9))
        points = 72.0 * 11.0 / (right - left)  # of a step of the grid
        for label in drawn.texts:
            axes.text(
                *label.at,
                label.text,
                ha="center" if label.anchor == "middle" else label.anchor,
                va="bottom" if label.above else "center",
                fontsize=points * label.size / GRID,
            )
        figure.supxlabel(
            "\n".join(textwrap.wrap(schematic_summary(circuit), 120)), fontsize="small"
        )
    return figure


def schematic_summary(circuit: Circuit) -> str:
    """Return in words what the schematic shows."""
    channel = Channel.of(circuit)
    into, row = (len(channel.rungs(m)) for m in (circuit.feedback, circuit.forward))
    return (
        f"Channel {channel.n} with sensor row {channel.k}, one of {into} resistors into the channel"
        f" and of {row} resistors into the row. C = {quantity(channel.farads, 'F')}, gain s ="
        f" {circuit.facts['gain'].text}, matrix resistor {quantity(channel.entry, 'ohm')}"
        f" (T is {'negative' if channel.negative else 'positive'}), op-amps"
        f" {opamp_name(next(iter(circuit.models)))}. Stray capacitances are not drawn."
    )
