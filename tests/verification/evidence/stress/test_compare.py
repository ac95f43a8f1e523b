"""Stated numbers and checks beside true ones: what is inside, outside and wrong."""

from __future__ import annotations

import math
from dataclasses import replace

import pytest

from taction.netlist_gen.scene.check_keys import ExcursionCheck
from taction.verification.evidence.stress.catalogue import load_catalogue, select
from taction.verification.evidence.stress.judge import (
    TrueValues,
    TruthComparison,
    compare,
    wrong_checks,
)
from taction.verification.verdict.verify import Verdict, verify

CASES = load_catalogue()


def stated(
    value: float, uncertainty: float, truth: float = 1.0, doubt: float = 0.0
) -> TruthComparison:
    return TruthComparison("overshoot", value, uncertainty, truth, "step", doubt, accuracy=0.01)


@pytest.mark.parametrize(
    ("number", "outside", "wrong"),
    [
        (stated(1.0, 1e-9), False, False),
        (stated(1.001, 0.002), False, False),
        (stated(1.003, 0.002), True, False),
        (stated(1.003, 0.002, doubt=0.001), False, False),
        (stated(1.02, 0.002), True, True),
        (stated(1.0, 0.1, truth=math.nan), True, True),
        (stated(1.0, 0.0), False, False),
        (stated(1.001, 0.0), True, False),
    ],
)
def test_a_number_is_wrong_beyond_its_error_and_the_accuracy_of_the_scene(
    number: TruthComparison, outside: bool, wrong: bool
) -> None:
    assert (number.outside, number.wrong) == (outside, wrong)


def run(name: str, **limits: object) -> tuple[Verdict, TrueValues]:
    (case,) = select(CASES, (name,))
    assert case.truth is not None
    scene = case.scene("statespace")
    checks = scene.checks.model_copy(update=limits)
    return verify(scene.model_copy(update={"checks": checks})), case.truth


def test_every_reading_of_a_verdict_is_compared() -> None:
    verdict, truth = run("two-channels")
    names = {number.name for number in compare(verdict, truth)}
    readings = ("settling_time", "rise_time", "overshoot", "undershoot", "final value")
    of_channels = {f"{name} of u_{n}" for name in readings for n in (1, 2)}
    assert names == of_channels | {"steady_state", "settling_time", "rightmost pole"}


def test_a_margin_is_compared() -> None:
    verdict, truth = run("margin-over-window-1e-2")
    (margin,) = [number for number in compare(verdict, truth) if number.name == "margin"]
    assert margin.truth == pytest.approx(1.53e-9 / 1.19235e-9, rel=1e-4)
    assert not margin.outside


def test_of_an_unstable_board_only_the_pole_is_compared() -> None:
    verdict, truth = run("growing-by-1e-2")
    assert [number.name for number in compare(verdict, truth)] == ["rightmost pole"]


@pytest.mark.parametrize(
    ("name", "change", "text"),
    [
        ("two-channels", {"steady_state": 0.2}, "steady_state is pass, the truth is fail"),
        ("two-channels", {"rightmost": (1.0, 0.0)}, "stability is pass, the truth is fail"),
        ("two-channels", {"arrives": False}, "settling_time is pass, the truth is fail"),
        ("growing-by-1e-2", {"rightmost": (-1.0, 0.0)}, "stability is fail, the truth is pass"),
        ("low-gain-opamp", {"steady_state": 0.0}, "steady_state is fail, the truth is pass"),
        ("margin-over-window-1e-2", {"margin": 2.5}, "stability is fail, the truth is pass"),
    ],
)
def test_a_check_that_contradicts_the_truth_is_found(
    name: str, change: dict[str, object], text: str
) -> None:
    verdict, truth = run(name)
    assert list(wrong_checks(verdict, truth)) == []
    assert text in list(wrong_checks(verdict, replace(truth, **change)))  # type: ignore[arg-type]


def test_a_limit_of_an_excursion_is_judged_by_the_true_excursion() -> None:
    verdict, truth = run("points-500", overshoot=ExcursionCheck(max=0.9))
    assert list(wrong_checks(verdict, truth)) == []
    channels = tuple(dict(channel) | {"overshoot": 0.95} for channel in truth.channels)
    planted = replace(truth, channels=channels)
    assert "overshoot is pass, the truth is fail" in list(wrong_checks(verdict, planted))
    assert any(number.wrong for number in compare(verdict, planted))
