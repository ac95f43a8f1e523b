"""The points of a sweep as records."""

from __future__ import annotations

import itertools
import math
from collections.abc import Iterator
from typing import Any

from taction.verification.studies.store import Store
from taction.verification.studies.sweep.comparison import compare_point
from taction.verification.studies.sweep.hybrid import confirmed_points
from taction.verification.studies.sweep.plan import Plan, Requests
from taction.verification.verdict.record import Record


def records(plan: Plan, store: Store) -> Iterator[dict[str, Any]]:
    """Yield the record of every stored point of `plan`, in the order of the grid.

    ``values`` holds the values on the axes by name. A point with results of both engines has
    ``agreement`` (pass, fail or inconclusive), ``difference`` and ``disagreement``, see
    `verification.studies.sweep.comparison`; a point that a hybrid sweep confirms by ngspice has
    ``chosen``, the reason. The other keys are those of a `Record`.
    """
    return (record for record in all_records(plan, store) if record is not None)


def all_records(plan: Plan, store: Store) -> Iterator[dict[str, Any] | None]:
    """Yield as `records` does, with None for a point that has no result of an engine."""
    names = {axis.key.path: axis.name for axis in plan.axes}
    confirmed = confirmed_points(plan, store) if plan.hybrid else {}
    requests = iter(Requests(plan))
    while points := list(itertools.islice(requests, len(plan.engines))):
        found = {point.engine: store.record_of(point.request) for point in points}
        place, why = points[0].place, None
        if plan.hybrid:
            why = confirmed.get(place)
            found["ngspice"] = found["ngspice"] if place in confirmed else None
        rest = {
            "values": {names[path]: value for path, value in points[0].values.items()},
            "chosen": why,
            **_comparison(*found.values()),
        }
        for engine, record in found.items():
            yield record and {**rest, **record, "engine": engine, "rightmost_pole": _pole(record)}


def _comparison(*found: dict[str, Any] | None) -> dict[str, Any]:
    """Return the comparison of two engines at a point as plain data, None where only one ran."""
    names = ("agreement", "difference", "disagreement")
    if len(found) < 2 or found[0] is None or found[1] is None:
        return dict.fromkeys(names)
    result = compare_point(*(Record.from_plain(each) for each in found))
    return dict(zip(names, (result.outcome.value, result.difference, result.reason), strict=True))


def _pole(record: dict[str, Any]) -> list[float] | None:
    if record["growth_rate"] is None:
        return None
    return [record["growth_rate"], 2.0 * math.pi * record["frequency"]]
