"""Scenes whose equilibrium, poles or margin decide, whatever a transient shows.

The true values are from the deck's text at 200 bits.
"""

from __future__ import annotations

import numpy as np
import pytest

from netlist_gen.scene.file import load_scene
from netlist_gen.scene.scene import Scene
from netlist_gen.scene.tolerances import Tolerances
from tests.support.paths import CASES
from verification.pipeline.checks import Check, Outcome
from verification.studies.tolerance.varied_board import evaluate, prepare
from verification.studies.tune import tune
from verification.verify import Verdict, verify

PASS, FAIL, INCONCLUSIVE = Outcome.PASS, Outcome.FAIL, Outcome.INCONCLUSIVE
ENGINES = pytest.mark.parametrize("engine", ["ngspice", "statespace"])
LOW, HIGH = 1.1153e-9, 1.2547e-9  # F: between them the board of `margin-window` is unstable


def case(name: str) -> Scene:
    return load_scene(CASES / f"{name}.toml")


def verdict_of(name: str, engine: str) -> Verdict:
    return verify(case(name).with_engine(engine))


def named(verdict: Verdict, name: str) -> Check:
    return next(check for check in verdict.checks if check.name == name)


@ENGINES
@pytest.mark.usefixtures("ngspice")
def test_an_unstable_window_below_c_fails_the_margin(engine: str) -> None:
    verdict = verdict_of("margin-window", engine)
    check = named(verdict, "stability")
    assert (verdict.outcome, check.outcome) == (FAIL, FAIL)
    assert check.value == pytest.approx(1.53e-9 / HIGH, rel=1e-4)
    assert check.uncertainty == pytest.approx(1e-6 * 1.2194, rel=1e-4)


@ENGINES
@pytest.mark.usefixtures("ngspice")
def test_a_board_inside_the_window_is_unstable(engine: str) -> None:
    verdict = verdict_of("margin-window-inside", engine)
    assert verdict.outcome is FAIL
    assert named(verdict, "stability").value == pytest.approx(160.9, rel=1e-3)


def test_a_sample_of_a_tolerance_study_finds_the_window() -> None:
    scene = case("margin-window").model_copy(update={"tolerances": Tolerances(resistor=0.01)})
    board = prepare(scene)
    sample = evaluate(board, 0, np.zeros(len(board.varied)))
    assert sample.outcome == "fail"
    assert sample.margin == pytest.approx(1.53e-9 / HIGH, rel=1e-4)


def test_tuning_keeps_away_from_the_window() -> None:
    tuning = tune(case("margin-window"), ("C",), overshoot=0.9, margin=2.0)
    assert not tuning.before.stable
    for candidate in tuning.frontier:
        farads = candidate.values["design.capacitance"]
        assert farads / 2.0 > HIGH or farads < LOW
