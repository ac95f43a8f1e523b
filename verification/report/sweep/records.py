"""A sweep as records, as a JSON document and as a table."""

from __future__ import annotations

import json
import math
from collections.abc import Iterator
from typing import Any

from rich.box import SIMPLE_HEAD
from rich.console import Console
from rich.markup import escape
from rich.table import Table
from rich.text import Text

from netlist_gen.overrides.axes import Axis
from netlist_gen.quantities import show
from verification.studies.figures import FIGURES
from verification.studies.sweep.plan import Plan, Requests
from verification.studies.sweep.run import Count
from verification.studies.sweep.store import Store

LINES = 40  # of points that are listed; of more, only those without a verdict
COLOUR = {"pass": "green", "fail": "red", "inconclusive": "yellow", "error": "magenta"}
COLUMNS = ("settling_time", "overshoot", "growth_rate", "frequency")


def records(plan: Plan, store: Store) -> Iterator[dict[str, Any]]:
    """Every point of `plan` that is stored, in the order of the grid, one record each.

    ``values`` holds what was changed, by the names that the axes have; the rest is as
    `verification.studies.sweep.point` has it.
    """
    return (record for record in all_records(plan, store) if record is not None)


def all_records(plan: Plan, store: Store) -> Iterator[dict[str, Any] | None]:
    """As `records`, with None in the place of a point that is not stored."""
    names = {axis.key.path: axis.name for axis in plan.axes}
    for point in Requests(plan):
        row = store.row(point.request)
        if row is None:
            yield None
            continue
        values = {names[path]: value for path, value in point.values.items()}
        pole = None
        if row.record["growth_rate"] is not None:
            pole = [row.record["growth_rate"], 2.0 * math.pi * row.record["frequency"]]
        yield {"values": values, **row.record, "engine": point.engine, "rightmost_pole": pole}


def document_parts(plan: Plan, store: Store, count: Count, seconds: float) -> Iterator[str]:
    """Yield the JSON document in pieces: it may be larger than the memory."""
    head = {
        "scene": plan.scene.name,
        "file": str(plan.scene.file),
        "database": store.path,
        "axes": [axis_record(axis, k) for k, group in enumerate(plan.groups) for axis in group],
        "engines": list(plan.engines),
        "total": count.total,
        "done": count.done,
        "ran": count.ran,
        "outcomes": dict(count.outcomes),
        "seconds": seconds,
    }
    yield json.dumps(head, indent=2, ensure_ascii=False, allow_nan=False)[:-2]
    yield ',\n  "points": ['
    between = "\n    "
    for record in records(plan, store):
        yield between + json.dumps(record, ensure_ascii=False, allow_nan=False)
        between = ",\n    "
    yield "\n  ]\n}\n"


def axis_record(axis: Axis, group: int) -> dict[str, Any]:
    """Return an axis as plain data; axes of the same `group` change together."""
    return {
        "name": axis.name,
        "key": axis.key.path,
        "unit": axis.key.unit,
        "scale": axis.scale,
        "group": group,
        "values": list(axis.values),
    }


def print_sweep(plan: Plan, store: Store, count: Count, console: Console) -> None:
    """Print the outcomes, and the points where they are few, else those without a verdict."""
    listed = list(_listed(plan, store, whole=count.total <= LINES))
    if listed:
        console.print(_table(plan, listed))
    outcomes = ", ".join(
        f"[{COLOUR[name]}]{number} {name}[/{COLOUR[name]}]"
        for name, number in sorted(
            count.outcomes.items(), key=lambda item: list(COLOUR).index(item[0])
        )
    )
    console.print(f"{count.done} points: {outcomes}")
    stored = count.done - count.ran
    console.print(f"{count.ran} computed now, {stored} from {escape(store.path)}")
    if count.outcomes["error"]:
        console.print("--retry failed computes those again that reached no verdict (error)")


def _listed(plan: Plan, store: Store, *, whole: bool) -> Iterator[dict[str, Any]]:
    left = LINES
    for record in records(plan, store):
        if left and (whole or record["outcome"] == "error"):
            left -= not whole
            yield record


def _table(plan: Plan, listed: list[dict[str, Any]]) -> Table:
    names = [axis.name for axis in plan.axes]
    titles = [name.replace("_", " ") for name in COLUMNS]
    table = Table(*names, "engine", "outcome", *titles, "why", box=SIMPLE_HEAD, pad_edge=False)
    units = {axis.name: axis.key.unit for axis in plan.axes}
    for record in listed:
        table.add_row(
            *(_amount(record["values"][name], units[name]) for name in names),
            record["engine"],
            Text(record["outcome"], style=COLOUR[record["outcome"]]),
            *(_amount(record[name], FIGURES[name].unit) for name in COLUMNS),
            escape(record["reason"].split("\n")[0][:160]),
        )
    return table


def _amount(value: object, unit: str) -> str:
    if not isinstance(value, float):
        return "-" if value is None else str(value)
    if unit == "step":
        return f"{100 * value:.3g} %"
    return show(value, unit) if unit in ("s", "Hz", "F", "ohm", "S", "V") else f"{value:.4g}"
