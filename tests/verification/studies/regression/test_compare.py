"""Differences in tolerances, against closed forms."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
import pytest

from taction.netlist_gen.scene.regression import Regression
from taction.verification.studies.regression.baseline import Entry
from taction.verification.studies.regression.baseline_entry import Observation
from taction.verification.studies.regression.compare import Difference, compare
from tests.support.entries import entry

TIME = np.linspace(0.0, 5e-6, 501)
TAU = 1e-6


def observation(entry: Entry, tau: float = TAU, stop: float = 5e-6) -> Observation:
    """The step response of an RC, densely sampled, with `entry` as what is kept of it."""
    time = TIME[stop * (1 + 1e-9) >= TIME]
    return Observation(entry, time, (1.0 - np.exp(-time / tau))[:, None])


def find(found: tuple[Difference, ...], name: str, group: str = "") -> Difference:
    return next(d for d in found if d.name == name and group in ("", d.group))


def against(
    now: dict[str, Any], allowed: dict[str, Any] | None = None, **then: Any
) -> tuple[Difference, ...]:
    table = Regression.model_validate(allowed or {})
    return compare(observation(entry(**now)), entry(**then), table)


def test_the_same_is_no_tolerance_off() -> None:
    found = against({})
    assert not any(d.changed for d in found)
    assert {d.group for d in found} == {
        "checks", "states", "levels", "times", "poles", "waveforms",
    }  # fmt: skip
    assert max(d.off for d in found) < 1e-5  # the cubic between the points


def test_a_level_is_off_by_its_distance_over_absolute_plus_relative() -> None:
    levels = {"u_1.final": 1.01, "u_1.overshoot": 0.26}
    found = against(
        {"levels": levels},
        {"levels": {"relative": 0.01, "absolute": 0.001}},
        levels={"u_1.final": 1.0, "u_1.overshoot": 0.25},
        amplitude=2.0,
    )
    final, overshoot = find(found, "u_1.final"), find(found, "u_1.overshoot")
    assert final.tolerance == pytest.approx(0.001 * 2.0 + 0.01)  # of the step, V
    assert final.off == pytest.approx(0.01 / 0.012)
    assert overshoot.tolerance == pytest.approx(0.001 + 0.01 * 0.25)  # in steps already
    assert overshoot.off == pytest.approx(0.01 / 0.0035)
    assert (final.changed, overshoot.changed) == (False, True)
    assert (final.unit, overshoot.unit) == ("V", "step")


def test_a_pole_s_absolute_tolerance_counts_in_its_magnitude() -> None:
    poles = {"growth_rate": -1e-3, "frequency": 1e5}
    found = against({"poles": poles | {"growth_rate": -0.5}}, poles=poles, speed=1e6)
    growth = find(found, "growth_rate")
    assert growth.tolerance == pytest.approx(1e-6 * 1e6 + 1e-3 * 1e-3)
    assert growth.off == pytest.approx(0.499 / 1.000001)


@pytest.mark.parametrize(
    ("now", "then", "off"),
    [
        ([1.01e-5], [1e-5], 0.5),
        ([1.03e-5], [1e-5], 1.5),
        ([8.78e-6], [1e-5, 8.78e-6], 0.0),  # a hair decided the other way
        ([1e-5, 8.78e-6], [8.78e-6], 0.0),
        ([None], [1e-5, None], 0.0),
        ([None], [None], 0.0),
        ([None], [1e-5], math.inf),
        ([1e-5], [None], math.inf),
    ],
)
def test_of_a_fragile_time_the_nearest_value_counts(
    now: list[float | None], then: list[float | None], off: float
) -> None:
    found = against({"times": {"settling_time": now}}, times={"settling_time": then})
    assert find(found, "settling_time").off == pytest.approx(off)


def test_a_tolerance_of_zero_lets_nothing_but_the_same_pass() -> None:
    none = {"times": {"relative": 0.0, "absolute": "0s"}}
    assert not find(against({}, none), "settling_time").changed
    moved = against({"times": {"settling_time": [5.0000001e-6]}}, none)
    assert find(moved, "settling_time").off == math.inf


@pytest.mark.parametrize("norm", ["max", "rms"])
def test_a_waveform_is_off_by_the_norm_of_its_difference(norm: str) -> None:
    """1 - exp(-t/tau) with tau 2 % longer; norms by an independent fine quadrature."""
    at = np.linspace(0.0, 5e-6, 201)
    old = 1.0 - np.exp(-at / TAU)
    then = entry(time=at.tolist(), outputs={"u_1": old.tolist()}, amplitude=1.0)
    allowed = {"waveforms": {"norm": norm, "relative": 0.01, "absolute": 1e-3}}
    now = observation(entry(), tau=1.02 * TAU)
    found = compare(now, then, Regression.model_validate(allowed))
    difference = find(found, "u_1", "waveforms")
    fine = np.linspace(0.0, 5.0, 2_000_001)
    gap, size = np.exp(-fine / 1.02) - np.exp(-fine), 1.0 - np.exp(-fine)
    measure = np.max if norm == "max" else lambda y: np.sqrt(np.mean(np.square(y)))
    expected = measure(np.abs(gap)) / (1e-3 + 0.01 * measure(size))
    assert difference.off == pytest.approx(expected, rel=2e-3)
    if norm == "max":  # the gap is largest where its slope is zero, near t = tau
        peak = math.log(1.02) / (1.0 - 1.0 / 1.02)
        assert float(difference.note.split(" at ")[1].removesuffix(" s")) == pytest.approx(
            peak * TAU, abs=0.03e-6
        )


def test_stored_samples_are_compared_at_their_own_instants() -> None:
    """Three samples of a fast rise: nothing is lost between them."""
    found = compare(observation(entry()), entry(), Regression())
    assert find(found, "u_1", "waveforms").off < 1e-6


def test_a_record_that_is_shorter_is_compared_as_far_as_it_goes() -> None:
    now = observation(entry(), stop=2e-6)
    assert find(compare(now, entry(), Regression()), "u_1", "waveforms").off < 1e-6
    nothing = observation(entry(), stop=0.5e-6)
    found = compare(nothing, entry(), Regression())
    assert find(found, "u_1", "waveforms").off == math.inf


def test_outputs_that_came_or_went_differ() -> None:
    then = entry(
        outputs={"u_1": [0.0, 0.6, 1.0], "u_2": [0.0, 0.0, 0.0]},
        states={"u_1": "settled", "u_2": "settled"},
    )
    found = compare(observation(entry()), then, Regression())
    assert find(found, "u_2", "waveforms").off == math.inf
    assert find(found, "u_2", "states").changed


def test_a_check_that_only_one_of_the_two_ran_is_no_change() -> None:
    found = against(
        {"checks": {"stability": "fail", "overshoot": "pass"}},
        checks={"stability": "pass", "engines_agree": "pass"},
    )
    assert [d.name for d in found if d.group == "checks"] == ["stability"]
    assert find(found, "stability").off == math.inf


def test_of_a_board_that_became_unstable_only_poles_states_and_checks_are_compared() -> None:
    grown = {
        "poles": {"growth_rate": 1e4, "frequency": 0.0},
        "states": {"u_1": "oscillating"},
        "levels": {"u_1.target": 1.0},
        "times": {},
        "time": [],
        "outputs": {},
    }
    found = against(grown)
    assert {d.group for d in found if d.changed} == {"states", "poles"}
    assert {d.group for d in found} == {"checks", "states", "poles"}
