"""The symbols of a schematic: pins, lines and circles of each unit, in mm, y upwards.

They stand in the schematic itself and in a library beside it, so no library of KiCad is needed.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field

LIBRARY = "taction"
RIGHT, UP, LEFT, DOWN = 0, 90, 180, 270  # from the end of a pin to its symbol
Point = tuple[float, float]
Path = tuple[Point, ...]


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
    """A symbol; unit A is the first of `units`, and `lines` has the polylines of each unit."""

    name: str
    prefix: str
    units: tuple[tuple[Pin, ...], ...]
    lines: tuple[tuple[Path, ...], ...]
    radius: float = 0.0
    numbers: bool = False
    names: bool = False
    power: bool = False
    bought: bool = True


@dataclass(frozen=True, slots=True)
class SymbolPart:
    """A unit of a symbol, counted from 1, with its reference, its value and its other fields."""

    symbol: Symbol
    reference: str
    value: str
    fields: Mapping[str, str] = field(default_factory=dict)
    unit: int = 1

    @property
    def pins(self) -> tuple[Pin, ...]:
        """The pins of the unit."""
        return self.symbol.units[self.unit - 1]


def _path(text: str, up: float = 1.0) -> Path:
    """Return the points of ``"x,y x,y ..."``, with -1 upside down."""
    points = (point.split(",") for point in text.split())
    return tuple((float(x), up * float(y)) for x, y in points)


def _two_ended(letter: str, *paths: str, radius: float = 0.0, bought: bool = True) -> Symbol:
    upper, lower = (0, 3.81), (0, -3.81)
    pins = Pin("1", "1", "passive", upper, DOWN, 1.27), Pin("2", "2", "passive", lower, UP, 1.27)
    return Symbol(letter, letter, (pins,), (tuple(map(_path, paths)),), radius, bought=bought)


def _port(name: str, prefix: str, kind: str, direction: int, *paths: Path) -> Symbol:
    pin = Pin("1", "pwr" if kind == "power_out" else name, kind, (0, 0), direction, 0)
    return Symbol(name, prefix, ((pin,),), (paths,), power=True, bought=False)


def rail(name: str) -> Symbol:
    """Return the symbol of a supply such as ``"+15V"``: upwards if positive, else downwards."""
    up = 1.0 if name.startswith("+") else -1.0
    paths = (_path(each, up) for each in ("-0.762,1.27 0,2.54 0.762,1.27", "0,0 0,2.54"))
    return _port(name, "#PWR", "power_in", UP if up > 0 else DOWN, *paths)


BOX = "-1.016,-2.54 -1.016,2.54 1.016,2.54 1.016,-2.54 -1.016,-2.54"
ARROW = "0,1.778 0,-1.778 -0.762,-0.762 0.762,-0.762 0,-1.778"
EARTH = "0,0 0,-1.27 1.27,-1.27 0,-2.54 -1.27,-1.27 0,-1.27"
PENNANT = "0,0 0,1.27 -1.016,1.905 0,2.54 1.016,1.905 0,1.27"
PLATES = ("-2.032,0.762 2.032,0.762", "-2.032,-0.762 2.032,-0.762", "0,2.54 0,0.762",
          "0,-2.54 0,-0.762")  # fmt: skip
TRANSISTOR = ("0.635,1.905 0.635,-1.905", "0.635,0.635 2.54,2.54", "0.635,-0.635 2.54,-2.54",
              "0,0 0.635,0")  # fmt: skip
EMITTERS = {
    "npn": "1.016,-1.27 1.778,-1.778 1.524,-0.762 1.016,-1.27",
    "pnp": "1.27,1.778 0.762,0.762 1.778,1.016 1.27,1.778",
}
SIGNS = "-0.762,1.27 0.762,1.27", "0,0.508 0,2.032", "-0.762,-1.27 0.762,-1.27"

RESISTOR, CAPACITOR = _two_ended("R", BOX), _two_ended("C", *PLATES)
CURRENT = _two_ended("I", ARROW, radius=2.54, bought=False)
VOLTAGE = _two_ended("V", *SIGNS, radius=2.54, bought=False)
GROUND = _port("GND", "#PWR", "power_in", DOWN, _path(EARTH))
FLAG = _port("PWR_FLAG", "#FLG", "power_out", UP, _path(PENNANT))
FUNCTION = Symbol(
    "function",
    "B",
    ((Pin("1", "v", "input", (-12.7, 0), RIGHT), Pin("2", "u", "output", (12.7, 0), LEFT)),),
    ((_path("-10.16,5.08 10.16,5.08 10.16,-5.08 -10.16,-5.08 -10.16,5.08"),),),
    bought=False,
)

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
        *("tl072", "tl074", "opa2134", "ad711", "ad8065", "lt1028", "opa1612", "opa189"),
    }
)


def opamp(name: str, count: int, *, usual: bool) -> Symbol:
    """Return the symbol of a package with `count` op-amps; its last unit has the supply pins."""
    letters = [chr(ord("A") + place) if count > 1 else "" for place in range(count)]
    named = tuple((f"{a}-", f"{a}+", f"{a}out") for a in letters), ("V+", "V-")
    cells, (plus, minus) = PINOUTS[count] if usual else named
    ends = (
        *(("-", "input", (-7.62, 2.54), RIGHT), ("+", "input", (-7.62, -2.54), RIGHT)),
        ("~", "output", (7.62, 0), LEFT),
    )
    units = [tuple(Pin(n, *end) for n, end in zip(cell, ends, strict=True)) for cell in cells]
    supply = (
        Pin(plus, "V+", "power_in", (0, 7.62), DOWN, 3.81),
        Pin(minus, "V-", "power_in", (0, -7.62), UP, 3.81),
    )
    triangle = _path("-5.08,5.08 5.08,0 -5.08,-5.08 -5.08,5.08")
    box = _path("-2.54,3.81 2.54,3.81 2.54,-3.81 -2.54,-3.81 -2.54,3.81")
    lines = (*((triangle,) for _ in cells), (box,))
    return Symbol(name, "U", (*units, supply), lines, numbers=usual, names=True)


def transistor_pair(name: str, polarity: str) -> Symbol:
    """Return the symbol of two matched transistors; the pins have names, no numbers."""
    up = 1.0 if polarity == "npn" else -1.0  # the collector of an NPN is above, of a PNP below
    lines = tuple(map(_path, (*TRANSISTOR, EMITTERS[polarity])))
    units = tuple(
        (
            Pin(f"B{number}", "B", "input", (-5.08, 0), RIGHT, 5.08),
            Pin(f"C{number}", "C", "passive", (2.54, 5.08 * up), DOWN if up > 0 else UP),
            Pin(f"E{number}", "E", "passive", (2.54, -5.08 * up), UP if up > 0 else DOWN),
        )
        for number in (1, 2)
    )
    return Symbol(name, "Q", units, (lines, lines))
