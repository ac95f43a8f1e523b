"""A sheet of a schematic: parts, wires and labels at places of a grid, y downwards; KiCad's file.

The grid is KiCad's, 1.27 mm; all ends of pins and wires are on it, and wires meet at their ends.
"""

from __future__ import annotations

import html
import uuid
from collections import Counter
from collections.abc import Collection, Iterable, Iterator
from dataclasses import dataclass, field
from itertools import pairwise
from typing import Any, Literal

from taction.netlist_gen.kicad.symbols import LIBRARY, Point, Symbol, SymbolPart
from taction.system.foreign_files import visible

NAMES = uuid.UUID("6ba7b812-9dad-11d1-80b4-00c04fd430c8")  # the namespace of OIDs
PAPERS = {"A4": (297, 210), "A3": (420, 297), "A2": (594, 420), "A1": (841, 594), "A0": (1189, 841)}
GRID = 1.27  # mm
FRAME, TITLE_BLOCK = 15.0, 45.0  # mm beside the drawing, and below it
TEXT, TITLE = 1.27, 2.0  # height of a text and of a title, mm
TURN = {0: (1, 0), 90: (0, 1), 180: (-1, 0), 270: (0, -1)}  # cosine and sine, counterclockwise
BOX = (24, 6)  # width and height of a sheet as a box, steps of the grid
DOT, BESIDE, PIXELS = 0.35, 4.0, 7.5  # of SVG: radius of a junction, margin; pixels of a step
ANCHORS = {"left": "start", "middle": "middle", "right": "end"}
LOWER = {"text": 0.4, "label": -0.4}  # the line on which a text stands, below its place
HEAD = '(version 20231120) (generator "taction")'  # the format of KiCad 8 and newer


def quoted(text: object) -> str:
    """Return a text in quotation marks, as KiCad writes it."""
    plain = str(text).replace("\\", "\\\\").replace('"', '\\"').replace("\n", "\\n")
    return f'"{plain}"'


def numbers(*values: float) -> str:
    """Return lengths, mm: multiples of 0.01 mm, so six decimals are exact, and there is no -0."""
    return " ".join(f"{round(v, 6) + 0.0:.6f}".rstrip("0").rstrip(".") for v in values)


def _mm(point: Point) -> str:
    return numbers(GRID * point[0], GRID * point[1])


@dataclass(frozen=True, slots=True)
class Placed:
    """A part on a sheet; `reference` and `value` are the middles of these texts, hidden if None."""

    part: SymbolPart
    at: Point
    angle: int = 0
    reference: Point | None = None
    value: Point | None = None

    def pin(self, place: int) -> Point:
        """Return where pin `place` of the unit ends, counted from 0."""
        x, y = self.turned(self.part.pins[place].at)
        return round(x), round(y)

    def turned(self, point: Point) -> Point:
        """Return the place on the sheet of a point of the symbol, mm, y upwards."""
        cosine, sine = TURN[self.angle]
        x, y = point[0] * cosine - point[1] * sine, point[0] * sine + point[1] * cosine
        return self.at[0] + x / GRID, self.at[1] - y / GRID


@dataclass(frozen=True, slots=True)
class Label:
    """A text on a sheet; `at` is its left end, its middle, or its right end.

    A ``"label"`` names the net at its place, a ``"text"`` nothing; `size` is the height, mm.
    """

    text: str
    at: Point
    anchor: Literal["left", "middle", "right"] = "left"
    kind: Literal["text", "label"] = "text"
    size: float = TEXT

    def written(self, shared: Collection[str]) -> str:
        """Return the label as it stands in a schematic; `shared` nets are those of two sheets."""
        side = "" if self.anchor == "middle" else self.anchor
        turned = 180 if self.anchor == "right" else 0
        where, text = f"(at {_mm(self.at)} {turned})", quoted(self.text)
        if self.kind == "text":
            return f"(text {text} (exclude_from_sim no) {where} {_effects(side, self.size)})"
        if self.text in shared:
            return f"(global_label {text} (shape bidirectional) {where} {_effects(side)})"
        return f"(label {text} {where} {_effects(f'{side} bottom')})"


