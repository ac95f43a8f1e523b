"""A sheet of a schematic: parts, wires and labels at places of a grid, y downwards.

The grid is KiCad's, 1.27 mm; all ends of pins and wires are on it.
"""

from __future__ import annotations

import uuid
from collections import Counter, defaultdict
from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field
from itertools import pairwise
from typing import Literal

from taction.netlist_gen.kicad.symbols import (
    LIBRARY,
    Expression,
    Point,
    Quoted,
    Symbol,
    written,
)

VERSION = 20231120  # of the format: KiCad 8 and newer
NAMES = uuid.UUID("6ba7b812-9dad-11d1-80b4-00c04fd430c8")  # the namespace of OIDs
PAPERS = {"A4": (297, 210), "A3": (420, 297), "A2": (594, 420), "A1": (841, 594), "A0": (1189, 841)}
GRID = 1.27  # mm
FRAME, TITLE_BLOCK = 15.0, 45.0  # mm beside the drawing, and below it
TEXT = 1.27  # height, mm
TURN = {0: (1, 0), 90: (0, 1)}  # cosine and sine, counterclockwise


@dataclass(frozen=True, slots=True)
class Part:
    """A symbol with its reference, its value and its other fields; `bought` as in the symbol."""

    symbol: Symbol
    reference: str
    value: str
    fields: Mapping[str, str] = field(default_factory=dict)
    unit: int = 1


@dataclass(frozen=True, slots=True)
class Placed:
    """A part on a sheet."""

    part: Part
    at: Point
    angle: int
    mirrored: bool
    reference: Point | None = None  # middle of the text; None for a hidden one
    value: Point | None = None

    def pin(self, place: int) -> Point:
        """Return where pin `place` of the unit ends, counted from 0."""
        x, y = self.turned(self.part.symbol.units[self.part.unit - 1][place].at)
        return round(x), round(y)

    def turned(self, point: Point) -> Point:
        """Return the place on the sheet of a point of the symbol, mm, y upwards."""
        cosine, sine = TURN[self.angle]
        x, y = (point[0] * cosine - point[1] * sine) / GRID, point[0] * sine + point[1] * cosine
        return self.at[0] + (-x if self.mirrored else x), self.at[1] - y / GRID


@dataclass(frozen=True, slots=True)
class Label:
    """A text on a sheet; `at` is its left end, its middle, or its right end."""

    text: str
    at: Point
    anchor: Literal["left", "middle", "right"]
    size: float = TEXT  # mm
    above: bool = False  # the wire that it names


