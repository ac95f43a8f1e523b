"""A sweep: maps over two axes, curves over one; points."""

from __future__ import annotations

import itertools
import math
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np

from taction.netlist_gen.scene import axes
from taction.netlist_gen.scene.scene import Scene
from taction.system import charts
from taction.system.array_types import Floats
from taction.system.errors import Complaint, InputError
from taction.system.plugins import OpenTable
from taction.system.quantities import banded, quantity, readable, spaced
from taction.system.reading_definitions import EXCURSIONS
from taction.verification.report.blocks import Content, Page, Section, Table
from taction.verification.report.texts import LEAST_SHARE, Cell, Column, fields, titled
from taction.verification.report.views.answer_view import origin_section
from taction.verification.studies.sweep import Plan, SweepResult, all_records, grids
from taction.verification.verdict.record import FIGURES

LOGARITHMIC = ("settling_time", "steady_state_error")
ENGINES = OpenTable(  # names of the engines for people
    "taction.engines", {"ngspice": "ngspice", "statespace": "state space"}, str, "title"
)
Names = np.ndarray[Any, Any]
Looks = Mapping[str, charts.Look]
OUTCOME = (
    "The result of every point. Of several checks that fail the first one is shown, stability"
    " before all others. A grey or empty cell has no value."
)
CROWD = 250.0  # points of a picture's length over which the marks of a map stand
STRONGEST = "The strongest colour is the largest value."
EDGE = (
    " Thick line: stability boundary, interpolated between the points; `taction onset` finds every"
    " crossing along an axis."
)
UNSTABLE = "unstable by its poles"


def place_text(where: axes.SweepAxis, value: Any) -> str:
    """Return a value of an axis as text."""
    return quantity(value, where.key.unit) if isinstance(value, float) else str(value)


def axis_of(where: axes.SweepAxis) -> tuple[charts.Axis, Floats]:
    """Return an axis of a chart and the places of its values; words stand one after the other."""
    if where.key.kind == "choice" or where.scale == "list":
        names = tuple(place_text(where, value) for value in where.values)
        return charts.Axis(where.name, scale="names", names=names), np.arange(float(len(names)))
    places = np.array([float(value) for value in where.values])
    log = where.scale == "log" and places.min() > 0.0
    return charts.Axis(where.name, where.key.unit, "log" if log else "linear"), places


def maps(
    plan: Plan, data: dict[str, Any], shown: Sequence[str], names: Names, looks: Looks
) -> Iterator[charts.Chart]:
    """Yield what each point over two axes says, then the `shown` quantities as colours.

    Each has the stability boundary, where the growth rates pass through 0, interpolated.
    """
    (x, across), (y, down) = (axis_of(group[0]) for group in plan.groups)
    ends, edge = list[Any](), list[charts.Mark]()
    if "names" not in (x.scale, y.scale):  # nothing lies between two values of a list
        ends = [*charts.zero_lines(across, down, data["growth_rate"].T)]
    if ends:
        edge = [charts.Curve(*charts.segments(ends), "", "ink", width=2.5, label="")]
    every = np.meshgrid(across, down, indexing="ij")
    size = float(np.clip(CROWD / max(names.shape), 2.0, 9.0))
    marks = *results(*every, names, looks, size), *edge
    yield charts.Chart("Outcome", x, y, marks, OUTCOME + EDGE * bool(edge), height=420)
    for name in shown:
        title, signed = titled(name, band_of(plan)), name == "growth_rate"
        scale: Any = "signed" if signed else "log" if name in LOGARITHMIC else "linear"
        colours = "Blue decays, orange grows." if signed else STRONGEST
        text = f"{title} over {x.title} and {y.title}. {colours} Empty: no value."
        mark = charts.Grid(across, down, data[name].T, FIGURES[name].unit, scale)
        yield charts.Chart(title, x, y, (mark, *edge), text + EDGE * bool(edge), height=420)


def band_of(plan: Plan) -> float | None:
    """Return the settling band of a sweep; None if it is swept."""
    swept = any(each.key.path == "checks.settling_time.band" for each in plan.axes)
    return None if swept else plan.scene.checks.settling_time.band


