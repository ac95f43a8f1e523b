"""The report of a sweep: outcomes, maps or curves, and the points."""

from __future__ import annotations

import itertools
import math
from collections.abc import Iterator
from typing import Any

import numpy as np

from taction.netlist_gen.scene.axes import Axis
from taction.system.quantities import readable
from taction.system.reading_definitions import EXCURSIONS
from taction.verification.report.html.blocks import (
    Block,
    Cell,
    Facts,
    Notes,
    Picture,
    Report,
    Section,
    Table,
)
from taction.verification.report.html.pictures import OUTCOMES as LOOKS
from taction.verification.report.html.pictures import axis, log_axis, numbers, words
from taction.verification.report.html.sweep_maps import (
    Plane,
    Ruler,
    extent,
    kinds,
    outcome_map,
    place_text,
    quantity_map,
)
from taction.verification.report.html.texts import (
    LEAST_SHARE,
    figure,
    number_cell,
    quantity,
    titled,
)
from taction.verification.report.sweep.agreement import summarise
from taction.verification.report.sweep.document import columns_of
from taction.verification.report.sweep.files import grids
from taction.verification.report.sweep.panels import ENGINES, result_names
from taction.verification.report.sweep.plot import MOST_AXES, boundary_at, chosen_places
from taction.verification.report.sweep.records import records
from taction.verification.report.tables import spaced
from taction.verification.report.views.origin import origin_section
from taction.verification.studies.store import Store
from taction.verification.studies.sweep.boundary import solve_boundary
from taction.verification.studies.sweep.plan import Plan
from taction.verification.studies.sweep.run import SweepCounts
from taction.verification.verdict.record import FIGURES

LISTED = 500  # points in the table
FLAT, CLEAR = 0.01, 1.5  # of a curve: relative change, and height of the picture
MAPPED = 40_000  # points of a map
SHOWN = ("settling_time", *EXCURSIONS, "steady_state_error", "growth_rate")


def sweep_report(plan: Plan, store: Store, count: SweepCounts) -> Report:
    """Return the report of the stored points of a sweep."""
    outcomes = ", ".join(f"{count.outcomes[n]} {n}" for n in LOOKS if n in count.outcomes)
    axes = " x ".join(f"{each.name} ({len(each)})" for each in plan.axes)
    return Report(
        title=plan.scene.name,
        command="taction sweep",
        outcome="",
        summary=f"{count.done} of {count.total} points: {outcomes}.",
        lines=(f"Over {axes}; engines: {', '.join(map(ENGINES.__getitem__, plan.engines))}.",),
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
    if len(plan.groups) > MOST_AXES:
        text = f"{len(plan.groups)} axes: pictures have at most {MOST_AXES}; --export writes all."
        yield Notes("", (text,))
        return
    if plan.points > MAPPED:
        yield Notes("", (f"{plan.points} points are too many for this page; see --plot.",))
        return
    data, names = grids(plan, store), result_names(plan, store)
    growing = data["growth_rate"] > 0.0
    for name in EXCURSIONS:  # of a growing record: depends on its length
        data[name][growing] = np.nan
    rulers = [Ruler(group[0]) for group in plan.groups]
    if len(rulers) == MOST_AXES:
        yield from _multiples(plan, rulers, data, names)
        return
    shown, little = _worth(data)
    if len(rulers) == 2:
        plane = Plane(rulers[0], rulers[1], solve_boundary(plan))
        yield outcome_map(plane, names[..., -1])
        for name in shown:
            yield quantity_map(plane, name, data[name][..., -1])
    else:
        for name in shown:
            yield _curve(plan, rulers[0], name, data, names)
    if little:
        yield Notes("", (f"Under 1 ppm of the step at every point: {', '.join(little)}.",))


def _worth(data: dict[str, Any]) -> tuple[list[str], list[str]]:
    """Return the quantities with a picture, and those too small for one."""
    little = [
        name
        for name in SHOWN
        if FIGURES[name].unit == "step" and np.nanmax(data[name], initial=0.0) < LEAST_SHARE
    ]
    return [name for name in SHOWN if name not in little], [spaced(name) for name in little]


def _multiples(
    plan: Plan, rulers: list[Ruler], data: dict[str, Any], names: Any
) -> Iterator[Block]:
    """Yield what fails and the settling time over two axes, for values of the third."""
    across, down, third = rulers
    for k in chosen_places(len(third.axis)):
        where = f" at {place_text(third.axis, third.axis.values[k])}"
        plane = Plane(across, down, boundary_at(plan, k), where)
        yield outcome_map(plane, names[:, :, k, -1])
        yield quantity_map(plane, SHOWN[0], data[SHOWN[0]][:, :, k, -1])


def _curve(
    plan: Plan, ruler: Ruler, name: str, data: dict[str, Any], names: np.ndarray[Any, Any]
) -> Picture:
    unit, traces = FIGURES[name].unit, []
    factor = 100.0 if unit == "step" else 1.0
    for place, engine in enumerate(plan.engines):
        for kind, colour, symbol in kinds(names[..., place].ravel().tolist()):
            y = factor * np.where(names[..., place] == kind, data[name][..., place], np.nan)
            label = words(f"{kind}, {ENGINES[engine]}" if len(plan.engines) > 1 else kind)
            traces.append(
                {"type": "scatter", "mode": "markers", "name": label, "x": ruler.values,
                 "y": numbers(y), "marker": {
                     "color": colour, "symbol": symbol, "size": 10 - 4 * place},
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
        if unit == "step":
            least = 100.0 * LEAST_SHARE  # below lies rounding
            ends = max(factor * known.min(), least), factor * known.max()
            height |= {
                "tickformat": "~g",
                "range": [math.log10(e) + d for e, d in zip(ends, (-0.1, 0.1), strict=True)],
            }
    elif len(known) and known.max() - known.min() < FLAT * known.max():
        top = CLEAR * factor * float(np.nanmax(data[name]))  # else Plotly goes 1 up and 1 down
        height["range"] = sorted((0.0, top))
    layout = {"xaxis": ruler.layout, "yaxis": height, "showlegend": True}
    summary = f"{titled(name)} over {ruler.axis.name}; the mark is the result of the point."
    spec, result = {"data": traces, "layout": layout}, extent(data[name], unit)
    return Picture(titled(name), spec, summary, 320, result=result)


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
    several = ("engine",) if len(plan.engines) > 1 else ()
    titles = (*(a.name for a in plan.axes), *several, "outcome", *map(spaced, figures), "why")
    rows = tuple(
        (
            *(_value(record["values"][each.name], each) for each in plan.axes),
            *(Cell(ENGINES[record[name]]) for name in several),
            Cell(record["outcome"], None, record["outcome"]),
            *(number_cell(record[name], FIGURES[name].unit) for name in figures),
            Cell(_why(record)),
        )
        for record in listed
    )
    note = f"The first {LISTED} points; --export writes all." if count.total > LISTED else ""
    yield Table("Points", titles, rows, note)


def _why(record: dict[str, Any]) -> str:
    """Return the first line of the reason, with the check in words."""
    name, colon, rest = record["reason"].split("\n")[0].partition(":")
    return readable(f"{spaced(name) if name.isidentifier() else name}{colon}{rest}")


def _value(value: Any, where: Axis) -> Cell:
    if isinstance(value, int | float) and not isinstance(value, bool):
        return Cell(quantity(float(value), where.key.unit), float(value))
    return Cell(str(value))
