"""A sheet of a schematic: parts, wires and labels at places of a grid, y downwards; KiCad's file.

The grid is KiCad's, 1.27 mm; all ends of pins and wires are on it.
"""

from __future__ import annotations

import uuid
from collections import Counter, defaultdict
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from itertools import pairwise
from typing import Any, Literal, TypeAlias

from taction.netlist_gen.kicad.symbols import LIBRARY, Point, Symbol

VERSION = 20231120  # of the format: KiCad 8 and newer
NAMES = uuid.UUID("6ba7b812-9dad-11d1-80b4-00c04fd430c8")  # the namespace of OIDs
PAPERS = {"A4": (297, 210), "A3": (420, 297), "A2": (594, 420), "A1": (841, 594), "A0": (1189, 841)}
GRID = 1.27  # mm
FRAME, TITLE_BLOCK = 15.0, 45.0  # mm beside the drawing, and below it
TEXT, TITLE = 1.27, 2.0  # height of a text and of a title, mm
TURN = {0: (1, 0), 90: (0, 1)}  # cosine and sine, counterclockwise
Expression: TypeAlias = Sequence[Any]  # of atoms and expressions


class Quoted(str):
    """A text in quotation marks; a plain `str` is a keyword."""

    __slots__ = ()


def written(expression: Expression, indent: int = 0) -> str:
    r"""Return an S-expression as text: each list within a list on a line of its own.

    Examples
    --------
    >>> print(written(["label", Quoted("a \"b\""), ["at", 1.0, -2.54, 0]]))
    (label "a \"b\""
      (at 1 -2.54 0)
    )
    """
    line = "  " * indent + "("
    nested = False
    for place, item in enumerate(expression):
        if isinstance(item, str) or not isinstance(item, Sequence):
            line += (" " if place else "") + _atom(item)
        else:
            nested = True
            line += "\n" + written(item, indent + 1)
    return line + ("\n" + "  " * indent if nested else "") + ")"


def _atom(value: str | float) -> str:
    if isinstance(value, Quoted):
        text = value.replace("\\", "\\\\").replace('"', '\\"').replace("\n", "\\n")
        return f'"{text}"'
    # Lengths are multiples of 0.01 mm, so six decimals are exact, and there is no -0.
    return (
        value if isinstance(value, str) else f"{round(value, 6) + 0.0:.6f}".rstrip("0").rstrip(".")
    )


@dataclass(frozen=True, slots=True)
class SymbolPart:
    """A symbol with its reference, its value and its other fields."""

    symbol: Symbol
    reference: str
    value: str
    fields: Mapping[str, str] = field(default_factory=dict)
    unit: int = 1


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
        x, y = self.turned(self.part.symbol.units[self.part.unit - 1][place].at)
        return round(x), round(y)

    def turned(self, point: Point) -> Point:
        """Return the place on the sheet of a point of the symbol, mm, y upwards."""
        cosine, sine = TURN[self.angle]
        x, y = point[0] * cosine - point[1] * sine, point[0] * sine + point[1] * cosine
        return self.at[0] + x / GRID, self.at[1] - y / GRID


@dataclass(frozen=True, slots=True)
class Label:
    """A text on a sheet; `at` is its left end, its middle, or its right end.

    Attributes
    ----------
    kind : str
        ``"text"``; ``"label"``: a net of this sheet, above its wire; ``"input"``, ``"output"``: a
        net of several sheets.
    size : float
        Height, mm.
    """

    text: str
    at: Point
    anchor: Literal["left", "middle", "right"] = "left"
    kind: Literal["text", "label", "input", "output"] = "text"
    size: float = TEXT

    @property
    def width(self) -> float:
        """About, in steps of the grid; of labels with a frame, with it."""
        return 3.0 + len(self.text) if self.kind == "output" else 0.95 * len(self.text) * self.size

    @property
    def expression(self) -> Expression:
        """The label as it stands in a schematic."""
        side = [] if self.anchor == "middle" else [self.anchor]
        where = ["at", *_mm(self.at), 180 if self.anchor == "right" else 0]
        if self.kind == "text":
            more: list[Expression] = [["exclude_from_sim", "no"]]
            return ["text", Quoted(self.text), *more, where, _effects(*side, size=self.size)]
        if self.kind == "label":
            return ["label", Quoted(self.text), where, _effects(*side, "bottom")]
        return [
            "hierarchical_label",
            Quoted(self.text),
            ["shape", self.kind],
            where,
            _effects(*side),
        ]


@dataclass(frozen=True, slots=True)
class Below:
    """A sheet as a box on the sheet above it: its nets are pins, inputs left and outputs right."""

    name: str
    at: Point
    inputs: tuple[str, ...]
    outputs: tuple[str, ...]

    @property
    def size(self) -> Point:
        """Width and height of the box."""
        wide = [max(map(len, nets), default=0) for nets in (self.inputs, self.outputs)]
        rows = max(len(self.inputs), len(self.outputs), 1)
        return max(sum(wide), len(self.name)) + 6, 2 * rows + 2

    @property
    def pins(self) -> Iterator[tuple[str, Literal["left", "right"], Point]]:
        """Net, side and place of every pin."""
        (x, y), (width, _) = self.at, self.size
        for row, net in enumerate(self.inputs, 1):
            yield net, "left", (x, y + 2 * row)
        for row, net in enumerate(self.outputs, 1):
            yield net, "right", (x + width, y + 2 * row)


