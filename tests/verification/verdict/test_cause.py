"""Why a verdict is no pass: one cause, and the checks that follow from it."""

from __future__ import annotations

from dataclasses import replace

import pytest

from taction.verification.verdict.cause import Cause, cause, causes, following
from taction.verification.verdict.checks import Check, Outcome
from taction.verification.verdict.run_checks import run_checks
from tests.support.measured import UNSTABLE, channel, evidence, steady

FAIL, UNDECIDED = Outcome.FAIL, Outcome.INCONCLUSIVE
SLOW = Check("settling_time", FAIL, 3e-3, 1e-9, 2e-3, None, "s", "to ±1 %", 0.01)
HIGH = Check("overshoot", FAIL, 0.25, 1e-6, 0.2, None, "step", "largest overshoot")
LOW = Check("rise_time", FAIL, 8e-6, 1e-9, 2e-5, None, "s", "10-90 % of channel 4; at least 10 us")
MARGIN = Check("stability", FAIL, 1.3, 1e-6, 2.0, None, "ratio", "rightmost pole -1 /s; C can")
OUTSIDE = Check("settling_time", FAIL, None, None, 2e-3, None, "s", "the equilibrium is 3 % off")
OFF = Check("steady_state", FAIL, 0.03, 1e-9, 0.0, 1e-3, "step", "largest")


@pytest.mark.parametrize(
    ("check", "text"),
    [
        (SLOW, "settles to ±1 % in 3 ms (limit: at most 2 ms)"),
        (HIGH, "overshoots by 25 % (limit: at most 20 %)"),
        (LOW, "rises in 8 us (limit: at least 10 us)"),
        (replace(LOW, expected=None), "rises in 8 us (limit: at least 10 us)"),
        (MARGIN, "has a stability margin of 1.3 (limit: at least 2)"),
        (OFF, "rests 3 % off the reference (limit: at most 0.1 %)"),
        (replace(OFF, reason="largest; 95 % of the boards are within, since they differ"),
         "rests up to 3 % off the reference in 95 % of the boards (limit: at most 0.1 %)"),
        (replace(OFF, value=146.0), "rests 14600 % off the reference (limit: at most 0.1 %)"),
        (replace(HIGH, name="swing", value=5.0, expected=4.0, unit="V"),
         "swing: 5 V (limit: at most 4 V)"),
    ],
)  # fmt: skip
def test_a_failure_is_said_with_value_and_limit(check: Check, text: str) -> None:
    assert cause([check]) == Cause(check.name, text, text)


def test_an_unstable_board_has_one_cause() -> None:
    wanted = {"settling_time": {"max": 1.0}, "overshoot": {"max": 0.1}, "rise_time": {"max": 1.0}}
    checks = run_checks(evidence(channel(), poles=UNSTABLE, checks=wanted))
    (found,) = causes(checks)
    assert found.check == "stability"
    assert found.text.startswith("oscillates at ")
    assert found.text.endswith("(limit: below 0 /s)")
    assert "growth rate +" in found.text
    assert set(found.follows) == {"steady_state", "settling_time", "rise_time", "overshoot"}


def test_a_board_that_rests_outside_the_band_never_settles() -> None:
    assert following([OFF, OUTSIDE]) == ("settling_time",)
    assert following([OFF, SLOW]) == ()
    assert [each.check for each in causes([OUTSIDE, HIGH, OFF])] == ["steady_state", "overshoot"]


def test_a_board_that_never_rests_has_no_overshoot_of_its_own() -> None:
    ringing = replace(OFF, value=1e-6, reason="no steady state: channel 1 oscillating")
    lost = replace(HIGH, value=0.1, reason="channel 1 oscillating")
    assert following([ringing, OUTSIDE, lost]) == ("settling_time", "overshoot")
    assert following([ringing, HIGH]) == ()  # beyond its limit by itself
    found = cause([ringing, lost])
    assert found is not None
    assert found.text == "no steady state: channel 1 oscillating"


def test_undecided_checks_of_one_reason_are_one_cause() -> None:
    short = Check("steady_state", UNDECIDED, reason="the record ends after 1 ms")
    checks = [short, replace(short, name="settling_time"), replace(short, name="noise", reason="x")]
    first, second = causes(checks)
    assert first.text == "steady state, settling time not decided: the record ends after 1 ms"
    assert second.title == "output noise not decided"
    assert [each.check for each in causes([*checks, HIGH])] == [
        "overshoot",
        "steady_state",
        "noise",
    ]


def test_a_pass_has_no_cause_and_no_check_is_no_pass() -> None:
    settled = steady(1.0)
    assert cause(run_checks(evidence(channel(), steady=settled))) is None
    assert cause([]) == Cause("", "no check was made", "no check was made")
