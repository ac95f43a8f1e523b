"""A sweep as records, as a JSON document and as a table."""

from __future__ import annotations

import itertools
import json
import math
from collections.abc import Iterator
from typing import Any

from rich.console import Console, RenderableType
from rich.markup import escape
from rich.text import Text

from netlist_gen.overrides.axes import Axis
from verification.report.tables import make_table, spaced, value_text
from verification.studies.figures import FIGURES
from verification.studies.sweep.plan import Plan, Requests
from verification.studies.sweep.run import SweepCounts
from verification.studies.sweep.store import Store

LINES = 40  # points in the table; of a larger sweep only those without a verdict
COLOUR = {"pass": "green", "fail": "red", "inconclusive": "yellow", "error": "magenta"}
COLUMNS = ("settling_time", "overshoot", "undershoot", "growth_rate", "frequency")


def records(plan: Plan, store: Store) -> Iterator[dict[str, Any]]:
    """Yield the record of every stored point of `plan`, in the order of the grid.

    ``values`` holds the values on the axes by name; `verification.studies.sweep.point` defines
    the other keys.
    """
    return (record for record in all_records(plan, store) if record is not None)


def all_records(plan: Plan, store: Store) -> Iterator[dict[str, Any] | None]:
    """Yield as `records` does, with None for a point that is not stored."""
    names = {axis.key.path: axis.name for axis in plan.axes}
    for point in Requests(plan):
        record = store.record_of(point.request)
        if record is None:
            yield None
            continue
        values = {names[path]: value for path, value in point.values.items()}
        pole = None
        if record["growth_rate"] is not None:
            pole = [record["growth_rate"], 2.0 * math.pi * record["frequency"]]
        yield {"values": values, **record, "engine": point.engine, "rightmost_pole": pole}


def document_parts(plan: Plan, store: Store, count: SweepCounts, seconds: float) -> Iterator[str]:
    """Yield the JSON document in pieces, since it may be larger than the memory."""
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


def print_sweep(plan: Plan, store: Store, count: SweepCounts, console: Console) -> None:
    """Print the outcomes, and the points if they are few, else the points without a verdict."""
    whole = count.total <= LINES
    listed = (r for r in records(plan, store) if whole or r["outcome"] == "error")
    if rows := [_row(plan, record) for record in itertools.islice(listed, LINES)]:
        titles = map(spaced, COLUMNS)
        names = [axis.name for axis in plan.axes]
        console.print(make_table((*names, "engine", "outcome", *titles, "why"), rows))
    outcomes = ", ".join(
        f"[{COLOUR[name]}]{count.outcomes[name]} {name}[/{COLOUR[name]}]"
        for name in COLOUR
        if name in count.outcomes
    )
    console.print(f"{count.done} points: {outcomes}")
    stored = count.done - count.ran
    console.print(f"{count.ran} computed now, {stored} from {escape(store.path)}")
    if count.outcomes["error"]:
        console.print("--retry failed computes the points without a verdict (error) again")


def _row(plan: Plan, record: dict[str, Any]) -> list[RenderableType]:
    return [
        *(value_text(record["values"][axis.name], axis.key.unit) for axis in plan.axes),
        record["engine"],
        Text(record["outcome"], style=COLOUR[record["outcome"]]),
        *(value_text(record[name], FIGURES[name].unit) for name in COLUMNS),
        escape(record["reason"].split("\n")[0][:160]),
    ]
