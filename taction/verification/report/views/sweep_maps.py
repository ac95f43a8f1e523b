"""The charts of a sweep: outcomes and quantities over one axis, or as maps over two."""

from __future__ import annotations

import itertools
from collections.abc import Iterator
from typing import Any

import numpy as np

from taction.netlist_gen.scene import axes
from taction.system.array_types import Floats
from taction.system.charts import (
    Axis,
    Band,
    Cells,
    Chart,
    Curve,
    Grid,
    Look,
    Mark,
    segments,
    zero_lines,
)
from taction.system.plugins import OpenTable
from taction.verification.report.texts import LEAST_SHARE, banded, figure, quantity, titled
from taction.verification.studies.sweep.plan import Plan
from taction.verification.verdict.record import FIGURES

LOGARITHMIC = ("settling_time", "steady_state_error")
ENGINES = OpenTable(
    "taction.engines", {"ngspice": "ngspice", "statespace": "state space"}, str, "title"
)
"""Names of the engines for people."""
Names = np.ndarray[Any, Any]
OUTCOME = (
    "The result of every point. Of several checks that fail the first one is shown, stability"
    " before all others.{} A grey or empty cell has no value."
)
EDGE = (
    " Thick line: stability boundary, interpolated between the points; `taction onset` finds every"
    " crossing along an axis."
)
UNSTABLE = "unstable by its poles"


def place_text(where: axes.SweepAxis, value: Any) -> str:
    """Return a value of an axis as text."""
    return quantity(value, where.key.unit) if isinstance(value, float) else str(value)


def axis_of(where: axes.SweepAxis) -> tuple[Axis, Floats]:
    """Return an axis of a chart and the places of its values; words stand one after the other."""
    if where.key.kind == "choice" or where.scale == "list":
        names = tuple(place_text(where, value) for value in where.values)
        return Axis(where.name, scale="names", names=names), np.arange(float(len(names)))
    places = np.array([float(value) for value in where.values])
    log = where.scale == "log" and places.min() > 0.0
    return Axis(where.name, where.key.unit, "log" if log else "linear"), places


class Plane:
    """The first two axes of a plan, and the stability boundary over them.

    It is where the growth rates (n, m), 1/s, pass through 0, interpolated; `where` says where the
    plane is among other axes: ``" at stray_capacitance = 1 pF"``.
    """

    def __init__(self, plan: Plan, growth: Floats, where: str = "") -> None:
        (self.x, self.across), (self.y, self.down) = (axis_of(g[0]) for g in plan.groups[:2])
        self.growth, self.where, self.band = growth, where, band_of(plan)

    @property
    def edge(self) -> Curve | None:
        """The boundary; nothing lies between two values of a list."""
        if "names" in (self.x.scale, self.y.scale):
            return None
        ends: list[Any] = list(zero_lines(self.across, self.down, self.growth.T))
        return Curve(*segments(ends), "", "ink", width=2.5, label="") if ends else None

    @property
    def note(self) -> str:
        """Where the board is stable, for the caption."""
        if self.edge is not None:
            return EDGE
        if (self.growth > 0.0).any() and (self.growth < 0.0).any():
            return " Stable at some points, unstable at others: no line is between listed values."
        where = "at every point" if np.isfinite(self.growth).all() else "where it is known"
        return f" Stability is the same {where}."

    def chart(self, title: str, mark: Mark, message: str, summary: str) -> Chart:
        """Return a chart of the plane with its boundary."""
        marks = (mark,) if self.edge is None else (mark, self.edge)
        message = f"{message}{self.where}"
        return Chart(title, self.x, self.y, marks, message, summary, legend="below", height=420)

    def outcomes(self, names: Names, looks: dict[str, Look]) -> Chart:
        """Return what each point says."""
        passing, total = int((names == "pass").sum()), int((names != "").sum())
        text = f"{passing} of {total} points {'passes' if passing == 1 else 'pass'}"
        cells = Cells(self.across, self.down, names.T, looks)
        return self.chart("Outcome", cells, text, OUTCOME.format(self.note))

    def quantity(
        self, name: str, values: Floats, limits: tuple[float, float] | None = None
    ) -> Chart:
        """Return the values (n, m) of a quantity as colours."""
        unit, title, signed = FIGURES[name].unit, titled(name, self.band), name == "growth_rate"
        scale: Any = "signed" if signed else "log" if name in LOGARITHMIC else "linear"
        heat = Grid(self.across, self.down, values.T, unit, scale, limits=limits, warm="positive")
        colours = " The strongest colour is the largest value."
        if signed:
            colours = " Blue decays, orange grows."
        text = f"{title} over {self.x.title} and {self.y.title}.{colours}"
        return self.chart(title, heat, extent(values, unit), f"{text} Empty: no value.{self.note}")


def band_of(plan: Plan) -> float | None:
    """Return the settling band of a sweep; None if it is swept."""
    swept = any(each.key.path == "checks.settling_time.band" for each in plan.axes)
    return None if swept else plan.scene.checks.settling_time.band


def extent(values: Floats, unit: str) -> str:
    """Return the smallest and the largest value in words."""
    known = values[np.isfinite(values)]
    if not len(known):
        return "no point has a value"
    return " to ".join(dict.fromkeys(figure(float(v), unit, 3) for v in (known.min(), known.max())))


def curve_of(
    plan: Plan, name: str, data: dict[str, Any], names: Names, looks: dict[str, Look]
) -> Chart:
    """Return a quantity over one axis; the mark is the result of the point."""
    unit, values, band = FIGURES[name].unit, data[name], band_of(plan)
    x, places = axis_of(plan.groups[0][0])
    marks: list[Mark] = list(_unstable(data["growth_rate"], places))
    if x.scale != "names":
        marks.append(Curve(places, values, "", "muted", width=0.8, behind=True))
    for kind, look in looks.items():
        there, shade = names == kind, look.colour
        if there.any():
            hover = tuple(figure(v, unit) for v in values[there].tolist())
            own = places[there], values[there], kind, shade
            marks.append(Curve(*own, line="", mark=look.mark, size=7.0, hover=hover))
    known = np.abs(values[np.isfinite(values)])
    low, high = float(known.min(initial=np.inf)), float(known.max(initial=0.0))
    log = name != "growth_rate" and 0.0 < 10.0 * low < high
    limits = None
    if log and unit == "step":  # below `LEAST_SHARE` lies rounding
        limits = (max(low, LEAST_SHARE) * 0.8, high * 1.25)
    y = Axis(banded(name, band), unit, "log" if log else "linear", limits)
    title, said = titled(name, band), extent(values, unit)
    summary = f"{title} over {x.title}; the mark is the result of the point."
    return Chart(title, x, y, tuple(marks), said, summary, legend="beside")


def _unstable(growth: Floats, places: Floats) -> Iterator[Band]:
    """Yield the parts of an axis whose points are unstable by their poles."""
    edges = [places[0], *0.5 * (places[1:] + places[:-1]), places[-1]]
    for grows, run in itertools.groupby(range(len(places)), key=(growth > 0.0).__getitem__):
        own = list(run)
        if grows:
            ends = float(edges[own[0]]), float(edges[own[-1] + 1])
            yield Band(*ends, "x", UNSTABLE, "fail", hatched=True)