@dataclass(eq=False)
class SchematicSheet:
    """One page; the first sheet of a project has no `name`, and the others as boxes `below` it."""

    project: str
    name: str = ""
    below: dict[str, Point] = field(default_factory=dict)  # places of the boxes
    placed: list[Placed] = field(default_factory=list)
    segments: list[tuple[Point, Point]] = field(default_factory=list)
    labels: list[Label] = field(default_factory=list)

    def place(self, part: SymbolPart, at: Point, **look: Any) -> Placed:
        """Place a part; `look` has the other fields of `Placed`."""
        self.placed.append(Placed(part, at, **look))
        return self.placed[-1]

    def wire(self, *points: Point) -> Point:
        """Draw a wire along `points`, each beside or above the one before; return its end."""
        self.segments += [ends for ends in pairwise(points) if ends[0] != ends[1]]
        return points[-1]

    @property
    def nets(self) -> set[str]:
        """The nets that have a name on this sheet."""
        return {label.text for label in self.labels if label.kind == "label"}

    def junctions(self) -> list[Point]:
        """Return the points where three or more ends of wires and pins meet."""
        ends = Counter(end for segment in self.segments for end in segment)
        for placed in self.placed:
            ends.update(placed.pin(place) for place in range(len(placed.part.pins)))
        return sorted(point for point, count in ends.items() if count >= 3)

    def svg(self) -> str:
        """Return the page as SVG in the colour of the text around it."""
        lines: list[tuple[Point, ...]] = [*self.segments]
        circles = [(*at, DOT, "currentColor") for at in self.junctions()]
        texts = [*self.labels]
        for each in self.placed:
            part, symbol = each.part, each.part.symbol
            lines += (tuple(map(each.turned, path)) for path in symbol.lines[part.unit - 1])
            for pin in part.pins:
                (x, y), (right, up) = pin.at, TURN[pin.direction]
                end = x + right * pin.length, y + up * pin.length
                lines.append((each.turned(pin.at), each.turned(end)))
            circles += [(*each.at, symbol.radius / GRID, "none")] * bool(symbol.radius)
            deck = part.fields.get("Deck", part.reference)
            named = (deck, each.reference), (part.value, each.value)
            texts += [Label(text, at, "middle") for text, at in named if at]
        points = (point for path in (*lines, [each.at for each in texts]) for point in path)
        across, down = zip(*points, strict=True)
        left, top = min(across) - BESIDE, min(down) - BESIDE
        width, height = max(across) + BESIDE - left, max(down) + BESIDE - top
        shapes = [f'<path d="M{" L".join(f"{x:g} {y:g}" for x, y in path)}"/>' for path in lines]
        shapes += [f'<circle cx="{x}" cy="{y}" r="{r:g}" fill="{f}"/>' for x, y, r, f in circles]
        shapes += [
            f'<text x="{e.at[0]:g}" y="{e.at[1] + LOWER[e.kind]:g}" font-size="{e.size:g}"'
            f' text-anchor="{ANCHORS[e.anchor]}" fill="currentColor" stroke="none">'
            f"{html.escape(visible(e.text))}</text>"
            for e in texts
        ]
        return (
            f'<svg viewBox="{left:g} {top:g} {width:g} {height:g}" width="{PIXELS * width:.0f}"'
            f' fill="none" stroke="currentColor" stroke-width="0.15">{"".join(shapes)}</svg>'
        )

    def schematic(self, title: str, comments: tuple[str, ...], shared: Collection[str]) -> str:
        """Return the file ``.kicad_sch``; `shared` are the nets that several sheets have."""
        used = {placed.part.symbol.name: placed.part.symbol for placed in self.placed}
        symbols = (_in_library(each, f"{LIBRARY}:{each.name}") for each in used.values())
        block = (f"(comment {k} {quoted(text)})" for k, text in enumerate(comments, 1))
        items = [*map(self._symbol, self.placed), *(each.written(shared) for each in self.labels)]
        items += [
            f"(wire (pts (xy {_mm(a)}) (xy {_mm(b)})) {_stroke(0)})" for a, b in self.segments
        ]
        items += [
            f"(junction (at {_mm(at)}) (diameter 0) (color 0 0 0 0))" for at in self.junctions()
        ]
        named = (f"{item[:-1]} {self._id(str(place))})" for place, item in enumerate(items))
        lines = (
            f"(kicad_sch {HEAD} {self._id('sheet')} (paper {self._paper()})",
            f"(title_block (title {quoted(title)}) {' '.join(block)})",
            f"(lib_symbols {' '.join(symbols)})",
            *named,
            *(self._box(page, *box) for page, box in enumerate(self.below.items(), 2)),
            ")" if self.name else '(sheet_instances (path "/" (page "1"))))',
        )
        return "\n".join(lines) + "\n"

    def _id(self, what: str) -> str:
        """Return an identifier that is the same each time the same sheet is drawn."""
        place = f"{self.project}/{self.name}" if self.name else self.project
        return f'(uuid "{uuid.uuid5(NAMES, f"taction/{place}/{what}")}")'

    def _path(self, rest: str) -> str:
        """Return the identifiers of the sheets from the first one to this one, before `rest`."""
        first = SchematicSheet(self.project)
        ids = [first._id(what).split('"')[1] for what in ("sheet", self.name) if what]
        return f'(instances (project {quoted(self.project)} (path "/{"/".join(ids)}" {rest})))'

    def _box(self, page: int, name: str, at: Point) -> str:
        """Return the box of a sheet below this one."""
        (x, y), (_, height) = at, BOX
        above = _field("Sheetname", name, (x, y - 0.5), justify="left bottom")
        below = _field("Sheetfile", f"{name}.kicad_sch", (x, y + height + 0.5), justify="left top")
        return (
            f"(sheet (at {_mm(at)}) (size {_mm(BOX)}) {_stroke(0.15)} (fill (color 0 0 0 0))"
            f" {self._id(name)} {above} {below} {self._path(f'(page {quoted(page)})')})"
        )

    def _symbol(self, placed: Placed) -> str:
        part, angle = placed.part, placed.angle
        texts = {"Reference": part.reference, "Value": part.value, "Footprint": "", "Datasheet": ""}
        places = {"Reference": placed.reference, "Value": placed.value}
        shown = (
            _field(name, text, at or placed.at, angle, hide=at is None)
            for name, text in (texts | dict(part.fields)).items()
            for at in (places.get(name),)
        )
        pins = (
            f"(pin {quoted(n)} {self._id(f'{part.reference}/{part.unit}/{n}')})"
            for n in (pin.number for pin in part.pins)
        )
        texts_and_pins = " ".join((*shown, *pins))
        used = f"(reference {quoted(part.reference)}) (unit {part.unit})"
        return (
            f"(symbol (lib_id {quoted(f'{LIBRARY}:{part.symbol.name}')})"
            f" (at {_mm(placed.at)} {angle}) (unit {part.unit})"
            f" {_use(part.symbol)} (dnp no) {texts_and_pins} {self._path(used)})"
        )

    def _paper(self) -> str:
        """Return the smallest paper that holds the drawing."""
        points = [placed.at for placed in self.placed]
        points += [(x + BOX[0], y + BOX[1]) for x, y in self.below.values()]
        wide = ((each, each.size * len(each.text)) for each in self.labels)
        points += [(each.at[0] + end * (each.anchor == "left"), each.at[1]) for each, end in wide]
        across, down = (max(each) for each in zip(*points, strict=True))
        width, height = GRID * across + FRAME, GRID * down + TITLE_BLOCK
        for name, size in PAPERS.items():
            if width <= size[0] and height <= size[1]:
                return quoted(name)
        return f'"User" {round(width)} {round(height)}'


