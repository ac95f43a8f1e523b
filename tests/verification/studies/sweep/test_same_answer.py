"""`verify` and a point of a sweep: the same outcomes and readings, in 200 random scenes."""

from __future__ import annotations

from collections import Counter
from typing import Any

import pytest

from netlist_gen.problem.inverse_problem import make_problem
from netlist_gen.scene.scene import Scene
from spice_models.errors import TactionError
from tests.support.random_scenes import random_scene
from verification.pipeline.clock import Clock
from verification.pipeline.design import design_board
from verification.studies.figures import FIGURES
from verification.studies.running.versions import own_versions
from verification.studies.sweep.point import Job, compute, failure, verdict_record
from verification.verify import verify

COUNT, BLOCK = 200, 10
SHORT = 0.02  # s: estimated processor time of the runs of ngspice that are compared
DECISIONS = ("outcome", "failure", "engine", "simulator", "state", "stable")
CHECK_OF = {name: name for name in FIGURES} | {"steady_state_error": "steady_state"}
blocks = pytest.mark.parametrize("first", range(0, COUNT, BLOCK))


def of_verify(scene: Scene) -> dict[str, Any]:
    """Return the record of the verdict that the command `verify` shows."""
    try:
        return verdict_record(verify(scene))
    except TactionError as error:
        return failure(type(error).__name__, str(error), scene.analysis.engine).record


def of_sweep(scene: Scene) -> dict[str, Any]:
    """Return the record that a sweep stores."""
    engine = scene.analysis.engine
    try:
        problem = make_problem(scene)
    except TactionError as error:
        return failure(type(error).__name__, str(error), engine).record
    return compute(Job(scene, problem, False, own_versions(engine == "ngspice"))).record


def close(a: float | None, b: float | None, apart: float) -> bool:
    """Whether two figures are both missing, or not further `apart`, but for rounding."""
    if a is None or b is None:
        return a is b
    return abs(a - b) <= apart + 1e-9 * abs(a)


def assert_same(a: dict[str, Any], b: dict[str, Any]) -> None:
    for name in DECISIONS:
        assert a[name] == b[name], (name, a["reason"], b["reason"])
    doubt: dict[str, float] = {}
    for one, two in zip(a["checks"], b["checks"], strict=True):
        name, uncertainty = one["name"], one["uncertainty"] or 0.0
        doubt[name] = uncertainty + (two["uncertainty"] or 0.0)
        assert (name, one["outcome"]) == (two["name"], two["outcome"])
        assert close(one["value"], two["value"], doubt[name]), name
        assert close(one["uncertainty"], two["uncertainty"], 0.1 * uncertainty + 1e-12), name
    for name in FIGURES.keys() - {"seconds", "simulation_error"}:
        assert close(a[name], b[name], doubt.get(CHECK_OF[name], 0.0)), name


@blocks
def test_the_state_space_engine_says_the_same(first: int) -> None:
    for seed in range(first, first + BLOCK):
        scene = random_scene(seed).with_engine("statespace")
        assert_same(of_verify(scene), of_sweep(scene))


@blocks
def test_ngspice_says_the_same(ngspice: str, first: int) -> None:
    compared = 0
    for seed in range(first, first + BLOCK, 2):
        scene = random_scene(seed).with_engine("ngspice")
        try:
            short = design_board(scene, Clock(lambda stage: None)).plan.seconds <= SHORT
        except TactionError:
            continue
        if short:
            compared += 1
            assert_same(of_verify(scene), of_sweep(scene))
    assert compared


def test_the_scenes_are_of_every_kind() -> None:
    scenes = [random_scene(seed) for seed in range(COUNT)]
    designs = [scene.design for scene in scenes]
    kinds = Counter(scene.problem.kind for scene in scenes)
    kinds += Counter(getattr(scene.problem, "kernel", "matrix") for scene in scenes)
    kinds += Counter(design.topology for design in designs)
    kinds += Counter(design.amplifier for design in designs)
    kinds += Counter(design.resistor_series for design in designs)
    kinds += Counter(scene.analysis.initial for scene in scenes)
    kinds += Counter(f"{d.opamp.base} of {d.amplifier == 'linear'}" for d in designs)
    for kind in (
        *("tactile", "tangential", "normal", "matrix", "integrator", "passive", "zero", "rest"),
        *("exact", "E24", "E96", "linear", "exponential", "sinh", "softplus", "tanh"),
    ):
        assert kinds[kind] >= 3, kind
    assert {design.opamp.base for design in designs} >= {"ua741", "tl084", "ne5534", "ideal"}
    for given in ("rise_time", "overshoot"):
        assert sum(getattr(scene.checks, given) is not None for scene in scenes) >= 50
    assert sum(scene.checks.stability.margin > 1.0 for scene in scenes) >= 50
    assert sum(scene.analysis.stop != "auto" for scene in scenes) >= 30
