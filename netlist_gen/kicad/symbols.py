"""The symbols of a schematic: pins and lines of each unit, in mm, y upwards; S-expressions.

They stand in the schematic itself and in a library beside it, so no library of KiCad is needed.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, TypeAlias

LIBRARY = "taction"
RIGHT, UP, LEFT, DOWN = 0, 90, 180, 270  # from the end of a pin to its symbol
Point = tuple[float, float]


Atom: TypeAlias = str | float
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


def _atom(value: Atom) -> str:
    if isinstance(value, Quoted):
        text = value.replace("\\", "\\\\").replace('"', '\\"').replace("\n", "\\n")
        return f'"{text}"'
    # Lengths are multiples of 0.01 mm, so six decimals are exact, and there is no -0.
    return (
        value if isinstance(value, str) else f"{round(value, 6) + 0.0:.6f}".rstrip("0").rstrip(".")
    )


@dataclass(frozen=True, slots=True)
class Pin:
    """A connection: `number` as KiCad has it, `kind` its electrical type, `at` its free end."""

    number: str
    name: str
    kind: str
    at: Point
    direction: int
    length: float = 2.54


@dataclass(frozen=True, slots=True)
class Symbol:
    """A symbol; unit A is the first of `units`.

    `lines` has for each unit its polylines, and `circles` its circles as centre and radius.
    `names` says whether the names of the pins are shown, `power` whether it names a net.
    """

    name: str
    prefix: str
    units: tuple[tuple[Pin, ...], ...]
    lines: tuple[tuple[tuple[Point, ...], ...], ...]
    circles: tuple[tuple[float, float, float], ...] = ()
    numbers: bool = False
    names: bool = False
    power: bool = False
    bought: bool = True

    @property
    def expression(self) -> Expression:
        """The symbol as it stands in a library."""
        power: list[Expression] = [["power"]] if self.power else []
        shown: list[Expression] = [] if self.numbers else [["pin_numbers", "hide"]]
        hidden = [] if self.names else ["hide"]
        return [
            *("symbol", Quoted(self.name)),
            *power,
            *shown,
            ["pin_names", ["offset", 0.5], *hidden],
            ["exclude_from_sim", "no"],
            ["in_bom", "yes" if self.bought else "no"],
            ["on_board", "yes"],
            *(
                ["property", Quoted(key), Quoted(value), ["at", 0, 0, 0], _effects(hide=True)]
                for key, value in (
                    ("Reference", self.prefix),
                    ("Value", self.name),
                    ("Footprint", ""),
                    ("Datasheet", ""),
                    ("Description", ""),
                )
            ),
            *(self._unit(number) for number in range(1, 1 + len(self.units))),
        ]

    def _unit(self, number: int) -> Expression:
        graphics: list[Expression] = [
            [
                "polyline",
                ["pts", *(["xy", *point] for point in points)],
                ["stroke", ["width", 0.254], ["type", "default"]],
                ["fill", ["type", "none"]],
            ]
            for points in self.lines[number - 1]
        ]
        graphics += [
            [
                "circle",
                ["center", x, y],
                ["radius", radius],
                ["stroke", ["width", 0.254], ["type", "default"]],
                ["fill", ["type", "none"]],
            ]
            for x, y, radius in self.circles
        ]
        pins: list[Expression] = [
            [
                *("pin", pin.kind, "line"),
                ["at", *pin.at, pin.direction],
                ["length", pin.length],
                ["name", Quoted(pin.name), _effects()],
                ["number", Quoted(pin.number), _effects()],
            ]
            for pin in self.units[number - 1]
        ]
        return ["symbol", Quoted(f"{self.name}_{number}_1"), *graphics, *pins]


def _effects(*, hide: bool = False) -> Expression:
    more: list[Expression] = [["hide", "yes"]] if hide else []
    return ["effects", ["font", ["size", 1.27, 1.27]], *more]


def _two_ended(kind: str = "passive") -> tuple[Pin, ...]:
    return Pin("1", "1", kind, (0, 3.81), DOWN, 1.27), Pin("2", "2", kind, (0, -3.81), UP, 1.27)


RESISTOR = Symbol(
    "R",
    "R",
    (_two_ended(),),
    ((((-1.016, -2.54), (-1.016, 2.54), (1.016, 2.54), (1.016, -2.54), (-1.016, -2.54)),),),
)
PLATE = 2.032
CAPACITOR = Symbol(
    "C",
    "C",
    (_two_ended(),),
    (
        (
            ((-PLATE, 0.762), (PLATE, 0.762)),
            ((-PLATE, -0.762), (PLATE, -0.762)),
            ((0, 2.54), (0, 0.762)),
            ((0, -2.54), (0, -0.762)),
        ),
    ),
)
ARROW = ((0.0, 1.778), (0.0, -1.778), (-0.762, -0.762), (0.762, -0.762), (0.0, -1.778))
CURRENT = Symbol("I", "I", (_two_ended(),), ((ARROW,),), circles=((0, 0, 2.54),), bought=False)
VOLTAGE = Symbol(
    "V",
    "V",
    (_two_ended(),),
    (
        (
            ((-0.762, 1.27), (0.762, 1.27)),
            ((0, 0.508), (0, 2.032)),
            ((-0.762, -1.27), (0.762, -1.27)),
        ),
    ),
    circles=((0, 0, 2.54),),
    bought=False,
)
GROUND = Symbol(
    "GND",
    "#PWR",
    ((Pin("1", "GND", "power_in", (0, 0), DOWN, 0),),),
    ((((0, 0), (0, -1.27), (1.27, -1.27), (0, -2.54), (-1.27, -1.27), (0, -1.27)),),),
    power=True,
    bought=False,
)
FLAG = Symbol(
    "PWR_FLAG",
    "#FLG",
    ((Pin("1", "pwr", "power_out", (0, 0), UP, 0),),),
    ((((0, 0), (0, 1.27), (-1.016, 1.905), (0, 2.54), (1.016, 1.905), (0, 1.27)),),),
    power=True,
    bought=False,
)
FUNCTION = Symbol(
    "function",
    "B",
    (
        (
            Pin("1", "v", "input", (-12.7, 0), RIGHT),
            Pin("2", "u", "output", (12.7, 0), LEFT),
        ),
    ),
    ((((-10.16, 5.08), (10.16, 5.08), (10.16, -5.08), (-10.16, -5.08), (-10.16, 5.08)),),),
    bought=False,
)


def rail(name: str) -> Symbol:
    """Return the symbol of a supply such as ``"+15V"``: upwards if positive, else downwards."""
    up = 1.0 if name.startswith("+") else -1.0
    lines = (((-0.762, 1.27 * up), (0, 2.54 * up), (0.762, 1.27 * up)), ((0, 0), (0, 2.54 * up)))
    pin = Pin("1", name, "power_in", (0, 0), UP if up > 0 else DOWN, 0)
    return Symbol(name, "#PWR", ((pin,),), (lines,), power=True, bought=False)


# Numbers of the pins -, +, output of each op-amp, then V+ and V-, as all makers have them.
PINOUTS = {
    1: ((("2", "3", "6"),), ("7", "4")),
    2: ((("2", "3", "1"), ("6", "5", "7")), ("8", "4")),
    4: ((("2", "3", "1"), ("6", "5", "7"), ("9", "10", "8"), ("13", "12", "14")), ("4", "11")),
}
# Presets whose data sheets have these pins; of others the pins have names, no numbers.
USUAL_PINS = frozenset(
    {
        *("ua741", "lf353", "tl084", "lf356", "ne5534", "op27", "lm324"),
        *("tl072", "opa2134", "ad711", "ad8065", "lt1028", "opa1612"),
    }
)


def opamp(name: str, count: int, *, usual: bool) -> Symbol:
    """Return the symbol of a package with `count` op-amps; its last unit has the supply pins."""
    cells, (plus, minus) = PINOUTS[count] if usual else _named_pins(count)
    units = [
        (
            Pin(inverting, "-", "input", (-7.62, 2.54), RIGHT),
            Pin(noninverting, "+", "input", (-7.62, -2.54), RIGHT),
            Pin(output, "~", "output", (7.62, 0), LEFT),
        )
        for inverting, noninverting, output in cells
    ]
    supply = (
        Pin(plus, "V+", "power_in", (0, 7.62), DOWN, 3.81),
        Pin(minus, "V-", "power_in", (0, -7.62), UP, 3.81),
    )
    triangle = ((-5.08, 5.08), (5.08, 0.0), (-5.08, -5.08), (-5.08, 5.08))
    box = ((-2.54, 3.81), (2.54, 3.81), (2.54, -3.81), (-2.54, -3.81), (-2.54, 3.81))
    lines = (*((triangle,) for _ in cells), (box,))
    return Symbol(name, "U", (*units, supply), lines, numbers=usual, names=True)


def _named_pins(count: int) -> tuple[tuple[tuple[str, str, str], ...], tuple[str, str]]:
    letters = [chr(ord("A") + place) if count > 1 else "" for place in range(count)]
    return tuple((f"{a}-", f"{a}+", f"{a}out") for a in letters), ("V+", "V-")


def transistor_pair(name: str, polarity: str) -> Symbol:
    """Return the symbol of two matched transistors; the pins have names, no numbers."""
    up = 1.0 if polarity == "npn" else -1.0  # the collector of an NPN is above, of a PNP below
    arrow = (
        ((1.016, -1.27), (1.778, -1.778), (1.524, -0.762), (1.016, -1.27))
        if up > 0
        else ((1.27, 1.778), (0.762, 0.762), (1.778, 1.016), (1.27, 1.778))
    )
    lines = (
        ((0.635, 1.905), (0.635, -1.905)),
        ((0.635, 0.635), (2.54, 2.54)),
        ((0.635, -0.635), (2.54, -2.54)),
        ((0, 0), (0.635, 0)),
        arrow,
    )
    units = tuple(
        (
            Pin(f"B{number}", "B", "input", (-5.08, 0), RIGHT, 5.08),
            Pin(f"C{number}", "C", "passive", (2.54, 5.08 * up), DOWN if up > 0 else UP),
            Pin(f"E{number}", "E", "passive", (2.54, -5.08 * up), UP if up > 0 else DOWN),
        )
        for number in (1, 2)
    )
    return Symbol(name, "Q", units, (lines, lines))
