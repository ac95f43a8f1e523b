"""Checks of settling time, rise time, overshoot and undershoot."""

from __future__ import annotations

import math
from typing import Any

import pytest

from taction.system.quantities import show
from taction.system.reading_definitions import READINGS
from taction.verification.readings.measurements import describe_states
from taction.verification.readings.readings import Reading
from taction.verification.readings.settling import ChannelState
from taction.verification.verdict.bounded_measures import StepError
from taction.verification.verdict.checks import (
    Outcome,
)
from tests.support.measured import (
    channel,
    check,
    evidence,
    measured,
    oscillating,
    steady,
)

PASS, FAIL, UNDECIDED = Outcome.PASS, Outcome.FAIL, Outcome.INCONCLUSIVE


def test_a_board_that_is_outside_its_band_after_the_limit_settles_too_late() -> None:
    late = channel(final=1.05, settling_time=None, state=ChannelState.NOT_SETTLED)
    for limit, outcome in ((0.5, FAIL), (2.0, UNDECIDED), (None, UNDECIDED)):
        wanted = {"settling_time": {"max": limit} if limit else {}}
        given = evidence(late, steady=steady(1.0, left=0.05), checks=wanted)
        found = check("settling_time", given)
        assert found.outcome is outcome
    assert "analysis.stop = " in found.reason


def test_an_outputs_later_excursion_may_exceed_the_limit() -> None:
    wanted = {"overshoot": {"max": 0.15}}
    for left, outcome in ((0.04, PASS), (0.2, UNDECIDED)):
        given = evidence(channel(), steady=steady(1.0, left=left), checks=wanted)
        assert check("overshoot", given).outcome is outcome
    high = evidence(channel(overshoot=0.3), steady=steady(1.0, left=0.2), checks=wanted)
    assert check("overshoot", high).outcome is FAIL


@pytest.mark.parametrize(
    ("limit", "uncertainty", "outcome"),
    [
        (None, 1e-7, PASS),
        (2e-3, 1e-7, PASS),
        (1e-3, 1e-7, UNDECIDED),
        (1.01e-3, 2e-5, UNDECIDED),
        (0.9e-3, 1e-7, FAIL),
        (None, math.inf, UNDECIDED),
    ],
)
def test_settling_time(limit: float | None, uncertainty: float, outcome: Outcome) -> None:
    given = evidence(
        channel(settling_time=Reading(1e-3, uncertainty)),
        checks={"settling_time": {"max": limit} if limit else {}},
    )
    assert check("settling_time", given).outcome is outcome


@pytest.mark.parametrize(("least", "outcome"), [(0.9e-3, PASS), (1e-3, UNDECIDED), (1.1e-3, FAIL)])
def test_a_settling_time_below_its_lower_limit_fails(least: float, outcome: Outcome) -> None:
    given = evidence(checks={"settling_time": {"min": least, "max": 2e-3}})
    found = check("settling_time", given)
    assert found.outcome is outcome
    assert found.reason.endswith(f"at least {show(least, 's')}")
    assert (found.expected, found.value) == (2e-3, 1e-3)


@pytest.mark.parametrize(
    ("limits", "alternative", "outcome"),
    [
        ({"max": 11e-6, "min": 9e-6}, None, PASS),
        ({"max": 9e-6}, None, FAIL),
        ({"min": 11e-6}, None, FAIL),
        ({"min": 10e-6}, None, UNDECIDED),
        ({"max": 11e-6}, 4e-6, PASS),
        ({"max": 11e-6}, 14e-6, UNDECIDED),
        ({"min": 9e-6}, 4e-6, UNDECIDED),
        ({"min": 3e-6}, 4e-6, PASS),
        ({"max": 3e-6}, 4e-6, FAIL),
    ],
)
def test_a_fragile_rise_time(
    limits: dict[str, float], alternative: float | None, outcome: Outcome
) -> None:
    reading = Reading(10e-6, 1e-9, alternative is not None, alternative)
    given = evidence(channel(rise_time=reading), checks={"rise_time": limits})
    assert check("rise_time", given).outcome is outcome


def test_rise_time_of_the_channel_that_is_named_or_the_middle_one() -> None:
    channels = [channel(n, rise_time=Reading((n + 1) * 1e-6, 0.0)) for n in range(4)]
    for named, value in ((None, 2e-6), (4, 4e-6)):
        wanted: dict[str, Any] = {"max": 1.0, **({"channel": named} if named else {})}
        assert check("rise_time", evidence(*channels, checks={"rise_time": wanted})).value == value
    none = evidence(*channels, checks={"rise_time": {"channel": 5}})
    assert check("rise_time", none).outcome is UNDECIDED
    small = evidence(
        channel(rise_time=None, rise_reason="step too small"), checks={"rise_time": {"max": 1}}
    )
    assert check("rise_time", small).outcome is UNDECIDED
    assert "step too small" in check("rise_time", small).reason


@pytest.mark.parametrize(
    ("limit", "error", "outcome"),
    [(0.11, 1e-9, PASS), (0.11, 0.0, UNDECIDED), (0.09, 1e-9, FAIL), (0.1, 1e-3, UNDECIDED)],
)
def test_overshoot_and_undershoot(limit: float, error: float, outcome: Outcome) -> None:
    checks = {"overshoot": {"max": limit}, "undershoot": {"max": limit}}
    both = channel(overshoot=0.1, undershoot=0.1)
    given = evidence(both, checks=checks, error=StepError(0.0, dict.fromkeys(READINGS, error)))
    for name in checks:
        assert check(name, given).outcome is outcome
        cycle = evidence(oscillating(), checks=checks, steady=steady(1.0, linear=False))
        assert check(name, cycle).outcome is FAIL


def test_overshoot_and_undershoot_have_their_own_limits() -> None:
    checks = {"overshoot": {"max": 0.1}, "undershoot": {"max": 0.01}}
    given = evidence(
        channel(0, overshoot=0.09), channel(1, overshoot=0.05, undershoot=0.02), checks=checks
    )
    assert check("overshoot", given).outcome is PASS
    under = check("undershoot", given)
    assert (under.outcome, under.value, under.expected) == (FAIL, 0.02, 0.01)


def test_states_are_told_in_words() -> None:
    stuck = channel(2, state=ChannelState.NOT_SETTLED, settling_time=None)
    found = describe_states(measured(oscillating(0), oscillating(1), stuck, channel(3)))
    assert found == (
        "channel 1, 2 oscillating at 40 kHz, growth rate +1 k/s; channel 3 not settled"
    )
    assert describe_states(measured(oscillating(0), oscillating(1))).startswith("every channel")
    assert describe_states(measured(channel())) == ""


def test_a_ringing_that_may_persist_leaves_its_checks_undecided() -> None:
    both = "if it decays, the settling time is 1 ms; if it does not, it never settles"
    unclear = channel(state=ChannelState.UNDECIDED, settling_time=None, reason=both)
    wanted = {"overshoot": {"max": 0.5}}
    given = evidence(unclear, channel(1), checks=wanted, steady=steady(1.0, 1.0, linear=False))
    for name in ("steady_state", "settling_time", "overshoot"):
        assert check(name, given).outcome is UNDECIDED
        assert both in check(name, given).reason
    worse = evidence(unclear, oscillating(1), checks=wanted, steady=steady(1.0, 1.0, linear=False))
    assert check("settling_time", worse).outcome is FAIL
    assert check("steady_state", worse).outcome is FAIL
