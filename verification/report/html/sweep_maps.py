"""Maps of a sweep over two axes: what fails where, each quantity, the stability boundary."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from itertools import cycle
from typing import Any

import numpy as np

from taction.netlist_gen.scene.axes import Axis
from taction.system.array_types import Floats
from taction.verification.report.html.blocks import Picture
from taction.verification.report.html.pictures import axis, log_axis, numbers, words
from taction.verification.report.html.texts import figure, quantity, titled
from taction.verification.report.sweep.maps import boundary_text
from taction.verification.studies.sweep.boundary import Boundary
from taction.verification.verdict.record import FIGURES

LOOKS = {
    "pass": ("--pass", "circle"),
    "fail: stability": ("--fail", "x"),
    "fail: settling time": ("#c4661f", "triangle-up"),
    "fail: overshoot": ("#8a7a2a", "diamond"),
    "fail: steady state": ("#b8574d", "cross"),
}
OTHERS = (("#a8628f", "triangle-down"), ("#c4661f", "star-square"), ("#8a7a2a", "hourglass"))
UNDECIDED = (("--unsure", "square-open"), ("--unsure", "diamond-open"), ("--unsure", "circle-open"))
BROKEN = (("--muted", "triangle-up-open"), ("--muted", "hexagon-open"))
Names = np.ndarray[Any, Any]


@dataclass(frozen=True, slots=True)
class Ruler:
    """One group of axes in a picture: places, and texts for values that are no numbers."""

    axis: Axis

    @property
    def is_number(self) -> bool:
        """Whether the values stand at their places; else they are categories."""
        return all(isinstance(v, int | float) and not isinstance(v, bool) for v in self.axis.values)

    @property
    def values(self) -> list[Any]:
        """The places; categories are texts."""
        return [v if self.is_number else str(v) for v in self.axis.values]

    @property
    def layout(self) -> dict[str, Any]:
        """The axis of the picture."""
        name = self.axis.name
        if not self.is_number:
            return axis(name, type="category")
        unit, values = self.axis.key.unit or " ", [float(value) for value in self.axis.values]
        if self.axis.scale == "log" and min(values) > 0.0:
            return log_axis(name, unit, values)
        return axis(name, unit)


@dataclass(frozen=True, slots=True)
class Plane:
    """The two axes of a map, its stability boundary, and where it is among other axes."""

    across: Ruler
    down: Ruler
    boundary: Boundary
    where: str = ""  # " at stray_capacitance = 1 pF"

    @property
    def lines(self) -> list[dict[str, Any]]:
        """The boundary as lines; across a category it is a mark, and categories are not joined."""
        ends: list[tuple[tuple[Any, Any], tuple[Any, Any]]] = list(self.boundary.segments)
        if not ends:
            for x, y in self.boundary.points:
                both = ((x, y - 0.5), (x, y + 0.5)) if self.across.is_number else None
                ends.append(both or ((x - 0.5, y), (x + 0.5, y)))
        look = {"color": "--ink", "width": 2.5}
        return [
            {"type": "line", "x0": a[0], "y0": a[1], "x1": b[0], "y1": b[1], "line": look}
            for a, b in ends
        ]

    @property
    def note(self) -> str:
        """What the line is, for the caption."""
        if self.boundary.unsolved:
            return f" No stability boundary: {self.boundary.unsolved}."
        if not self.lines:
            return " Stability does not change within this map."
        return f" {boundary_text(self.boundary).replace('black', 'Thick line')}."

    def layout(self) -> dict[str, Any]:
        """Return the axes with the boundary."""
        return {"xaxis": self.across.layout, "yaxis": self.down.layout, "shapes": self.lines}


def kinds(names: Sequence[str]) -> Iterator[tuple[str, str, str]]:
    """Yield the kinds of results that occur, with a colour and a mark each."""
    others = {"fail": cycle(OTHERS), "inconclusive": cycle(UNDECIDED), "error": cycle(BROKEN)}
    count = Counter(name for name in names if name)
    for outcome in ("pass", "fail", "inconclusive", "error"):
        for name, _ in count.most_common():
            if name.partition(":")[0] == outcome:
                look = LOOKS.get(name)
                yield (name, *(look or next(others[outcome])))


def outcome_map(plane: Plane, names: Names) -> Picture:
    """Return what each point says as marks, one for each check that fails first."""
    titles = [words(ruler.axis.name) for ruler in (plane.across, plane.down)]
    data = []
    for name, colour, symbol in kinds(names.ravel().tolist()):
        places = np.argwhere(names == name).tolist()
        data.append(
            {"type": "scatter", "mode": "markers", "name": words(name),
             "x": [plane.across.values[i] for i, _ in places],
             "y": [plane.down.values[k] for _, k in places],
             "marker": {"color": colour, "symbol": symbol, "size": 9},
             "hovertemplate": f"{words(name)}: {titles[0]} %{{x}}, {titles[1]} %{{y}}"
                              "<extra></extra>"}
        )  # fmt: skip
    summary = (
        "The result of every point. Of several checks that fail the first one is shown, stability"
        f" before all others.{plane.note}"
    )
    passing = int((names == "pass").sum())
    verb = "passes" if passing == 1 else "pass"
    result = f"{passing} of {int((names != '').sum())} points {verb}{plane.where}"
    spec = {"data": data, "layout": plane.layout() | {"showlegend": True}}
    return Picture("Outcome", spec, summary, 440, result=result)


def quantity_map(plane: Plane, name: str, values: Floats) -> Picture:
    """Return the values of a quantity as colours."""
    unit = FIGURES[name].unit
    shown = values.T
    signed = name == "growth_rate"
    levels, ticks = _levels(shown, signed=signed)
    texts = [[figure(each, unit) for each in row] for row in shown.tolist()]
    colours = [[0, "--map-low"], [1, "--map-high"]]
    if signed:
        colours = [[0, "--positive"], [0.5, "--neutral"], [1, "--negative"]]
    bar = {
        "thickness": 12, "tickvals": [place for place, _ in ticks],
        "ticktext": [figure(value, unit, 3) for _, value in ticks],
    }  # fmt: skip
    heat: dict[str, Any] = {
        "type": "heatmap", "x": plane.across.values, "y": plane.down.values, "customdata": texts,
        "z": [numbers(row) for row in levels], "colorscale": colours, "colorbar": bar,
        "hovertemplate": "%{x}, %{y}: %{customdata}<extra></extra>",
    }  # fmt: skip
    if signed:
        heat |= {"zmin": -1, "zmax": 1}
    look = (
        " Blue decays, orange grows." if signed else " The strongest colour is the largest value."
    )
    summary = (
        f"{titled(name)} over {plane.across.axis.name} and {plane.down.axis.name}.{look} Empty: no"
        f" value.{plane.note}"
    )
    spec = {"data": [heat], "layout": plane.layout()}
    result = f"{extent(values, unit)}{plane.where}"
    return Picture(titled(name), spec, summary, 400, result=result)


def extent(values: Floats, unit: str) -> str:
    """Return the smallest and the largest value in words."""
    known = values[np.isfinite(values)]
    if not len(known):
        return "no point has a value"
    low, high = (figure(float(end), unit, 3) for end in (known.min(), known.max()))
    return low if low == high else f"{low} to {high}"


def place_text(where: Axis, value: Any) -> str:
    """Return a value of an axis in words."""
    shown = quantity(value, where.key.unit) if isinstance(value, float) else str(value)
    return f"{where.name} = {shown}"


def _levels(values: Floats, *, signed: bool) -> tuple[Floats, list[tuple[float, float]]]:
    """Return the values on a scale for colours, and places with their values for its bar."""
    known = values[np.isfinite(values)]
    if not len(known):
        return values, []
    if signed:
        reach = float(np.abs(known).max()) or 1.0
        ticks = [(share, share * abs(share) * reach) for share in (-1.0, -0.5, 0.0, 0.5, 1.0)]
        return np.sign(values) * np.sqrt(np.abs(values) / reach), ticks
    low, high = float(known.min()), float(known.max())
    if low <= 0.0 or high < 10.0 * low:
        return values, [(v, v) for v in np.linspace(low, high, 5).tolist()]
    low = max(low, high * DECADES)
    shown = np.log10(np.maximum(values, low))
    return shown, [(float(np.log10(v)), v) for v in np.geomspace(low, high, 5).tolist()]


DECADES = 1e-4  # of the largest value: smaller ones have the lightest colour