@dataclass(eq=False)
class SchematicSheet:
    """One page. Junctions follow from the wires: a wire ends on another one only to join it.

    The first sheet of a project has no `name`, and the others as boxes `below` it.
    """

    project: str
    name: str = ""
    below: list[Below] = field(default_factory=list)
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
    def corner(self) -> Point:
        """The right and lower end of the drawing."""
        points = [each.at for each in self.placed]
        points += [end for segment in self.segments for end in segment]
        points += [(x + label.width, y) for label in self.labels for x, y in (label.at,)
                   if label.anchor == "left"]  # fmt: skip
        points += [(x + wide, y + high) for box in self.below
                   for (x, y), (wide, high) in ((box.at, box.size),)]  # fmt: skip
        return max(x for x, _ in points), max(y for _, y in points)

    def junctions(self) -> list[Point]:
        """Return the points where three or more ends meet; a wire that goes through has two."""
        ends = Counter(end for segment in self.segments for end in segment)
        for placed in self.placed:
            for place in range(len(placed.part.symbol.units[placed.part.unit - 1])):
                ends[placed.pin(place)] += 1
        grid = _PointLines(ends)
        through = Counter(point for each in self.segments for point in grid.between(*each))
        return sorted(point for point, count in ends.items() if count + 2 * through[point] >= 3)

    def schematic(self, title: str, comments: tuple[str, ...]) -> str:
        """Return the file ``.kicad_sch``."""
        symbols = {placed.part.symbol.name: placed.part.symbol for placed in self.placed}
        items = [*map(self._symbol, self.placed)]
        items += [label.expression for label in self.labels]
        items += self._wires()
        block = [["comment", number, Quoted(text)] for number, text in enumerate(comments, 1)]
        whole: Expression = [
            "kicad_sch",
            *HEAD,
            self._id("sheet"),
            ["paper", *self._paper()],
            ["title_block", ["title", Quoted(title)], *block],
            ["lib_symbols", *(_in_library(s, f"{LIBRARY}:{s.name}") for s in symbols.values())],
            *([*item, self._id(str(number))] for number, item in enumerate(items)),
            *(self._box(page, box) for page, box in enumerate(self.below, 2)),
            *(() if self.name else (FIRST,)),
        ]
        return f"{written(whole)}\n"

    def _id(self, what: str) -> Expression:
        """Return an identifier that is the same each time the same sheet is drawn."""
        place = f"{self.project}/{self.name}" if self.name else self.project
        return ["uuid", Quoted(uuid.uuid5(NAMES, f"taction/{place}/{what}"))]

    def _path(self) -> Expression:
        """Return the identifiers of the sheets from the first one to this one."""
        first = SchematicSheet(self.project)
        path = f"/{first._id('sheet')[1]}"
        return ["path", Quoted(f"{path}/{first._id(self.name)[1]}" if self.name else path)]

    def _box(self, page: int, box: Below) -> Expression:
        """Return the box of a sheet below this one."""
        (x, y), (width, height) = box.at, box.size
        texts = {"Sheetname": (box.name, y - 0.5, "bottom"),
                 "Sheetfile": (f"{box.name}.kicad_sch", y + height + 0.5, "top")}  # fmt: skip
        turned = {"left": 180, "right": 0}
        return [
            *("sheet", ["at", *_mm(box.at)], ["size", *_mm((width, height))]),
            *(_stroke(0.15), ["fill", ["color", 0, 0, 0, 0.0]], self._id(box.name)),
            *(
                ["property", Quoted(key), Quoted(text), ["at", *_mm((x, level)), 0],
                 _effects("left", side)]
                for key, (text, level, side) in texts.items()
            ),
            *(
                ["pin", Quoted(net), "input" if side == "left" else "output",
                 ["at", *_mm(at), turned[side]], self._id(f"{box.name}/{net}"), _effects(side)]
                for net, side, at in box.pins
            ),
            ["instances", ["project", Quoted(self.project),
                           [*self._path(), ["page", Quoted(page)]]]],
        ]  # fmt: skip

    def _symbol(self, placed: Placed) -> Expression:
        part, angle = placed.part, placed.angle
        texts = {"Reference": (part.reference, placed.reference),
                 "Value": (part.value, placed.value)}  # fmt: skip
        texts |= {name: (text, None) for name, text in ({"Footprint": "", "Datasheet": ""}
                                                       | dict(part.fields)).items()}  # fmt: skip
        pins = (pin.number for pin in part.symbol.units[part.unit - 1])
        return [
            *("symbol", ["lib_id", Quoted(f"{LIBRARY}:{part.symbol.name}")]),
            ["at", *_mm(placed.at), angle],
            ["unit", part.unit],
            *_use(part.symbol),
            ["dnp", "no"],
            *(
                ["property", Quoted(name), Quoted(text), ["at", *_mm(place or placed.at), angle],
                 _effects(hide=place is None)]
                for name, (text, place) in texts.items()
            ),
            *(["pin", Quoted(n), self._id(f"{part.reference}/{part.unit}/{n}")] for n in pins),
            ["instances", ["project", Quoted(self.project), [*self._path(),
                           ["reference", Quoted(part.reference)], ["unit", part.unit]]]],
        ]  # fmt: skip

    def _wires(self) -> Iterator[Expression]:
        """Yield the wires, cut at the junctions as KiCad wants them, and the junctions."""
        junctions = self.junctions()
        grid = _PointLines(junctions)
        for start, end in self.segments:
            for a, b in pairwise(sorted({start, end, *grid.between(start, end)})):
                yield ["wire", ["pts", ["xy", *_mm(a)], ["xy", *_mm(b)]], _stroke(0)]
        for point in junctions:
            yield ["junction", ["at", *_mm(point)], ["diameter", 0], ["color", 0, 0, 0, 0]]

    def _paper(self) -> tuple[str | float, ...]:
        """Return the smallest paper that holds the drawing."""
        across, down = _mm(self.corner)
        width, height = across + FRAME, down + TITLE_BLOCK
        for name, size in PAPERS.items():
            if width <= size[0] and height <= size[1]:
                return (Quoted(name),)
        return Quoted("User"), round(width), round(height)