def curve_of(
    plan: Plan, name: str, data: dict[str, Any], names: Names, looks: Looks
) -> charts.Chart:
    """Return a quantity over one axis; the mark is the result of the point."""
    unit, values, band = FIGURES[name].unit, data[name], band_of(plan)
    x, places = axis_of(plan.groups[0][0])
    marks: list[charts.Mark] = list(_unstable(data["growth_rate"], places))
    if x.scale != "names":
        marks.append(charts.Curve(places, values, "", "muted", width=0.8, behind=True))
    marks += results(places, values, names, looks)
    known = np.abs(values[np.isfinite(values)])
    low, high = float(known.min(initial=np.inf)), float(known.max(initial=0.0))
    log = name != "growth_rate" and 0.0 < 10.0 * low < high
    limits = None
    if log and unit == "step":  # below `LEAST_SHARE` lies rounding
        limits = (max(low, LEAST_SHARE) * 0.8, high * 1.25)
    y = charts.Axis(banded(name, band), unit, "log" if log else "linear", limits)
    title = titled(name, band)
    summary = f"{title} over {x.title}; the mark is the result of the point."
    return charts.Chart(title, x, y, tuple(marks), summary)


def results(
    x: Floats, y: Floats, names: Names, looks: Looks, size: float = 7.0
) -> Iterator[charts.Curve]:
    """Yield the points of each result, by the names of their looks, in that look."""
    for name, look in looks.items():
        there = names == name
        if there.any():
            places = x[there], y[there]
            yield charts.Curve(*places, name, look.colour, "", look.mark, size=size)


def _unstable(growth: Floats, places: Floats) -> Iterator[charts.Band]:
    """Yield the parts of an axis whose points are unstable by their poles."""
    edges = [places[0], *0.5 * (places[1:] + places[:-1]), places[-1]]
    for grows, run in itertools.groupby(range(len(places)), key=(growth > 0.0).__getitem__):
        own = list(run)
        if grows:
            ends = float(edges[own[0]]), float(edges[own[-1] + 1])
            yield charts.Band(*ends, "x", UNSTABLE, "fail")


LISTED, LINES = 500, 40  # points in the table of a page, and of a terminal
MAPPED = 40_000  # points of the maps of a page
MOST_AXES = 2  # of a picture
COLUMNS = ("settling_time", *EXCURSIONS, "growth_rate", "frequency")
SHOWN = ("settling_time", *EXCURSIONS, "steady_state_error", "growth_rate")


def columns_of(scene: Scene) -> tuple[str, ...]:
    """Return the figures in the table of a sweep: `COLUMNS`, and the noise if it has a limit."""
    return COLUMNS if scene.checks.noise is None else (*COLUMNS, "noise")


def view(result: SweepResult) -> Page:
    """Return what a sweep shows: the stored points of its plan."""
    plan, counts, path = result.plan, result.outcomes, result.store.path
    names = " x ".join(f"{each.name} ({len(each)})" for each in plan.axes)
    known = [name for name in charts.OUTCOMES if counts.get(name)]
    outcomes = ", ".join(f"{counts[name]} {name}" for name in known)
    many = plan.points > MAPPED
    text = f"{plan.points} points are too many for this page; see --plot." * many
    foot = [f"{result.ran} computed now, {result.done - result.ran} from {path}"]
    if counts.get("error"):
        foot.append("the same command computes the points without a verdict (error) again")
    return Page(
        title=plan.scene.name,
        command="taction sweep",
        summary=f"{result.done} of {plan.points} points: {outcomes}.",
        lines=(f"Over {names}; engine: {ENGINES[plan.engine]}.",),
        sections=(
            Section("Pictures", text, media="page"),
            Section(
                "Pictures", lambda: _charts(result), media="picture" if many else "page picture"
            ),
            Section("Points", lambda: _listed(result), media="terminal"),
            Section("Points", lambda: _points(result), media="page"),
            origin_section(plan.scene, (("database", path),)),
        ),
        foot=tuple(foot),
    )


def check_axes(count: int, path: str | Path | None) -> None:
    """Refuse a picture of more than two axes, before any work is done, with `InputError`."""
    if count > MOST_AXES:
        text = f"{count} axes; a picture has at most two, --export writes all of them"
        raise InputError("--plot", Complaint("FILE", repr(path and str(path)), text))


def result_names(result: SweepResult) -> Names:
    """Return what each point says, as words over the grid.

    ``"pass"``, ``"fail: stability"``, ``"inconclusive: rise time"``, ``"error: TimedOut"``; empty
    for a point without a result. Of several checks the first one counts, stability before all.
    """
    found = [_name(record) if record else "" for record in all_records(result.plan, result.store)]
    return np.array(found, dtype=object).reshape(result.plan.shape)


