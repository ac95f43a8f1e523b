"""Checks of the steady state and of stability: by the equilibrium, the poles and the record."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest

from taction.verification.readings.readings import Reading
from taction.verification.stability.poles import summarise
from taction.verification.verdict.checks import (
    Outcome,
    overall,
)
from taction.verification.verdict.run_checks import run_checks
from tests.support.measured import (
    UNSTABLE,
    channel,
    check,
    evidence,
    measured,
    oscillating,
    steady,
)

PASS, FAIL, UNDECIDED = Outcome.PASS, Outcome.FAIL, Outcome.INCONCLUSIVE


@pytest.mark.parametrize(
    ("rest", "error", "reference_error", "outcome"),
    [
        (1.0009, 1e-12, 0.0, PASS),
        (1.0009, 0.0, 0.0, UNDECIDED),
        (1.0011, 0.0, 0.0, FAIL),
        (0.9989, 0.0, 0.0, FAIL),
        (1.0009, 2e-4, 0.0, UNDECIDED),
        (1.0009, 0.0, 2e-4, UNDECIDED),
    ],
)
def test_a_steady_state_is_judged_at_the_equilibrium(
    rest: float, error: float, reference_error: float, outcome: Outcome
) -> None:
    given = evidence(
        channel(final=rest),
        steady=steady(rest, error=error),
        reference_error=reference_error,
    )
    found = check("steady_state", given)
    assert found.outcome is outcome
    assert found.value == pytest.approx(abs(rest - 1.0))
    assert found.tolerance == 1e-3


@pytest.mark.parametrize("error", [1.5, math.inf])
def test_a_step_below_the_rounding_of_the_equilibrium_is_nothing_to_judge(error: float) -> None:
    found = check("steady_state", evidence(channel(final=1.0), steady=steady(1.0, error=error)))
    assert (found.outcome, found.value) == (UNDECIDED, None)
    assert found.reason.startswith("nothing to judge: the step amplitude is below the rounding")


def test_the_end_of_a_record_confirms_the_equilibrium_and_decides_nothing() -> None:
    """A record that ends on target does not save a board that comes to rest beside it."""
    beside = check("steady_state", evidence(channel(final=1.0), steady=steady(1.002, left=0.01)))
    assert beside.outcome is FAIL
    assert beside.value == pytest.approx(2e-3)
    assert beside.reason.endswith("0 % at the record's end")
    off = check("steady_state", evidence(channel(final=1.0005), steady=steady(1.0)))
    assert off.outcome is UNDECIDED  # the end differs by more than the wanted error of 2.5e-4
    assert "the record ends 0.05 % from the equilibrium" in off.reason
    explained = evidence(channel(final=1.0005), steady=steady(1.0, left=3e-4))
    assert check("steady_state", explained).outcome is PASS


def test_a_record_that_is_too_short_decides_nothing_and_says_what_would() -> None:
    given = evidence(channel(final=1.0), steady=steady(1.0, left=0.1), forever=False)
    found = check("steady_state", given)
    assert found.outcome is UNDECIDED
    needed = 1.2 * (1.0 + math.log(100.0))  # a mode of 1 s from 0.1 to 1e-3 of the step
    assert found.reason.endswith(f"ends after 1 s: analysis.stop = {needed:.4g} s is needed")
    assert check("settling_time", given).outcome is UNDECIDED
    assert check("stability", given).outcome is PASS
    known = evidence(channel(final=1.0), steady=steady(1.0, left=0.1), forever=True)
    assert {found.outcome for found in run_checks(known)} == {PASS}


def test_a_steady_state_is_a_fraction_of_the_step_amplitude() -> None:
    given = evidence(measurements=measured(channel(final=1.001), amplitude=0.5))
    assert check("steady_state", given).value == pytest.approx(2e-3)


def test_an_oscillating_board_has_no_steady_state_even_on_target() -> None:
    """Behavioural amplifiers may sustain an oscillation about a stable equilibrium."""
    given = evidence(oscillating(), steady=steady(1.0, linear=False))
    found = check("steady_state", given)
    assert found.outcome is FAIL
    assert "no steady state: channel 1 oscillating at 40 kHz, growth rate +1 k/s" in found.reason
    assert check("settling_time", given).outcome is FAIL
    assert check("settling_time", given).value is None


def test_a_linear_board_that_oscillates_contradicts_its_stable_poles() -> None:
    given = evidence(oscillating(), checks={"overshoot": {"max": 0.5}})
    for name in ("steady_state", "settling_time", "overshoot", "stability"):
        assert check(name, given).outcome is UNDECIDED
    assert "the poles are stable, the transient is not" in check("steady_state", given).reason


def test_an_unstable_board_fails_whatever_its_transient_shows() -> None:
    wanted = {"overshoot": {"max": 0.5}, "undershoot": {"max": 0.5}, "rise_time": {"max": 1.0}}
    given = evidence(poles=UNSTABLE, checks=wanted, reference_problem="the gap is too wide")
    for name in ("steady_state", "settling_time", "overshoot", "undershoot", "stability"):
        assert check(name, given).outcome is FAIL
        assert "oscillates at 15.92 kHz, growth rate +1 k/s" in check(name, given).reason
    assert check("rise_time", given).outcome is UNDECIDED


def test_a_pole_within_rounding_of_the_axis_decides_nothing() -> None:
    given = evidence(
        poles=summarise(np.array([1e-9, -1e6], dtype=np.complex128), complete=True),
        checks={"overshoot": {"max": 0.5}, "rise_time": {"max": 1.0}},
    )
    for name in ("steady_state", "settling_time", "rise_time", "overshoot", "stability"):
        assert check(name, given).outcome is UNDECIDED
        assert "the board may be stable or unstable" in check(name, given).reason


def test_an_equilibrium_outside_the_band_never_settles() -> None:
    given = evidence(channel(settling_time=Reading(1e-3, 0.0)), steady=steady(1.02))
    found = check("settling_time", given)
    assert found.outcome is FAIL
    assert found.reason == (
        "the equilibrium is 2 % off the reference, outside ±1 % of the step amplitude"
    )


def test_stability_is_the_poles_word_and_the_transient_may_object() -> None:
    assert check("stability", evidence()).outcome is PASS
    unstable = check("stability", evidence(poles=UNSTABLE))
    assert unstable.outcome is FAIL
    assert "oscillates at 15.92 kHz, growth rate +1 k/s" in unstable.reason
    objected = check("stability", evidence(oscillating()))
    assert objected.outcome is UNDECIDED
    assert "the transient is not" in objected.reason


def test_an_untrusted_reference_decides_nothing_but_stability() -> None:
    wanted = {"rise_time": {"max": 1.0}, "overshoot": {"max": 1.0}}
    given = evidence(checks=wanted, reference_problem="the gap is too wide")
    for found in run_checks(given):
        if found.name != "stability":
            assert found.outcome is UNDECIDED
            assert found.reason == "the gap is too wide"
    assert overall(run_checks(given)) is UNDECIDED


def test_a_board_that_need_not_move_is_no_verdict() -> None:
    given = evidence(measurements=measured(channel(target=0.0, final=0.3), amplitude=0.0))
    assert check("steady_state", given).outcome is UNDECIDED
    assert check("settling_time", given).outcome is UNDECIDED


def test_a_pole_within_its_rounding_of_the_axis_is_undecided() -> None:
    for real, outcome in ((-1.0, PASS), (-1e-7, UNDECIDED), (1e-7, UNDECIDED), (1.0, FAIL)):
        given = summarise(np.array([real + 1e6j, real - 1e6j, -1e8]), complete=True)
        assert check("stability", evidence(poles=given)).outcome is outcome


def test_a_step_below_the_references_error_is_nothing_to_judge() -> None:
    given = evidence(channel(final=3.0, settling_time=None), reference_error=1.5)
    for name in ("steady_state", "settling_time"):
        assert check(name, given).outcome is UNDECIDED
        assert "nothing to judge" in check(name, given).reason


def test_a_record_within_the_limit_confirms_where_the_remainder_is_an_estimate() -> None:
    for end, estimated, outcome in (
        (1.0005, False, UNDECIDED),
        (1.0005, True, PASS),
        (1.002, True, UNDECIDED),
    ):
        rest = replace(steady(1.0), estimated=estimated)
        assert check("steady_state", evidence(channel(final=end), steady=rest)).outcome is outcome