HEAD: Expression = (["version", VERSION], ["generator", Quoted("taction")])
FIRST: Expression = ["sheet_instances", ["path", Quoted("/"), ["page", Quoted("1")]]]


def library(symbols: Iterable[Symbol]) -> str:
    """Return the file ``.kicad_sym`` with `symbols`."""
    every = (_in_library(symbol, symbol.name) for symbol in symbols)
    return f"{written(['kicad_symbol_lib', *HEAD, *every])}\n"


def _in_library(symbol: Symbol, name: str) -> Expression:
    """Return a symbol as it stands in a library."""
    texts = {"Reference": symbol.prefix, "Value": symbol.name}
    texts |= dict.fromkeys(("Footprint", "Datasheet", "Description"), "")
    return [
        *("symbol", Quoted(name)),
        *([["power"]] if symbol.power else []),
        *([] if symbol.numbers else [["pin_numbers", "hide"]]),
        ["pin_names", ["offset", 0.5], *([] if symbol.names else ["hide"])],
        *_use(symbol),
        *(
            ["property", Quoted(key), Quoted(text), ["at", 0, 0, 0], _effects(hide=True)]
            for key, text in texts.items()
        ),
        *(_unit(symbol, number) for number in range(1, 1 + len(symbol.units))),
    ]


def _unit(symbol: Symbol, number: int) -> Expression:
    look = _stroke(0.254), ["fill", ["type", "none"]]
    graphics: list[Expression] = [
        ["polyline", ["pts", *(["xy", *point] for point in points)], *look]
        for points in symbol.lines[number - 1]
    ]
    if symbol.radius:
        graphics.append(["circle", ["center", 0, 0], ["radius", symbol.radius], *look])
    pins: list[Expression] = [
        [
            *("pin", pin.kind, "line"),
            ["at", *pin.at, pin.direction],
            ["length", pin.length],
            ["name", Quoted(pin.name), _effects()],
            ["number", Quoted(pin.number), _effects()],
        ]
        for pin in symbol.units[number - 1]
    ]
    return ["symbol", Quoted(f"{symbol.name}_{number}_1"), *graphics, *pins]


def _use(symbol: Symbol) -> Iterator[Expression]:
    yield ["exclude_from_sim", "no"]
    yield ["in_bom", "yes" if symbol.bought else "no"]
    yield ["on_board", "yes"]


def _stroke(width: float) -> Expression:
    return ["stroke", ["width", width], ["type", "default"]]


def _effects(*justify: str, size: float = TEXT, hide: bool = False) -> Expression:
    more: list[Expression] = [["justify", *justify]] if justify else []
    more += [["hide", "yes"]] if hide else []
    return ["effects", ["font", ["size", size, size]], *more]


def _mm(point: Point) -> Point:
    return GRID * point[0], GRID * point[1]


class _PointLines:
    """Points by their columns and rows, to find those on a wire."""

    def __init__(self, points: Iterable[Point]) -> None:
        self.lines: dict[tuple[int, float], list[Point]] = defaultdict(list)
        for point in points:
            for along in (0, 1):
                self.lines[along, point[1 - along]].append(point)

    def between(self, start: Point, end: Point) -> list[Point]:
        """Return the points on a wire that are not its ends."""
        along = 1 if start[0] == end[0] else 0
        low, high = sorted((start[along], end[along]))
        found = self.lines[along, start[1 - along]]
        return [point for point in found if low < point[along] < high]
