"""Sweeps with stored records instead of verifications."""

from __future__ import annotations

from dataclasses import fields, replace
from typing import Any

from taction.netlist_gen.scene.axes import parse_axes
from taction.system.reading_definitions import READINGS
from taction.verification.studies.running.store import Store
from taction.verification.studies.sweep.plan import Plan, grid_points
from taction.verification.studies.tolerance.varied_board import BoardSample
from taction.verification.verdict.checks import Check, Outcome
from taction.verification.verdict.record import FIGURES, Figure, Record
from tests.support.studying import small_scene


def grid_plan(*over: str) -> Plan:
    scene = small_scene()
    return Plan(scene, parse_axes(scene, over), "statespace")


def make_record(engine: str = "statespace", **changes: Any) -> Record:
    """A record that passes; `changes` are figures, readings of `reading`, and other fields."""
    names = {field.name for field in fields(Record)}
    figures: dict[str, float | None] = dict.fromkeys(FIGURES, 1.0)
    figures |= {"wanted_error": 2.5e-4, "attained_error": 1e-4}
    bounds: dict[str, float | None] = dict.fromkeys((*READINGS, "end_error"), 1e-3)
    others: dict[str, float] = {}
    for name, value in changes.items():
        if isinstance(value, Figure):
            figures[name], bounds[name] = value.value, value.uncertainty
            others |= {} if value.alternative is None else {name: value.alternative}
        elif name not in names:
            figures[name] = value
    record = Record(
        "pass",
        engine,
        engine,
        state="settled",
        stable=True,
        figures=figures,
        uncertainties=bounds,
        alternatives=others,
        checks=(make_check("stability", "pass"),),
    )
    return replace(record, **{name: v for name, v in changes.items() if name in names})


def make_sample(
    number: int, outcome: str = "pass", failed: tuple[str, ...] = (), **changes: Any
) -> BoardSample:
    """A sample whose checks `failed` do not pass."""
    checks = tuple(make_check(name, "fail") for name in failed)
    return BoardSample(number, make_record(outcome=outcome, checks=checks, **changes))


def make_check(name: str, outcome: str) -> Check:
    return Check(name, Outcome(outcome), 1.0, 0.1, None, None, "ratio", "")


def reading(
    value: float | None, uncertainty: float | None, alternative: float | None = None
) -> Figure:
    return Figure(value, "", uncertainty, alternative)


def store_records(plan: Plan, store: Store, records: dict[int, Record]) -> None:
    """Store records by place of the grid."""
    for point in grid_points(plan):
        record = records.get(point.place)
        if record is not None:
            store.put(point.key, record)
