"""What a chart shows: axes, curves, limits, bands, columns and maps, in SI units.

A chart says what is drawn, not how: the renderers of `report/renderers/` choose pixels, fonts and
themes. An outcome has one look in every medium, see `OUTCOMES`.
"""

from __future__ import annotations

import itertools
import math
from collections import Counter
from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import dataclass
from itertools import cycle
from typing import Any, ClassVar, Literal

import numpy as np
from numpy.typing import ArrayLike

from taction.system.array_types import Floats

BLUE, ORANGE, GREY, PURPLE = "#0072b2", "#d55e00", "#7f7f7f", "#cc79a7"
"""Colours that stay apart for every kind of colour vision (Okabe and Ito)."""
Outcome = str  # "pass", "fail", "inconclusive", "error", or "" for none


@dataclass(frozen=True, slots=True)
class Look:
    """How an outcome is shown; its name may have the check, too: ``"fail: overshoot"``."""

    name: str
    colour: str  # of what is drawn, hexadecimal RGB: at least 3 to 1 against both papers
    mark: str  # by plotly's name, as every mark
    hatch: str = ""  # of matplotlib
    sign: str = ""  # one character


OUTCOMES = {
    "pass": Look("pass", BLUE, "circle", "", "✓"),
    "fail": Look("fail", ORANGE, "x", "////", "✗"),
    "inconclusive": Look("inconclusive", GREY, "square-open", "....", "?"),
    "error": Look("error", PURPLE, "triangle-up-open", "xxxx", "!"),
}
OTHER_LOOKS = {
    "fail": (
        *((ORANGE, "x"), ("#e69f00", "triangle-up"), ("#b8860b", "diamond"), ("#8f3f00", "cross")),
        *(("#a0522d", "triangle-down"), ("#c9a400", "star"), ("#b8574d", "hourglass")),
    ),
    "inconclusive": ((GREY, "square-open"), (GREY, "diamond-open"), (GREY, "circle-open")),
    "error": ((PURPLE, "triangle-up-open"), (PURPLE, "hexagon-open")),
}
SERIES = ("#2f7fc1", "#c4661f", "#7d6bc4", "#2b8f8f", "#a8628f", "#8a7a2a", "#5c7a9a", "#b8574d")
"""Colours of curves; one lightness between the two papers."""
SPREAD = ((47, 127, 193), (125, 107, 196), (168, 98, 143), (196, 102, 31))


def looks_of(names: Iterable[str]) -> dict[str, Look]:
    """Return a look for each result that occurs, the most frequent ones of each outcome first.

    `names`: outcomes with the check or the error behind them: ``"fail: stability"``; an empty name
      is a place without a result.
    """
    count, found = Counter(filter(None, names)), dict[str, Look]()
    for outcome, look in OUTCOMES.items():
        others = cycle(OTHER_LOOKS.get(outcome, ()))
        for name, _ in count.most_common():
            if name in ("pass", "fail") and name == outcome:
                found[name] = look
            elif name.partition(": ")[0] == outcome:
                found[name] = Look(name, *next(others))
    return found


def spread_colours(count: int) -> list[str]:
    """Return a colour for each of `count` channels, from blue over violet to orange."""
    places, levels = np.linspace(0.0, len(SPREAD) - 1.0, count), range(len(SPREAD))
    rgb = [np.interp(places, levels, level).round().astype(int) for level in np.transpose(SPREAD)]
    return [f"#{red:02x}{green:02x}{blue:02x}" for red, green, blue in np.transpose(rgb)]


SIGNS = {"ohm": "Ω", "1/s": "/s", "step": "%", "ratio": ""}
Limits = tuple[float, float]
Scale = Literal["linear", "log", "names"]
Line = Literal["solid", "dash", "dot", "dashdot", ""]
"""How a line is drawn; empty: not at all."""


@dataclass(frozen=True, slots=True)
class Axis:
    """An axis of a chart: a quantity without its unit, and the SI unit of its values.

    Values in the unit ``"step"`` are parts of the step, shown in per cent. The scale ``"names"``
    has `names` at the places 0, 1, 2 ... Without `limits` the axis is as long as its marks need.
    """

    title: str = ""
    unit: str = ""
    scale: Scale = "linear"
    limits: Limits | None = None
    names: tuple[str, ...] = ()
    whole: bool = False  # labels at whole numbers only
    reverse: bool = False  # from right to left, or from top to bottom

    @property
    def factor(self) -> float:
        """What values are multiplied by: parts of the step are shown in per cent."""
        return 100.0 if self.unit == "step" else 1.0

    @property
    def sign(self) -> str:
        """The unit as it is written."""
        return SIGNS.get(self.unit, self.unit)

    @property
    def caption(self) -> str:
        """The title, which says what per cent are of."""
        return f"{self.title} (% of the step)".lstrip() if self.unit == "step" else self.title


TIME = Axis("time", "s")


@dataclass(frozen=True, slots=True, eq=False)
class Curve:
    """Points (P,) in the units of the axes, joined by a line, with marks, or both; NaN is a gap."""

    x: ArrayLike
    y: ArrayLike
    name: str = ""  # for the legend (`label`), and for the hover
    colour: str = SERIES[0]  # hexadecimal, an outcome, or ink, muted, band, true: of the theme
    line: Line = "solid"
    mark: str = ""  # or none
    width: float = 1.5  # points, as the size
    size: float = 6.0
    label: Literal["legend", ""] = "legend"  # where the name stands
    hover: tuple[str, ...] = ()  # for each point, for the pointer; empty: the coordinates
    behind: bool = False  # below the other marks


