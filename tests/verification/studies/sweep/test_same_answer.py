"""`verify` and a point of a sweep: the same outcomes and readings, in 200 random scenes.

A twentieth of the scenes is verified by default, all with ``TACTION_RANDOM_SCENES=200``.
"""

from __future__ import annotations

import os
from typing import Any

import pytest

from taction.netlist_gen.scene.axes import with_values
from taction.netlist_gen.scene.inverse_problem import make_problem
from taction.netlist_gen.scene.loading import load_scene
from taction.netlist_gen.scene.scene import Scene
from taction.system.documents import plain
from taction.system.errors import TactionError
from taction.system.reading_definitions import READINGS
from taction.verification.studies.running.pool import HERE
from taction.verification.studies.running.store import Store
from taction.verification.studies.sweep.plan import compute_points as compute
from taction.verification.studies.sweep.plan import plan_sweep, sweep_points
from taction.verification.studies.sweep.result import records
from taction.verification.verdict.build import build
from taction.verification.verdict.record import FIGURES, Record
from taction.verification.verdict.verify import Request, verify
from tests.support.paths import SCENES
from tests.support.scenes_of_all_kinds import random_scene

PAPER = SCENES / "paper-breadboard.toml"
COUNT, BLOCKS = 200, 2
STRIDE = COUNT // int(os.environ.get("TACTION_RANDOM_SCENES", "10"))
SEEDS = range(16 % STRIDE, COUNT, STRIDE)  # from 16 on none takes long
SHORT = 0.02  # s: estimated processor time of the runs of ngspice that are compared
DECISIONS = ("outcome", "failure", "engine", "simulator", "state", "stable")
RUN = {"seconds", "simulation_error", "attained_error"}  # figures of the run, not of the board
blocks = pytest.mark.parametrize("seeds", [SEEDS[k::BLOCKS] for k in range(BLOCKS)], ids=str)


def of_verify(scene: Scene) -> dict[str, Any]:
    """Return the record of the verdict that the command `verify` shows."""
    try:
        return dict(plain(Record.of(verify(scene), channels=False)))
    except TactionError as error:
        return without_verdict(error, scene.analysis.engine)


def of_sweep(scene: Scene) -> dict[str, Any]:
    """Return the record that a sweep stores."""
    engine = scene.analysis.engine
    try:
        problem = make_problem(scene)
    except TactionError as error:
        return without_verdict(error, engine)
    asked = Request(scene, problem)
    (result,) = compute(asked)
    assert result is not None
    return dict(plain(result))


def without_verdict(error: TactionError, engine: str) -> dict[str, Any]:
    return dict(plain(Record.without_verdict(type(error).__name__, str(error), engine)))


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


@blocks
def test_the_state_space_engine_says_the_same(seeds: range) -> None:
    for seed in seeds:
        scene = random_scene(seed).with_engine("statespace")
        assert_same(of_verify(scene), of_sweep(scene))


@blocks
def test_ngspice_says_the_same(ngspice: str, seeds: range) -> None:
    compared = 0
    for seed in seeds:
        scene = random_scene(seed).with_engine("ngspice")
        try:
            short = build(scene).plan.seconds <= SHORT
        except TactionError:
            continue
        if short:
            compared += 1
            assert_same(of_verify(scene), of_sweep(scene))
    assert compared


@pytest.mark.parametrize("engine", ["statespace", "ngspice"])
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