class Sheet:
    """One page. Junctions follow from the wires: a wire ends on another one only to join it."""

    def __init__(self, project: str) -> None:
        self.project = project
        self.items: list[Expression] = []
        self.symbols: dict[str, Symbol] = {}
        self.placed: list[Placed] = []
        self.segments: list[tuple[Point, Point]] = []
        self.labels: list[Label] = []
        self.corner = [0.0, 0.0]
        self.root = self._id("sheet")

    def _id(self, what: str) -> Expression:
        """Return an identifier that is the same each time the same sheet is drawn."""
        return ["uuid", Quoted(uuid.uuid5(NAMES, f"taction/{self.project}/{what}"))]

    def _next(self) -> Expression:
        return self._id(str(len(self.items)))

    def place(
        self,
        part: Part,
        at: Point,
        *,
        angle: int = 0,
        mirrored: bool = False,
        reference: Point | None = None,
        value: Point | None = None,
    ) -> Placed:
        """Place a part; `reference` and `value` are the middles of these texts, hidden without."""
        self.symbols[part.symbol.name] = part.symbol
        found = Placed(part, at, angle, mirrored, reference, value)
        self.placed.append(found)
        texts = {"Reference": (part.reference, reference), "Value": (part.value, value)}
        texts |= {"Footprint": ("", None), "Datasheet": ("", None)}
        texts |= {name: (text, None) for name, text in part.fields.items()}
        mirror: list[Expression] = [["mirror", "y"]] if mirrored else []
        path = ["path", Quoted(f"/{self.root[1]}")]
        self.items.append(
            [
                *("symbol", ["lib_id", Quoted(f"{LIBRARY}:{part.symbol.name}")]),
                ["at", *_mm(at), angle],
                *mirror,
                ["unit", part.unit],
                ["exclude_from_sim", "no"],
                ["in_bom", "yes" if part.symbol.bought else "no"],
                ["on_board", "yes"],
                ["dnp", "no"],
                self._next(),
                *(
                    ["property", Quoted(name), Quoted(text), *_where(place or at, angle, place)]
                    for name, (text, place) in texts.items()
                ),
                *(
                    ["pin", Quoted(pin.number), self._id(f"{len(self.items)}/{pin.number}")]
                    for pin in part.symbol.units[part.unit - 1]
                ),
                [
                    "instances",
                    [
                        *("project", Quoted(self.project)),
                        [*path, ["reference", Quoted(part.reference)], ["unit", part.unit]],
                    ],
                ],
            ]
        )
        self._reach(at)
        return found

    def wire(self, *points: Point) -> Point:
        """Draw a wire along `points`, each beside or above the one before; return its end."""
        for start, end in pairwise(points):
            if start != end:
                self.segments.append((start, end))
                self._reach(end)
        return points[-1]

    def name(self, net: str, at: Point) -> None:
        """Name a net of this sheet, above a wire."""
        self.labels.append(Label(net, at, "left", above=True))
        font = _font("left", "bottom")
        self.items.append(["label", Quoted(net), ["at", *_mm(at), 0], font, self._next()])

    def signal(self, net: str, at: Point, *, output: bool) -> None:
        """Name a net of the whole board: an output to the right, an input to the left."""
        aside = at[0] + (0.6 if output else -0.6)
        self.labels.append(Label(net, (aside, at[1]), "left" if output else "right"))
        shape = ["shape", "output" if output else "input"]
        font = _font("left" if output else "right")
        where = ["at", *_mm(at), 0 if output else 180]
        self.items.append(["global_label", Quoted(net), shape, where, font, self._next()])
        self._reach((at[0] + (3.0 + len(net) if output else 0.0), at[1]))

    def text(self, text: str, at: Point, *, size: float = TEXT, middle: bool = False) -> None:
        """Write a text, its left end or its middle at `at`."""
        self.labels.append(Label(text, at, "middle" if middle else "left", size))
        font = _font(*(() if middle else ("left",)), size=size)
        head = ["text", Quoted(text), ["exclude_from_sim", "no"]]
        self.items.append([*head, ["at", *_mm(at), 0], font, self._next()])
        width = 0.0 if middle else 0.95 * size / GRID * max(map(len, text.split("\n")))
        self._reach((at[0] + width, at[1]))

    def _reach(self, point: Point) -> None:
        self.corner = [max(a, b) for a, b in zip(self.corner, point, strict=True)]

    def junctions(self) -> list[Point]:
        """Return the points where three or more ends meet; a wire that goes through has two."""
        ends = Counter(end for segment in self.segments for end in segment)
        for placed in self.placed:
            for place in range(len(placed.part.symbol.units[placed.part.unit - 1])):
                ends[placed.pin(place)] += 1
        grid = _Lines(ends)
        through = Counter(point for each in self.segments for point in grid.between(*each))
        return sorted(point for point, count in ends.items() if count + 2 * through[point] >= 3)

    def _connect(self) -> None:
        """Draw the wires, cut at the junctions as KiCad wants them, and the junctions."""
        junctions = self.junctions()
        grid = _Lines(junctions)
        for start, end in self.segments:
            points = sorted({start, end, *grid.between(start, end)})
            for a, b in pairwise(points):
                stroke = ["stroke", ["width", 0], ["type", "default"]]
                pts = ["pts", ["xy", *_mm(a)], ["xy", *_mm(b)]]
                self.items.append(["wire", pts, stroke, self._next()])
        for point in junctions:
            look = [["diameter", 0], ["color", 0, 0, 0, 0]]
            self.items.append(["junction", ["at", *_mm(point)], *look, self._next()])

    def schematic(self, title: str, comments: tuple[str, ...]) -> str:
        """Return the file ``.kicad_sch``."""
        self._connect()
        library = [
            [head, Quoted(f"{LIBRARY}:{name}"), *rest]
            for head, name, *rest in (each.expression for each in self.symbols.values())
        ]
        block = [["comment", number, Quoted(text)] for number, text in enumerate(comments, 1)]
        whole: Expression = [
            "kicad_sch",
            ["version", VERSION],
            ["generator", Quoted("taction")],
            self.root,
            ["paper", *self._paper()],
            ["title_block", ["title", Quoted(title)], *block],
            ["lib_symbols", *library],
            *self.items,
            ["sheet_instances", ["path", Quoted("/"), ["page", Quoted("1")]]],
        ]
        return f"{written(whole)}\n"

    def _paper(self) -> tuple[str | float, ...]:
        """Return the smallest paper that holds the drawing."""
        across, down = _mm((self.corner[0], self.corner[1]))
        width, height = across + FRAME, down + TITLE_BLOCK
        for name, size in PAPERS.items():
            if width <= size[0] and height <= size[1]:
                return (Quoted(name),)
        return Quoted("User"), round(width), round(height)


def library(symbols: Iterable[Symbol]) -> str:
    """Return the file ``.kicad_sym`` with `symbols`."""
    head = [["version", VERSION], ["generator", Quoted("taction")]]
    return f"{written(['kicad_symbol_lib', *head, *(each.expression for each in symbols)])}\n"


def _font(*justify: str, size: float = TEXT) -> Expression:
    placed: list[Expression] = [["justify", *justify]] if justify else []
    return ["effects", ["font", ["size", size, size]], *placed]


def _where(at: Point, angle: int, shown: Point | None) -> tuple[Expression, Expression]:
    """Return place and look of a field; its angle counts from that of the symbol."""
    font = ["effects", ["font", ["size", TEXT, TEXT]]]
    hidden: list[Expression] = [] if shown else [["hide", "yes"]]
    return ["at", *_mm(at), angle], [*font, *hidden]


def _mm(point: Point) -> Point:
    return GRID * point[0], GRID * point[1]


class _Lines:
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
