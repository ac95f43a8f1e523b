"""`verify` and a point of a sweep: the same outcomes and readings, whatever came before it."""

from __future__ import annotations

from typing import Any

import pytest

from taction.netlist_gen.scene.axes import with_values
from taction.netlist_gen.scene.loading import load_scene
from taction.netlist_gen.scene.scene import Scene
from taction.system.documents import plain
from taction.system.reading_definitions import READINGS
from taction.verification.studies.running.pool import HERE
from taction.verification.studies.running.store import Store
from taction.verification.studies.sweep.plan import plan_sweep, sweep_points
from taction.verification.studies.sweep.result import records
from taction.verification.verdict.record import FIGURES, Record
from taction.verification.verdict.verify import verify
from tests.support.paths import SCENES

PAPER = SCENES / "paper-breadboard.toml"
DECISIONS = ("outcome", "failure", "engine", "simulator", "state", "stable")
RUN = {"seconds", "simulation_error", "attained_error"}  # figures of the run, not of the board


def of_verify(scene: Scene) -> dict[str, Any]:
    """Return the record of the verdict that the command `verify` shows."""
    return dict(plain(Record.of(verify(scene), channels=False)))


def close(a: float | None, b: float | None, apart: float = 0.0) -> bool:
    """Whether two figures are both missing, or not further `apart`, but for rounding."""
    if a is None or b is None:
        return a is b
    return abs(a - b) <= apart + 1e-9 * abs(a)


def assert_same(a: dict[str, Any], b: dict[str, Any]) -> None:
    """Assert equal decisions, and readings that differ by no more than their uncertainties."""
    for name in DECISIONS:
        assert a[name] == b[name], (name, a["reason"], b["reason"])
    pairs = [(c["name"], c, d) for c, d in zip(a["checks"], b["checks"], strict=True)]
    for name, one, two in pairs:
        assert (name, one["outcome"]) == (two["name"], two["outcome"])
        apart = (one["uncertainty"] or 0.0) + (two["uncertainty"] or 0.0)
        assert close(one["value"], two["value"], apart), (name, one, two)
    for name in FIGURES.keys() - RUN:
        apart = 0.0
        if name in (*READINGS, "end_error"):
            apart = sum(each["uncertainties"].get(name) or 0.0 for each in (a, b))
        assert close(a[name], b[name], apart), (name, a[name], b[name])


@pytest.mark.parametrize(
    "engine", ["statespace", pytest.param("ngspice", marks=pytest.mark.nightly)]
)
def test_no_point_of_a_sweep_depends_on_the_points_before(ngspice: str, engine: str) -> None:
    # Unstable, damped, ringing for long and for a few periods.
    forward = swept("C=8pF,1nF,12pF,100pF", engine)
    assert swept("C=100pF,12pF,1nF,8pF", engine) == forward
    assert len(forward) == 4
    base = load_scene(PAPER).with_engine(engine)
    for capacitance, record in forward.items():
        scene = with_values(base, {"design.capacitance": capacitance, "design.gain": 1e6})
        assert_same(of_verify(scene), record)


def swept(over: str, engine: str) -> dict[float, dict[str, Any]]:
    """Return the records of a sweep of one worker by capacitance, without the time they took."""
    plan = plan_sweep(PAPER, over, engine, fix="gain=1M")
    with Store(":memory:") as store:
        sweep_points(plan, store, HERE)
        found = list(records(plan, store))
    return {record.pop("values")["C"]: record | {"seconds": 0.0} for record in found}
