"""A sweep as a JSON document and as a table."""

from __future__ import annotations

import itertools
import json
from collections.abc import Iterator
from dataclasses import asdict
from typing import Any

from rich.console import Console
from rich.markup import escape
from rich.text import Text

from taction.netlist_gen.scene.axes import Axis
from taction.netlist_gen.scene.scene import Scene
from taction.system.reading_definitions import EXCURSIONS, READINGS
from taction.verification.report import tables
from taction.verification.report.schemas.head import document_head
from taction.verification.report.sweep.agreement import print_summary, summarise
from taction.verification.report.sweep.records import records
from taction.verification.studies.store import Store
from taction.verification.studies.sweep.plan import Plan
from taction.verification.studies.sweep.run import SweepCounts
from taction.verification.verdict.record import FIGURES

LINES = 40  # points in the table; of a larger sweep only those without a verdict
COLOUR = {"pass": "green", "fail": "red", "inconclusive": "yellow", "error": "magenta"}
COLUMNS = ("settling_time", *EXCURSIONS, "growth_rate", "frequency")
TITLES = {name: READINGS[name].short for name in EXCURSIONS}


def columns_of(scene: Scene) -> tuple[str, ...]:
    """Return the figures in the table of a sweep: `COLUMNS`, and the noise if it has a limit."""
    return COLUMNS if scene.checks.noise is None else (*COLUMNS, "noise")


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
        "agreement": asdict(summarise(plan, store)) if len(plan.engines) > 1 else None,
        "seconds": seconds,
        "estimated_seconds": count.estimate,
    }
    units = document_head(
        "sweep", {**head, "points": list(itertools.islice(records(plan, store), 1))}
    )
    yield json.dumps(units | head, indent=2, ensure_ascii=False, allow_nan=False)[:-2]
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
    if shown := list(itertools.islice(listed, LINES)):
        names = [axis.name for axis in plan.axes]
        titles = [TITLES.get(name, tables.spaced(name)) for name in columns_of(plan.scene)]
        rows = (_row(plan, record) for record in shown)
        columns = tables.whole(*names, "engine", "outcome", *titles)
        console.print(tables.make_table(columns, rows, padding=(0, 1, 0, 0)))
    for record in shown:
        if reason := record["reason"].split("\n")[0][:160]:
            console.print(Text(f"{_place(plan, record)}: {reason}"))
    outcomes = ", ".join(
        f"[{COLOUR[name]}]{count.outcomes[name]} {name}[/{COLOUR[name]}]"
        for name in COLOUR
        if name in count.outcomes
    )
    console.print(f"{count.done} points: {outcomes}")
    stored = count.done - count.ran
    console.print(f"{count.ran} computed now, {stored} from {escape(store.path)}")
    if len(plan.engines) > 1:
        print_summary(plan, summarise(plan, store), console)
    if count.outcomes["error"]:
        console.print("--retry failed computes the points without a verdict (error) again")


def _place(plan: Plan, record: dict[str, Any]) -> str:
    values = record["values"]
    texts = (f"{a.name} = {tables.value_text(values[a.name], a.key.unit)}" for a in plan.axes)
    return f"{', '.join(texts)}, {record['engine']}"


def _row(plan: Plan, record: dict[str, Any]) -> list[str | Text]:
    return [
        *(tables.value_text(record["values"][axis.name], axis.key.unit) for axis in plan.axes),
        record["engine"],
        Text(record["outcome"], style=COLOUR[record["outcome"]]),
        *(tables.value_text(record[name], FIGURES[name].unit) for name in columns_of(plan.scene)),
    ]