@dataclass(frozen=True, slots=True)
class Limit:
    """A straight line through the whole chart at a value of the axis `across`."""

    value: float
    across: Literal["x", "y"] = "x"
    name: str = ""  # for the legend
    colour: str = "ink"
    line: Line = "dash"
    width: float = 1.0


@dataclass(frozen=True, slots=True)
class Band:
    """The part of the chart between two values of the axis `across`."""

    low: float
    high: float
    across: Literal["x", "y"] = "y"
    name: str = ""
    colour: str = "band"


@dataclass(frozen=True, slots=True, eq=False)
class Columns:
    """Columns (n,) of a histogram, from 0."""

    places: ArrayLike  # their middles
    sizes: ArrayLike  # their heights
    widths: ArrayLike
    looks: tuple[str, ...]  # the outcome of each


@dataclass(frozen=True, slots=True, eq=False)
class Grid:
    """Values (m, n) over the two axes as colours; NaN is a cell without a value.

    A ``"signed"`` scale is blue below 0 and orange above it, by the square root.
    """

    x: ArrayLike  # (n,) middles of the cells
    y: ArrayLike  # (m,)
    values: ArrayLike
    unit: str = ""
    scale: Literal["linear", "log", "signed"] = "linear"
    texts: tuple[tuple[str, ...], ...] = ()  # for the pointer
    written: tuple[tuple[str, ...], ...] = ()  # in the cells


@dataclass(frozen=True, slots=True)
class Text:
    """A text on the side `align` of a place; None: at the edge that `align` says."""

    text: str
    x: float | None
    y: float | None
    align: tuple[Literal["left", "right", "middle"], Literal["above", "below", "middle"]]
    colour: str = "muted"


Mark = Curve | Limit | Band | Columns | Grid | Text


@dataclass(frozen=True, slots=True, eq=False)
class Chart:
    """One pair of axes with marks."""

    kind: ClassVar[str] = "chart"
    title: str  # what the chart shows, with what it says where nothing beside it does
    x: Axis
    y: Axis
    marks: tuple[Mark, ...]
    summary: str = ""  # for readers who cannot see it, and as its caption
    legend: bool = True
    height: int = 360  # on a page, pixels

    @property
    def axes(self) -> tuple[tuple[str, Axis], ...]:
        """The axes by their letters."""
        return ("x", self.x), ("y", self.y)


def thinned(time: Floats, values: Floats, budget: int) -> tuple[Floats, Floats]:
    """Return at most about `budget` points of a curve with the extremes of every part of it.

    `time`, `values` (P,): the curve.
    """
    size = -(-2 * len(time) // max(budget, 2))
    if size <= 2:
        return time, values
    whole = len(time) // size * size
    parts = values[:whole].reshape(-1, size)
    first = np.arange(0, whole, size)
    places = [first + parts.argmin(axis=1), first + parts.argmax(axis=1)]
    kept = np.unique(np.concatenate([[0], *places, [len(time) - 1]]))
    return time[kept], values[kept]


DECADES = 1e-4  # of the largest value on a logarithmic scale of colours: smaller ones are alike


def levels(mark: Grid, values: Floats) -> tuple[Floats, tuple[tuple[float, float], ...]]:
    """Return values as places from 0 to 1 on a scale of colours, and its labels: place and value.

    NaN has no place; without a finite value there are no labels.
    """
    known = values[np.isfinite(values)]
    if not len(known):
        return values, ()
    low, high = float(known.min()), float(known.max())
    along: Callable[[Any], Any] = np.asarray
    if mark.scale == "signed":
        high = max(abs(low), abs(high)) or 1.0
        low, along = -high, lambda value: np.sign(value) * np.sqrt(np.abs(value))
        shown = [share * abs(share) * high for share in (-1.0, -0.5, 0.0, 0.5, 1.0)]
    elif mark.scale == "log" and 0.0 < 10.0 * low <= high:
        low, along = max(low, high * DECADES), np.log
        shown = np.geomspace(low, high, 5).tolist()
    else:
        shown = np.linspace(low, high, 5).tolist()
    first, last = float(along(low)), float(along(high))

    def place(each: Any) -> Floats:
        found: Floats = (along(np.clip(each, low, high)) - first) / ((last - first) or 1.0)
        return found

    return place(values), tuple((float(place(each)), each) for each in shown)


def segments(
    ends: Sequence[tuple[tuple[float, float], tuple[float, float]]],
) -> tuple[Floats, Floats]:
    """Return separate straight lines as the points (P,) of one curve, with gaps between them."""
    gap = (math.nan, math.nan)
    points = np.array([[a, b, gap] for a, b in ends], dtype=np.float64).reshape(-1, 2)
    return points[:, 0], points[:, 1]


def zero_lines(x: Floats, y: Floats, values: Floats) -> Iterator[tuple[Any, Any]]:
    """Yield straight lines where values (m, n) over x (n,) and y (m,) pass through 0."""
    for k, n in itertools.product(range(len(y) - 1), range(len(x) - 1)):
        corners = [(k, n), (k, n + 1), (k + 1, n + 1), (k + 1, n)]
        found = []
        for (a, b), (c, d) in zip(corners, corners[1:] + corners[:1], strict=True):
            first, second = values[a, b], values[c, d]
            if first * second < 0.0:  # never for NaN
                share = first / (first - second)
                place = (x[b] + share * (x[d] - x[b]), y[a] + share * (y[c] - y[a]))
                found.append((float(place[0]), float(place[1])))
        yield from zip(found[::2], found[1::2], strict=False)  # an end at a gap has no other
