"""The report of a sweep: outcomes, maps or curves, and the points."""

from __future__ import annotations

import itertools
from collections.abc import Iterator
from dataclasses import dataclass
from typing import Any

import numpy as np

from netlist_gen.overrides.axes import Axis
from spice_models.array_types import Floats
from verification.report.html.blocks import (
    Block,
    Cell,
    Facts,
    Notes,
    Picture,
    Report,
    Section,
    Table,
)
from verification.report.html.pictures import OUTCOMES as LOOKS
from verification.report.html.pictures import axis, log_axis, numbers, words
from verification.report.html.sections.origin import origin_section
from verification.report.html.texts import figure, number_cell, quantity, readable
from verification.report.sweep.agreement import summarise
from verification.report.sweep.document import columns_of
from verification.report.sweep.files import OUTCOMES, grids
from verification.report.sweep.records import records
from verification.report.tables import spaced
from verification.studies.figures import FIGURES
from verification.studies.sweep.plan import Plan
from verification.studies.sweep.run import SweepCounts
from verification.studies.sweep.store import Store

LISTED = 500  # points in the table
MAPPED = 40_000  # points of a map
SHOWN = ("settling_time", "overshoot", "undershoot", "steady_state_error", "growth_rate")


@dataclass(frozen=True, slots=True)
class _Ruler:
    """One group of axes in a picture: places, and texts for values that are no numbers."""

    axis: Axis

    @property
    def is_number(self) -> bool:
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


def sweep_report(plan: Plan, store: Store, count: SweepCounts) -> Report:
    """Return the report of the stored points of a sweep."""
    outcomes = ", ".join(f"{count.outcomes[n]} {n}" for n in LOOKS if n in count.outcomes)
    axes = " x ".join(f"{each.name} ({len(each)})" for each in plan.axes)
    return Report(
        title=plan.scene.name,
        command="taction sweep",
        outcome="",
        summary=f"{count.done} of {count.total} points: {outcomes}.",
        lines=(f"Over {axes}; engines: {', '.join(plan.engines)}.",),
        sections=tuple(
            section
            for section in (
                Section("Pictures", tuple(_pictures(plan, store))),
                Section("Engines", tuple(_engines(plan, store))),
                Section("Points", tuple(_points(plan, store, count))),
                origin_section(plan.scene, (("database", store.path),)),
            )
            if section.blocks
        ),
    )


def _pictures(plan: Plan, store: Store) -> Iterator[Block]:
    if len(plan.groups) > 2:
        text = f"{len(plan.groups)} axes: pictures have one or two; --export writes all points."
        yield Notes("", (text,))
        return
    if plan.points > MAPPED:
        yield Notes("", (f"{plan.points} points are too many for this page; see --plot.",))
        return
    data = grids(plan, store)
    growing = data["growth_rate"] > 0.0
    for name in ("overshoot", "undershoot"):  # of a growing record: depends on its length
        data[name][growing] = np.nan
    rulers = [_Ruler(group[0]) for group in plan.groups]
    if len(rulers) == 2:
        yield _outcome_map(rulers, data["outcome"][..., -1])
        for name in SHOWN:
            yield _map(rulers, name, data[name][..., -1])
        return
    for name in SHOWN:
        yield _curve(plan, rulers[0], name, data)


def _outcome_map(rulers: list[_Ruler], codes: Any) -> Picture:
    """Return the outcomes as marks: circle, cross, square and triangle."""
    across, down = rulers
    names = [words(ruler.axis.name) for ruler in rulers]
    data = []
    for name, (colour, symbol) in LOOKS.items():
        places = np.argwhere(codes == OUTCOMES.index(name)).tolist()
        if places:
            data.append(
                {"type": "scatter", "mode": "markers", "name": name,
                 "x": [across.values[i] for i, _ in places],
                 "y": [down.values[k] for _, k in places],
                 "marker": {"color": colour, "symbol": symbol, "size": 9},
                 "hovertemplate": f"{name}: {names[0]} %{{x}}, {names[1]} %{{y}}<extra></extra>"}
            )  # fmt: skip
    layout = {"xaxis": across.layout, "yaxis": down.layout, "showlegend": True}
    summary = "Outcome of every point: circles pass, crosses fail, squares are inconclusive."
    return Picture("Outcome", {"data": data, "layout": layout}, summary, 420)