def library(symbols: Iterable[Symbol]) -> str:
    """Return the file ``.kicad_sym`` with `symbols`."""
    every = "\n".join(_in_library(symbol, symbol.name) for symbol in symbols)
    return f"(kicad_symbol_lib {HEAD}\n{every})\n"


def _in_library(symbol: Symbol, name: str) -> str:
    """Return a symbol as it stands in a library."""
    texts = {"Reference": symbol.prefix, "Value": symbol.name}
    texts |= dict.fromkeys(("Footprint", "Datasheet", "Description"), "")
    properties = (_field(key, text, (0, 0), hide=True) for key, text in texts.items())
    looks = "(power) " * symbol.power + "(pin_numbers hide) " * (not symbol.numbers)
    hidden = "" if symbol.names else " hide"
    units = "\n".join(_units(symbol))
    return (
        f"(symbol {quoted(name)} {looks}(pin_names (offset 0.5){hidden}) {_use(symbol)}"
        f" {' '.join(properties)}\n{units})"
    )


def _units(symbol: Symbol) -> Iterator[str]:
    """Yield the lines, the circle and the pins of each unit."""
    look = f"{_stroke(0.254)} (fill (type none))"
    circle = f"(circle (center 0 0) (radius {symbol.radius}) {look})" if symbol.radius else ""
    for number, (paths, pins) in enumerate(zip(symbol.lines, symbol.units, strict=True), 1):
        lines = (
            f"(polyline (pts {' '.join(f'(xy {numbers(*point)})' for point in path)}) {look})"
            for path in paths
        )
        ends = (
            f"(pin {pin.kind} line (at {numbers(*pin.at, pin.direction)}) (length {pin.length})"
            f" (name {quoted(pin.name)} {_effects()}) (number {quoted(pin.number)} {_effects()}))"
            for pin in pins
        )
        name = quoted(f"{symbol.name}_{number}_1")
        yield f"(symbol {name} {' '.join(lines)} {circle} {' '.join(ends)})"


def _use(symbol: Symbol) -> str:
    return f"(exclude_from_sim no) (in_bom {'yes' if symbol.bought else 'no'}) (on_board yes)"


def _field(
    name: str, text: str, at: Point, angle: int = 0, *, justify: str = "", hide: bool = False
) -> str:
    effects = _effects(justify, hide=hide)
    return f"(property {quoted(name)} {quoted(text)} (at {_mm(at)} {angle}) {effects})"


def _stroke(width: float) -> str:
    return f"(stroke (width {width}) (type default))"


def _effects(justify: str = "", size: float = TEXT, *, hide: bool = False) -> str:
    more = f" (justify {justify})" if justify else ""
    return f"(effects (font (size {size} {size})){more}{' (hide yes)' * hide})"
