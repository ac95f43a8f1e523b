"""A sweep: maps over two axes, curves over one, small maps over three; points."""

from __future__ import annotations

import itertools
import math
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np

from taction.netlist_gen.scene import axes
from taction.netlist_gen.scene.keys import Value
from taction.netlist_gen.scene.scene import Scene
from taction.system.charts import OUTCOMES, Chart, looks_of
from taction.system.errors import Complaint, InputError
from taction.system.quantities import readable
from taction.system.reading_definitions import EXCURSIONS
from taction.verification.report.blocks import (
    DRAWN,
    NOTEBOOK,
    PICTURE,
    TERMINAL,
    Block,
    Cell,
    Facts,
    Notes,
    Page,
    Section,
    Table,
)
from taction.verification.report.texts import (
    LEAST_SHARE,
    banded,
    counted,
    number_cell,
    outcome_cell,
    quantity,
    spaced,
)
from taction.verification.report.views.origin import origin_section
from taction.verification.report.views.sweep_maps import (
    ENGINES,
    Names,
    Plane,
    band_of,
    curve_of,
    place_text,
)
from taction.verification.studies.sweep.plan import Plan
from taction.verification.studies.sweep.result import SweepResult, all_records, grids
from taction.verification.verdict.record import FIGURES

LISTED, LINES = 500, 40  # points in the table of a page, and of a terminal
MAPPED = 40_000  # points of the maps of a page
MOST_AXES = 3
MOST_MAPS = 6  # small maps beside each other
COLUMNS = ("settling_time", *EXCURSIONS, "growth_rate", "frequency")
SHOWN = ("settling_time", *EXCURSIONS, "steady_state_error", "growth_rate")


def columns_of(scene: Scene) -> tuple[str, ...]:
    """Return the figures in the table of a sweep: `COLUMNS`, and the noise if it has a limit."""
    return COLUMNS if scene.checks.noise is None else (*COLUMNS, "noise")


def view(result: SweepResult) -> Page:
    """Return what a sweep shows: the stored points of its plan."""
    plan, count, path = result.plan, result.count, result.store.path
    names = " x ".join(f"{each.name} ({len(each)})" for each in plan.axes)
    known = [name for name in OUTCOMES if count.outcomes.get(name)]
    outcomes = ", ".join(f"{count.outcomes[name]} {name}" for name in known)
    text = f"{plan.points} points are too many for this page; see --plot."
    many = (text,) if plan.points > MAPPED else ()
    foot = [f"{count.ran} computed now, {count.done - count.ran} from {path}"]
    if count.outcomes["error"]:
        foot.append("the same command computes the points without a verdict (error) again")
    return Page(
        title=plan.scene.name,
        command="taction sweep",
        summary=f"{count.done} of {count.total} points: {outcomes}.",
        lines=(f"Over {names}; engine: {ENGINES[plan.engine]}.", *map(readable, result.notes)),
        sections=(
            Section("Axes", (Facts("", tuple(_axes(plan))),), media=(NOTEBOOK,)),
            Section("Pictures", (Notes("", many),)),
            Section("Pictures", lambda: _charts(result), media=(PICTURE,) if many else DRAWN),
            Section("Points", lambda: _listed(result), media=(TERMINAL,)),
            Section("Points", lambda: (_points(result),)),
            origin_section(plan.scene, (("database", path),)),
        ),
        foot=tuple(foot),
    )


def check_axes(count: int, path: str | Path | None) -> None:
    """Refuse a picture of more than three axes, before any work is done, with `InputError`."""
    if count > MOST_AXES:
        text = f"{count} axes; a picture has at most three, --export writes all of them"
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


def _axes(plan: Plan) -> Iterator[tuple[str, str]]:
    for each in plan.axes:
        first, last = (place_text(each, each.values[k]) for k in (0, -1))
        ends = first if len(each) == 1 else f"{first} to {last}"
        yield each.name, f"{counted(len(each), 'value')}, {ends}"


def _worth(data: Mapping[str, Any]) -> tuple[list[str], tuple[str, ...]]:
    """Return the quantities with a chart, and what is to be said of the others."""
    empty = [name for name in SHOWN if not np.isfinite(data[name]).any()]
    shares = (name for name in SHOWN if name not in empty and FIGURES[name].unit == "step")
    little = [name for name in shares if np.nanmax(data[name]) < LEAST_SHARE]
    said = (("No value at any point", empty), ("Under 1 ppm of the step where it has one", little))
    lines = tuple(f"{what}: {', '.join(map(spaced, names))}." for what, names in said if names)
    return [name for name in SHOWN if name not in (*empty, *little)], lines


