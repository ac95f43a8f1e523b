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
            return (
                " Thick line: stability boundary, interpolated between the points; `taction onset`"
                " finds every crossing along an axis."
            )
        if (self.growth > 0.0).any() and (self.growth < 0.0).any():
            return " Stable at some points, unstable at others: no line is between listed values."
        where = "at every point" if np.isfinite(self.growth).all() else "where it is known"
        return f" Stability is the same {where}."

    def outcomes(self, names: Names, looks: dict[str, Look]) -> Chart:
        """Return what each point says."""
        marks: list[Mark] = [Cells(self.across, self.down, names.T, looks)]
        summary = (
            "The result of every point. Of several checks that fail the first one is shown,"
            f" stability before all others.{self.note} A grey or empty cell has no value."
        )
        marks += [self.edge] if self.edge is not None else []
        passing, total = int((names == "pass").sum()), int((names != "").sum())
        verb = "passes" if passing == 1 else "pass"
        message = f"{passing} of {total} points {verb}{self.where}"
        return Chart("Outcome", self.x, self.y, tuple(marks), message, summary, (), "below", 440)

    def quantity(
        self, name: str, values: Floats, limits: tuple[float, float] | None = None
    ) -> Chart:
        """Return the values (n, m) of a quantity as colours."""
        unit, signed = FIGURES[name].unit, name == "growth_rate"
        scale = "signed" if signed else "log" if name in LOGARITHMIC else "linear"
        heat = Grid(
            self.across, self.down, values.T, unit, scale,  # type: ignore[arg-type]
            limits=limits, warm="positive",
        )  # fmt: skip
        title = titled(name, self.band)
        colours = " The strongest colour is the largest value."
        if signed:
            colours = " Blue decays, orange grows."
        summary = (
            f"{title} over {self.x.title} and {self.y.title}.{colours} Empty: no value.{self.note}"
        )
        marks = (heat,) if self.edge is None else (heat, self.edge)
        message = f"{extent(values, unit)}{self.where}"
        return Chart(title, self.x, self.y, marks, message, summary, (), "", 400)


def band_of(plan: Plan) -> float | None:
    """Return the settling band of a sweep; None if it is swept."""
    swept = any(each.key.path == "checks.settling_time.band" for each in plan.axes)
    return None if swept else plan.scene.checks.settling_time.band


def extent(values: Floats, unit: str) -> str:
    """Return the smallest and the largest value in words."""
    known = values[np.isfinite(values)]
    if not len(known):
        return "no point has a value"
    low, high = (figure(float(end), unit, 3) for end in (known.min(), known.max()))
    return low if low == high else f"{low} to {high}"


def curve_of(
    plan: Plan, name: str, data: dict[str, Any], names: Names, looks: dict[str, Look]
) -> Chart:
    """Return a quantity over one axis; the mark is the result of the point."""
    unit, values = FIGURES[name].unit, data[name]
    x, places = axis_of(plan.groups[0][0])
    marks: list[Mark] = list(_unstable(data["growth_rate"], places))
    if x.scale != "names":
        marks.append(Curve(places, values, "", "muted", width=0.8, behind=True))
    for kind, look in looks.items():
        there = names == kind
        if there.any():
            hover = tuple(figure(v, unit) for v in values[there].tolist())
            marks.append(
                Curve(places[there], values[there], kind, look.colour, "", look.mark,
                      size=7.0, hover=hover)
            )  # fmt: skip
    known = np.abs(values[np.isfinite(values)])
    wide = len(known) and known.min() > 0.0 and known.max() > 10.0 * known.min()
    log = wide and name != "growth_rate"
    limits = None
    if log and unit == "step":  # below `LEAST_SHARE` lies rounding
        limits = (max(float(known.min()), LEAST_SHARE) * 0.8, float(known.max()) * 1.25)
    title = titled(name, band_of(plan))
    y = Axis(banded(name, band_of(plan)), unit, "log" if log else "linear", limits)
    summary = f"{title} over {x.title}; the mark is the result of the point."
    return Chart(
        title, x, y, tuple(marks), extent(values, unit), summary, (), "beside", 340
    )  # fmt: skip


def _unstable(growth: Floats, places: Floats) -> Iterator[Band]:
    """Yield the parts of an axis whose points are unstable by their poles."""
    grows = growth > 0.0
    between = 0.5 * (places[1:] + places[:-1])
    edges = [places[0], *between, places[-1]]
    for _, run in itertools.groupby(enumerate(grows.tolist()), key=lambda pair: pair[1]):
        own = list(run)
        if own[0][1]:
            low, high = edges[own[0][0]], edges[own[-1][0] + 1]
            yield Band(float(low), float(high), "x", "unstable by its poles", "fail", hatched=True)