def _map(rulers: list[_Ruler], name: str, values: Floats) -> Picture:
    across, down = rulers
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
        "type": "heatmap", "x": across.values, "y": down.values, "customdata": texts,
        "z": [numbers(row) for row in levels], "colorscale": colours, "colorbar": bar,
        "hovertemplate": "%{x}, %{y}: %{customdata}<extra></extra>",
    }  # fmt: skip
    if signed:
        heat |= {"zmin": -1, "zmax": 1}
    layout = {"xaxis": across.layout, "yaxis": down.layout}
    more = (
        " Blue decays, orange grows." if signed else " The strongest colour is the largest value."
    )
    summary = f"{spaced(name)} over {across.axis.name} and {down.axis.name}.{more} Empty: no value."
    return Picture(spaced(name), {"data": [heat], "layout": layout}, summary, 400)


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
    return np.log10(values), [(float(np.log10(v)), v) for v in np.geomspace(low, high, 5).tolist()]


def _curve(plan: Plan, ruler: _Ruler, name: str, data: dict[str, Any]) -> Picture:
    unit, traces = FIGURES[name].unit, []
    factor = 100.0 if unit == "step" else 1.0
    for place, engine in enumerate(plan.engines):
        codes = data["outcome"][..., place]
        for outcome, (colour, symbol) in LOOKS.items():
            chosen = codes == OUTCOMES.index(outcome)
            if not np.any(chosen):
                continue
            y = factor * np.where(chosen, data[name][..., place], np.nan)
            label = f"{outcome}, {engine}" if len(plan.engines) > 1 else outcome
            traces.append(
                {"type": "scatter", "mode": "markers", "name": label, "x": ruler.values,
                 "y": numbers(y), "marker": {
                     "color": colour, "symbol": symbol, "size": 9 - 3 * place},
                 "text": [figure(v, unit) for v in (y / factor).tolist()],
                 "hovertemplate": f"%{{x}}: %{{text}}<extra>{label}</extra>"}
            )  # fmt: skip
    known = np.abs(data[name][np.isfinite(data[name])])
    spread = len(known) and known.min() > 0.0 and known.max() > 10.0 * known.min()
    title = f"{spaced(name)} (% of the step)" if unit == "step" else spaced(name)
    shown = {"s": "s", "1/s": "/s"}.get(unit, "")
    height = axis(title, shown)
    if spread and name != "growth_rate":
        height = log_axis(title, shown, factor * known)
    layout = {"xaxis": ruler.layout, "yaxis": height, "showlegend": True}
    summary = f"{spaced(name)} over {ruler.axis.name}; the mark is the outcome of the point."
    return Picture(spaced(name), {"data": traces, "layout": layout}, summary, 320)


def _engines(plan: Plan, store: Store) -> Iterator[Block]:
    if len(plan.engines) < 2:
        return
    found = summarise(plan, store)
    rows = (
        ("points with both engines", str(found.points)),
        ("agree", str(found.agree)),
        ("disagree", str(found.disagree)),
        ("undecided", str(found.undecided)),
        ("largest difference, of the allowed error", figure(found.largest_difference, "")),
    )
    yield Facts("", rows)


def _points(plan: Plan, store: Store, count: SweepCounts) -> Iterator[Block]:
    listed = list(itertools.islice(records(plan, store), LISTED))
    figures = columns_of(plan.scene)
    titles = (*(a.name for a in plan.axes), "engine", "outcome", *map(spaced, figures), "why")
    rows = tuple(
        (
            *(_value(record["values"][each.name], each) for each in plan.axes),
            Cell(record["engine"]),
            Cell(record["outcome"], None, record["outcome"]),
            *(number_cell(record[name], FIGURES[name].unit) for name in figures),
            Cell(readable(record["reason"].split("\n")[0])),
        )
        for record in listed
    )
    note = f"The first {LISTED} points; --export writes all." if count.total > LISTED else ""
    yield Table("Points", titles, rows, note)


def _value(value: Any, where: Axis) -> Cell:
    if isinstance(value, int | float) and not isinstance(value, bool):
        return Cell(quantity(float(value), where.key.unit), float(value))
    return Cell(str(value))