def _charts(result: SweepResult) -> Iterator[Block]:
    plan = result.plan
    if len(plan.groups) > MOST_AXES:
        text = f"{len(plan.groups)} axes: pictures have at most {MOST_AXES}; --export writes all."
        yield Notes("", (text,))
        return
    data, names = grids(result), result_names(result)
    lines: tuple[str, ...] = ()
    if len(plan.groups) == MOST_AXES:
        charts = _multiples(plan, data, names)
    else:
        shown, lines = _worth(data)
        charts = _one_or_two(plan, data, names, shown)
    for first in itertools.islice(charts, 1):
        yield replace(first, summary=f"{first.summary} Engine: {ENGINES[plan.engine]}.".strip())
    yield from charts
    yield Notes("", lines)


def _one_or_two(
    plan: Plan, data: dict[str, Any], names: Names, shown: Sequence[str]
) -> Iterator[Chart]:
    """Yield the outcome and the quantities over one or two axes."""
    looks = looks_of(names.ravel().tolist())
    if len(plan.groups) == 1:
        for name in shown:
            yield curve_of(plan, name, data, names, looks)
        return
    plane = Plane(plan, data["growth_rate"])
    yield plane.outcomes(names, looks)
    for name in shown:
        yield plane.quantity(name, data[name])


def _multiples(plan: Plan, data: dict[str, Any], names: Names) -> Iterator[Chart]:
    """Yield what fails and the settling time over two axes, for values of the third."""
    third, looks = plan.groups[2][0], looks_of(names.ravel().tolist())
    places = chosen_places(len(third))
    shared = data[SHOWN[0]][:, :, places]
    known = shared[np.isfinite(shared)]
    limits = (float(known.min()), float(known.max())) if len(known) else None
    for k in places:
        where = f" at {third.name} = {place_text(third, third.values[k])}"
        plane = Plane(plan, data["growth_rate"][:, :, k], where)
        yield plane.outcomes(names[:, :, k], looks)
        yield plane.quantity(SHOWN[0], data[SHOWN[0]][:, :, k], limits)


def chosen_places(count: int) -> list[int]:
    """Return the places of the values of the third axis that have a map: first, last, between."""
    places = np.linspace(0, count - 1, min(count, MOST_MAPS)).round()
    return [int(place) for place in np.unique(places)]


def _places(plan: Plan, values: Mapping[str, Value]) -> str:
    return ", ".join(f"{a.name} = {place_text(a, values[a.name])}" for a in plan.axes)


def _listed(result: SweepResult) -> Iterator[Block]:
    """Yield the points of a small sweep, else those without a verdict, and their reasons."""
    whole = result.count.total <= LINES
    wanted = (r for r in result.records() if whole or r["outcome"] == "error")
    shown = list(itertools.islice(wanted, LINES))
    yield _table(result.plan, "", shown).folded()
    yield Notes("", tuple(_reasons(result.plan, shown)))


def _reasons(plan: Plan, shown: Iterable[dict[str, Any]]) -> Iterator[str]:
    """Yield a line for each thing that is wrong at some points: how many, and the first of them.

    The values of all of them stand in the table; the reasons of points without a verdict do not,
    so each of these has its line.
    """
    alike: dict[tuple[str, str], list[dict[str, Any]]] = {}
    for record in shown:
        reason = record["reason"].split("\n")[0][:160]
        if reason:
            name = _name(record)
            kind = reason if record["outcome"] == "error" else ""
            alike.setdefault((name, kind), []).append({**record, "reason": reason})
    for (name, _), records in alike.items():
        first = records[0]
        place = f"{_places(plan, first['values'])}: {first['reason']}"
        yield place if len(records) == 1 else f"{len(records)} {name}, such as {place}"


def _points(result: SweepResult) -> Table:
    listed = list(itertools.islice(result.records(), LISTED))
    made = _table(result.plan, "Points", listed, why=True)
    more = result.count.total > LISTED
    return replace(made, note=f"The first {LISTED} points; --export writes all." * more)


def _table(plan: Plan, title: str, listed: Sequence[dict[str, Any]], *, why: bool = False) -> Table:
    columns: dict[str, Callable[[dict[str, Any]], Any]] = {
        each.name: partial(_value, where=each) for each in plan.axes
    }
    columns["outcome"] = lambda record: outcome_cell(record["outcome"])
    for name in columns_of(plan.scene):
        columns[banded(name, band_of(plan))] = partial(figure_cell, name=name)
    columns |= {"why": _why} if why else {}
    return replace(Table.of(title, listed, columns), heads=len(plan.axes))


def figure_cell(record: Mapping[str, Any], name: str) -> Cell:
    """Return a figure of a point."""
    return number_cell(record[name], FIGURES[name].unit)


def _why(record: dict[str, Any]) -> str:
    """Return the first line of the reason, with the check in words."""
    name, colon, rest = record["reason"].split("\n")[0].partition(":")
    return readable(f"{spaced(name) if name.isidentifier() else name}{colon}{rest}")


def _value(record: Mapping[str, Any], where: axes.SweepAxis) -> Cell:
    value = record["values"][where.name]
    if isinstance(value, int | float) and not isinstance(value, bool) and math.isfinite(value):
        return Cell(quantity(float(value), where.key.unit), float(value))
    return Cell(str(value))
