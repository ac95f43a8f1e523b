"""Sweeps with stored records instead of verifications."""

from __future__ import annotations

from typing import Any

from taction.netlist_gen.scene.axes import parse_axes
from taction.verification.studies.figures import FIGURES, TRANSIENT_READINGS
from taction.verification.studies.sweep.plan import Plan, Requests
from taction.verification.studies.sweep.store import Store, StoredResult
from tests.support.studying import small_scene

BOTH = ("ngspice", "statespace")


def grid_plan(*over: str, engines: tuple[str, ...] = BOTH, hybrid: bool = False) -> Plan:
    scene = small_scene()
    return Plan(scene, parse_axes(scene, over), engines, hybrid=hybrid)


def make_record(engine: str = "statespace", **changes: Any) -> dict[str, Any]:
    """A record of `verification.studies.sweep.point` that passes; `changes` are its entries."""
    record: dict[str, Any] = dict.fromkeys(FIGURES, 1.0)
    record |= {"failure": None, "reason": "", "engine": engine, "simulator": engine}
    record |= {"outcome": "pass", "state": "settled", "stable": True}
    record |= {"wanted_error": 2.5e-4, "attained_error": 1e-4}
    record["readings"] = {name: reading(1.0, 1e-3) for name in TRANSIENT_READINGS}
    record["checks"] = [{"name": "stability", "outcome": "pass", "value": -1.0}]
    return record | changes


def reading(
    value: float, uncertainty: float | None, alternative: float | None = None
) -> dict[str, float | None]:
    return {"value": value, "uncertainty": uncertainty, "alternative": alternative}


def store_records(plan: Plan, store: Store, records: dict[tuple[str, int], dict[str, Any]]) -> None:
    """Store records by engine and place of the grid."""
    for point in Requests(plan):
        record = records.get((point.engine, point.place))
        if record is not None:
            result = StoredResult(record["outcome"], record)
            store.put(point.request, result, point.request)
