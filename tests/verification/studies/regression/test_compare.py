"""Differences in tolerances, against closed forms."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
import pytest

from taction.netlist_gen.scene.checks import Regression
from taction.verification.studies.regression.baseline import Entry, Observation
from taction.verification.studies.regression.run import compare_entry
from taction.verification.verdict.compare import Difference
from tests.support.entries import channel, entry

TIME = np.linspace(0.0, 5e-6, 501)
TAU = 1e-6


def observation(entry: Entry, tau: float = TAU, stop: float = 5e-6) -> Observation:
    """The step response of an RC, densely sampled, with `entry` as what is kept of it."""
    time = TIME[stop * (1 + 1e-9) >= TIME]
    return Observation(entry, time, (1.0 - np.exp(-time / tau))[:, None])


def find(found: tuple[Difference, ...], name: str, group: str = "") -> Difference:
    return next(d for d in found if d.name == name and group in ("", d.group))


def check(name: str, outcome: str) -> dict[str, str]:
    return {"name": name, "outcome": outcome}


def against(
    now: dict[str, Any], allowed: dict[str, Any] | None = None, **then: Any
) -> tuple[Difference, ...]:
    table = Regression.model_validate(allowed or {})
    return compare_entry(observation(entry(**now)), entry(**then), table)


def test_the_same_is_no_tolerance_off() -> None:
    found = against({})
    assert not any(d.beyond for d in found)
    assert {d.group for d in found} == {
        "checks", "states", "channels", "figures", "waveforms",
    }  # fmt: skip
    assert max(d.off for d in found) < 1e-5  # the cubic between the points


def test_a_level_is_off_by_its_distance_over_absolute_plus_relative() -> None:
    found = against(
        {"channels": [channel(final=1.01, overshoot=0.26)]},
        {"levels": {"relative": 0.01, "absolute": 0.001}},
        channels=[channel(final=1.0, overshoot=0.25)],
        step_amplitude=2.0,
    )
    final, overshoot = find(found, "final"), find(found, "overshoot")
    assert final.allowed == pytest.approx(0.001 * 2.0 + 0.01)  # of the step, V
    assert final.off == pytest.approx(0.01 / 0.012)
    assert overshoot.allowed == pytest.approx(0.001 + 0.01 * 0.25)  # in steps already
    assert overshoot.off == pytest.approx(0.01 / 0.0035)
    assert (final.beyond, overshoot.beyond) == (False, True)
    assert (final.unit, overshoot.unit) == ("V", "step")


def test_a_pole_s_absolute_tolerance_counts_in_its_magnitude() -> None:
    found = against({"growth_rate": -0.5}, growth_rate=-1e-3, frequency=1e5, speed=1e6)
    growth = find(found, "growth_rate")
    assert growth.allowed == pytest.approx(1e-6 * 1e6 + 1e-3 * 1e-3)
    assert growth.off == pytest.approx(0.499 / 1.000001)


@pytest.mark.parametrize(
    ("now", "then", "off"),
    [
        ([1.01e-5], [1e-5], 0.5),
        ([1.03e-5], [1e-5], 1.5),
        ([8.78e-6], [1e-5, 8.78e-6], 0.0),  # a hair decided the other way
        ([1e-5, 8.78e-6], [8.78e-6], 0.0),
        ([None], [1e-5, None], 0.0),
        ([None], [1e-5], math.inf),
        ([1e-5], [None], math.inf),
    ],
)
def test_of_a_fragile_time_the_nearest_value_counts(
    now: list[float | None], then: list[float | None], off: float
) -> None:
    found = against(settling(now), **settling(then))
    assert find(found, "settling_time").off == pytest.approx(off)


def settling(values: list[float | None]) -> dict[str, Any]:
    """A settling time; a second value makes it fragile."""
    others = {"settling_time": values[-1]} if len(values) > 1 else {}
    return {"settling_time": values[0], "alternatives": others}


def test_a_tolerance_of_zero_lets_nothing_but_the_same_pass() -> None:
    none = {"times": {"relative": 0.0, "absolute": "0s"}}
    assert not find(against({}, none), "settling_time").beyond
    moved = against({"settling_time": 5.0000001e-6}, none)
    assert find(moved, "settling_time").off == math.inf


@pytest.mark.parametrize("norm", ["max", "rms"])
def test_a_waveform_is_off_by_the_norm_of_its_difference(norm: str) -> None:
    """1 - exp(-t/tau) with tau 2 % longer; norms by an independent fine quadrature."""
    at = np.linspace(0.0, 5e-6, 201)
    old = 1.0 - np.exp(-at / TAU)
    then = entry(time=at.tolist(), outputs={"u_1": old.tolist()}, step_amplitude=1.0)
    allowed = {"waveforms": {"norm": norm, "relative": 0.01, "absolute": 1e-3}}
    now = observation(entry(), tau=1.02 * TAU)
    found = compare_entry(now, then, Regression.model_validate(allowed))
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
    found = compare_entry(observation(entry()), entry(), Regression())
    assert find(found, "u_1", "waveforms").off < 1e-6


def test_a_record_that_is_shorter_is_compared_as_far_as_it_goes() -> None:
    now = observation(entry(), stop=2e-6)
    assert find(compare_entry(now, entry(), Regression()), "u_1", "waveforms").off < 1e-6
    nothing = observation(entry(), stop=0.5e-6)
    found = compare_entry(nothing, entry(), Regression())
    assert find(found, "u_1", "waveforms").off == math.inf


def test_outputs_that_came_or_went_differ() -> None:
    then = entry(
        outputs={"u_1": [0.0, 0.6, 1.0], "u_2": [0.0, 0.0, 0.0]},
        channels=[channel(), channel(index=2)],
    )
    found = compare_entry(observation(entry()), then, Regression())
    assert find(found, "u_2", "waveforms").off == math.inf
    assert [d.beyond for d in found if d.group == "states"] == [False, True]


def test_a_check_that_only_one_of_the_two_ran_is_no_change() -> None:
    found = against(
        {"checks": [check("stability", "fail"), check("overshoot", "pass")]},
        checks=[check("stability", "pass"), check("engines_agree", "pass")],
    )
    assert [d.name for d in found if d.group == "checks"] == ["stability"]
    assert find(found, "stability").off == math.inf


def test_of_a_board_that_became_unstable_only_poles_states_and_checks_are_compared() -> None:
    grown = {
        "growth_rate": 1e4,
        "frequency": 0.0,
        "settling_time": None,
        "channels": [{"index": 1, "state": "oscillating", "reference": 1.0}],
        "time": [],
        "outputs": {},
    }
    found = against(grown)
    assert {d.group for d in found if d.beyond} == {"states", "figures"}
    assert {d.group for d in found} == {"checks", "states", "figures"}