def _name(record: dict[str, Any]) -> str:
    outcome: str = record["outcome"]
    if outcome == "error":
        return f"error: {record['failure']}"
    found = [check["name"] for check in record["checks"] if check["outcome"] == outcome]
    if outcome == "pass" or not found:
        return outcome
    return f"{outcome}: {spaced('stability' if 'stability' in found else found[0])}"


def _worth(data: Mapping[str, Any]) -> tuple[list[str], tuple[str, ...]]:
    """Return the quantities with a chart, and what is to be said of the others."""
    empty = [name for name in SHOWN if not np.isfinite(data[name]).any()]
    shares = (name for name in SHOWN if name not in empty and FIGURES[name].unit == "step")
    little = [name for name in shares if np.nanmax(data[name]) < LEAST_SHARE]
    said = (("No value at any point", empty), ("Under 1 ppm of the step where it has one", little))
    lines = tuple(f"{what}: {', '.join(map(spaced, names))}." for what, names in said if names)
    return [name for name in SHOWN if name not in (*empty, *little)], lines


def _charts(result: SweepResult) -> Iterator[Content]:
    plan = result.plan
    if len(plan.groups) > MOST_AXES:
        text = f"{len(plan.groups)} axes: pictures have at most {MOST_AXES}; --export writes all."
        yield text
        return
    data, names = grids(result), result_names(result)
    shown, lines = _worth(data)
    looks, first = charts.looks_of(names.ravel().tolist()), True
    drawn = (curve_of(plan, name, data, names, looks) for name in shown)
    for chart in drawn if len(plan.groups) == 1 else maps(plan, data, shown, names, looks):
        engine = f" Engine: {ENGINES[plan.engine]}." * first
        yield replace(chart, summary=f"{chart.summary}{engine}")
        first = False
    yield from lines


def _listed(result: SweepResult) -> Iterator[Content]:
    """Yield the points of a small sweep, else those without a verdict, and their reasons."""
    whole = result.plan.points <= LINES
    wanted = (r for r in result.records() if whole or r["outcome"] == "error")
    shown = list(itertools.islice(wanted, LINES))
    yield _table(result.plan, "", shown)
    yield from _reasons(result.plan, shown)


def _reasons(plan: Plan, shown: Iterable[dict[str, Any]]) -> Iterator[str]:
    """Yield a line for each thing that is wrong at some points: how many, and the first."""
    alike: dict[tuple[str, str], list[dict[str, Any]]] = {}
    for record in shown:
        if reason := record["reason"].split("\n")[0][:160]:
            kind = reason if record["outcome"] == "error" else ""
            alike.setdefault((_name(record), kind), []).append({**record, "reason": reason})
    for (name, _), (first, *others) in alike.items():
        places = (f"{a.name} = {place_text(a, first['values'][a.name])}" for a in plan.axes)
        place = f"{', '.join(places)}: {first['reason']}"
        yield f"{1 + len(others)} {name}, such as {place}" if others else place


def _points(result: SweepResult) -> Table:
    listed = list(itertools.islice(result.records(), LISTED))
    made = _table(result.plan, "Points", listed, why=True)
    more = result.plan.points > LISTED
    return replace(made, note=f"The first {LISTED} points; --export writes all." * more)


def _table(plan: Plan, title: str, listed: Sequence[dict[str, Any]], *, why: bool = False) -> Table:
    columns: dict[str, Column] = {each.name: partial(_value, where=each) for each in plan.axes}
    columns |= fields("outcome = outcome outcome")
    for name in columns_of(plan.scene):
        columns[banded(name, band_of(plan))] = f"{name} {FIGURES[name].unit or 'ratio'}"
    columns |= {"why": _why} if why else {}
    return replace(Table.of(title, listed, columns), heads=len(plan.axes))


def _why(record: dict[str, Any]) -> str:
    """Return the first line of the reason, with the check in words."""
    name, colon, rest = record["reason"].split("\n")[0].partition(":")
    return readable(f"{spaced(name) if name.isidentifier() else name}{colon}{rest}")


def _value(record: Mapping[str, Any], where: axes.SweepAxis) -> Cell:
    value = record["values"][where.name]
    if isinstance(value, int | float) and not isinstance(value, bool) and math.isfinite(value):
        return Cell(quantity(float(value), where.key.unit), float(value))
    return Cell(str(value))
