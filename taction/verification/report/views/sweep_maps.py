"""The charts of a sweep: outcomes and quantities over one axis, or as maps over two."""

from __future__ import annotations

import itertools
from collections.abc import Iterator
from typing import Any

import numpy as np

from taction.netlist_gen.scene import axes
from taction.netlist_gen.scene.axes import with_values
from taction.system.array_types import Floats
from taction.system.plugins import OpenTable
from taction.verification.report.charts import (
    OUTCOMES,
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
from taction.verification.report.texts import (
    LEAST_SHARE,
    banded,
    figure,
    quantity,
    titled,
)
from taction.verification.studies.sweep.boundary import Boundary, solve_boundary
from taction.verification.studies.sweep.plan import Plan
from taction.verification.verdict.record import FIGURES

MOST_MARKS = 2500  # points above which marks of the other engine would overlap
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


def boundary_at(plan: Plan, number: int) -> Boundary:
    """Solve the stability boundary at a value of the third axis, by its place."""
    changes = {axis.key.path: axis.values[number] for axis in plan.groups[2]}
    scene = with_values(plan.scene, changes)
    return solve_boundary(Plan(scene, plan.groups[:2], plan.engines))


class Plane:
    """The first two axes of a plan, and the stability boundary over them.

    Parameters
    ----------
    plan : Plan
        With two axes or more.
    boundary : Boundary
        Over the first two.
    where : str
        Where the plane is among other axes: ``" at stray_capacitance = 1 pF"``.
    growth : ndarray (n, m) or None
        Growth rates, 1/s, between which an unsolved boundary is interpolated.
    """

    def __init__(
        self, plan: Plan, boundary: Boundary, where: str = "", growth: Floats | None = None
    ) -> None:
        (self.x, self.across), (self.y, self.down) = (axis_of(g[0]) for g in plan.groups[:2])
        self.engines, self.boundary, self.where = plan.engines, boundary, where
        self.growth, self.band = growth, band_of(plan)

    @property
    def edge(self) -> Curve | None:
        """The boundary; across a category it is a mark, and categories are not joined."""
        ends: list[Any] = list(self.boundary.segments)
        if self.boundary.unsolved and self.growth is not None:
            ends = list(zero_lines(self.across, self.down, self.growth.T))
        elif not ends:
            for x, y in self.boundary.points:
                whole = ((x - 0.5, y), (x + 0.5, y))
                ends.append(whole if self.x.scale == "names" else ((x, y - 0.5), (x, y + 0.5)))
        return Curve(*segments(ends), "", "ink", width=2.5, label="") if ends else None

    @property
    def note(self) -> str:
        """What the thick line is, for the caption."""
        if self.boundary.unsolved:
            what = "No stability boundary" if self.edge is None else "Thick line: interpolated"
            return f" {what}, since {self.boundary.unsolved}."
        if self.edge is None:
            growth = np.full(1, np.nan) if self.growth is None else self.growth
            if (growth > 0.0).any() and (growth < 0.0).any():
                return (
                    " Stable at some points, unstable at others: no line is between listed values."
                )
            where = "within this map" if np.isfinite(growth).all() else "where it is known"
            return f" Stability does not change {where}."
        return (
            " Thick line: stability boundary, solved between the points (a pole crosses the"
            " imaginary axis)."
        )

    def outcomes(self, names: Names, looks: dict[str, Look]) -> Chart:
        """Return what each point says; `names` has the engine last."""
        last = names[..., -1].T
        marks: list[Mark] = [Cells(self.across, self.down, last, looks)]
        summary = (
            "The result of every point. Of several checks that fail the first one is shown,"
            f" stability before all others.{self.note}"
        )
        if len(self.engines) > 1 and last.size <= MOST_MARKS:
            marks += self._other(names[..., 0].T)
            own, other = (ENGINES[self.engines[k]] for k in (-1, 0))
            summary += f" Cells: verdicts of {own}; small marks: {other}."
        marks += [self.edge] if self.edge is not None else []
        passing, total = int((last == "pass").sum()), int((last != "").sum())
        verb = "passes" if passing == 1 else "pass"
        message = f"{passing} of {total} points {verb}{self.where}"
        return Chart("Outcome", self.x, self.y, tuple(marks), message, summary, (), "below", 440)

    def _other(self, names: Names) -> Iterator[Curve]:
        """Yield the outcomes of the first engine as marks on the cells."""
        engine = ENGINES[self.engines[0]]
        for outcome, look in OUTCOMES.items():
            there = np.array([[n.startswith(outcome) for n in row] for row in names], np.bool_)
            rows, columns = np.nonzero(there)
            if len(rows):
                x, y = self.across[columns], self.down[rows]
                yield Curve(x, y, f"{engine}: {outcome}", "ink", "", look.mark, size=4.0)

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
    for k, engine in enumerate(plan.engines):
        if x.scale != "names":
            marks.append(Curve(places, values[..., k], "", "muted", width=0.8, behind=True))
        for kind, look in looks.items():
            there = names[..., k] == kind
            if there.any():
                label = f"{kind}, {ENGINES[engine]}" if len(plan.engines) > 1 else kind
                hover = tuple(figure(v, unit) for v in values[..., k][there].tolist())
                marks.append(
                    Curve(places[there], values[..., k][there], label, look.colour, "", look.mark,
                          size=7.0 - 3.0 * k, hover=hover)
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
    grows = np.nanmax(growth, axis=-1, initial=-np.inf) > 0.0
    between = 0.5 * (places[1:] + places[:-1])
    edges = [places[0], *between, places[-1]]
    for _, run in itertools.groupby(enumerate(grows.tolist()), key=lambda pair: pair[1]):
        own = list(run)
        if own[0][1]:
            low, high = edges[own[0][0]], edges[own[-1][0] + 1]
            yield Band(float(low), float(high), "x", "unstable by its poles", "fail", hatched=True)
