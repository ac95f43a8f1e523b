"""Every check: pass, fail or undecided, by value, uncertainty and limit."""

from __future__ import annotations

import math
from dataclasses import replace
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from taction.system.quantities import show
from taction.verification.readings.measurements import ChannelMeasure
from taction.verification.readings.readings import Reading
from taction.verification.readings.settling import ChannelState
from taction.verification.verdict.checks import Check, Outcome, at_most, overall
from taction.verification.verdict.run import Accuracy, Agreement
from taction.verification.verdict.run_checks import run_checks
from tests.support.measured import (
    UNSTABLE,
    agreement,
    channel,
    check,
    evidence,
    margin,
    measured,
    oscillating,
    rounded_poles,
    steady,
)

PASS, FAIL, UNDECIDED = Outcome.PASS, Outcome.FAIL, Outcome.INCONCLUSIVE
RISES = [channel(n, rise_time=Reading(t * 1e-6, 1e-12)) for n, t in enumerate((2, 9, 4, 1))]
SMALL = channel(4, rise_time=None, rises=False, rise_reason="step too small")


def fragile(other: float) -> ChannelMeasure:
    """A channel whose rise time of 10 us is `other` if a level moves a little."""
    return channel(rise_time=Reading(10e-6, 1e-9, True, other))


# The name of a check, its limits, what is known of the one channel, and the outcome.
OUTCOMES = [
    ("settling_time", {}, channel(settling_time=Reading(1e-3, 1e-7)), PASS),
    ("settling_time", {"max": 2e-3}, channel(), PASS),
    ("settling_time", {"max": 1e-3}, channel(), UNDECIDED),
    ("settling_time", {"max": 1.01e-3}, channel(settling_time=Reading(1e-3, 2e-5)), UNDECIDED),
    ("settling_time", {"max": 0.9e-3}, channel(), FAIL),
    ("settling_time", {}, channel(settling_time=Reading(1e-3, math.inf)), UNDECIDED),
    ("settling_time", {"max": 2e-3, "min": 0.9e-3}, channel(), PASS),
    ("settling_time", {"max": 2e-3, "min": 1e-3}, channel(), UNDECIDED),
    ("settling_time", {"max": 2e-3, "min": 1.1e-3}, channel(), FAIL),
    ("rise_time", {"max": 11e-6, "min": 9e-6}, channel(), PASS),
    ("rise_time", {"max": 9e-6}, channel(), FAIL),
    ("rise_time", {"min": 11e-6}, channel(), FAIL),
    ("rise_time", {"min": 10e-6}, channel(), UNDECIDED),
    ("rise_time", {"max": 11e-6}, fragile(4e-6), PASS),
    ("rise_time", {"max": 11e-6}, fragile(14e-6), UNDECIDED),
    ("rise_time", {"min": 9e-6}, fragile(4e-6), UNDECIDED),
    ("rise_time", {"min": 3e-6}, fragile(4e-6), PASS),
    ("rise_time", {"max": 3e-6}, fragile(4e-6), FAIL),
]


@pytest.mark.parametrize(("name", "limits", "known", "outcome"), OUTCOMES)
def test_a_time_is_judged_with_its_uncertainty_and_its_other_value(
    name: str, limits: dict[str, float], known: ChannelMeasure, outcome: Outcome
) -> None:
    found = check(name, evidence(known, checks={name: limits}))
    assert found.outcome is outcome
    if name == "settling_time" and "min" in limits:
        assert found.reason.endswith(f"at least {show(limits['min'], 's')}")
        assert (found.expected, found.value) == (2e-3, 1e-3)


def test_a_board_that_is_outside_its_band_after_the_limit_settles_too_late() -> None:
    late = channel(final=1.05, settling_time=None, state=ChannelState.NOT_SETTLED)
    for limit, outcome in ((0.5, FAIL), (2.0, UNDECIDED), (None, UNDECIDED)):
        wanted = {"settling_time": {"max": limit} if limit else {}}
        found = check("settling_time", evidence(late, steady=steady(1.0, left=0.05), checks=wanted))
        assert found.outcome is outcome
    assert "analysis.stop = " in found.reason


def test_an_outputs_later_excursion_may_exceed_the_limit() -> None:
    wanted = {"overshoot": {"max": 0.15}}
    for left, known, outcome in ((0.04, 0.1, PASS), (0.2, 0.1, UNDECIDED), (0.2, 0.3, FAIL)):
        rest = steady(1.0, left=left)
        given = evidence(channel(overshoot=known), steady=rest, checks=wanted)
        assert check("overshoot", given).outcome is outcome


@pytest.mark.parametrize(
    ("limits", "outcome", "number", "which"),
    [
        ({"max": 10e-6}, PASS, 2, ", the slowest"),
        ({"max": 5e-6}, FAIL, 2, ", the slowest"),  # the middle channel is fast enough
        ({"max": 10e-6, "min": 1.5e-6}, FAIL, 4, ", the fastest; at least"),
        ({"max": 5e-6, "min": 1.5e-6}, FAIL, 2, ", the slowest"),
        ({"max": 9e-6}, UNDECIDED, 2, ", the slowest; the limit is within"),
        ({"max": 5e-6, "channel": 3}, PASS, 3, ""),
        ({"max": 10e-6, "min": 3e-6, "channel": 1}, FAIL, 1, "; at least"),
    ],
)
def test_every_rise_time_is_judged_and_the_worst_is_named(
    limits: dict[str, float], outcome: Outcome, number: int, which: str
) -> None:
    found = check("rise_time", evidence(*RISES, SMALL, checks={"rise_time": limits}))
    assert found.outcome is outcome
    assert found.reason.startswith(f"10-90 % of channel {number}{which}")
    assert found.value == RISES[number - 1].readings["rise_time"].value


def test_of_one_or_two_rise_times_the_slower_one_is_reported() -> None:
    for channels, which in ((RISES[:1], ""), (RISES[:2], ", the slowest")):
        found = check("rise_time", evidence(*channels, checks={"rise_time": {"max": 10e-6}}))
        assert found.reason == f"10-90 % of channel {len(channels)}{which}"


def test_a_rise_time_that_is_missing_is_not_passed_over() -> None:
    lost = channel(5, rise_time=None, rise_reason="the record is too short")
    for most, outcome in ((10e-6, UNDECIDED), (5e-6, FAIL)):
        found = check("rise_time", evidence(*RISES, lost, checks={"rise_time": {"max": most}}))
        assert found.outcome is outcome
    none = evidence(*RISES, checks={"rise_time": {"channel": 5}})
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
    both = dict.fromkeys(checks, Reading(0.1, error))
    given = evidence(channel(**both), checks=checks)
    for name in checks:
        assert check(name, given).outcome is outcome
        cycle = evidence(oscillating(), checks=checks, steady=steady(1.0, linear=False))
        assert check(name, cycle).outcome is FAIL


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
        channel(final=rest), steady=steady(rest, error=error), reference_error=reference_error
    )
    found = check("steady_state", given)
    assert found.outcome is outcome
    assert found.value == pytest.approx(abs(rest - 1.0))
    assert found.tolerance == 1e-3


@pytest.mark.parametrize(("error", "of_reference"), [(1.5, 0.0), (math.inf, 0.0), (1e-15, 1.5)])
def test_a_step_below_rounding_or_the_references_error_is_nothing_to_judge(
    error: float, of_reference: float
) -> None:
    given = evidence(
        channel(settling_time=None), steady=steady(1.0, error=error), reference_error=of_reference
    )
    for name in ("steady_state", "settling_time"):
        found = check(name, given)
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
    for real, outcome in ((-1.0, PASS), (-1e-7, UNDECIDED), (1e-7, UNDECIDED), (1.0, FAIL)):
        given = rounded_poles(np.array([real + 1e6j, real - 1e6j, -1e8]))
        assert check("stability", evidence(poles=given)).outcome is outcome
    given = evidence(
        poles=rounded_poles(np.array([1e-9, -1e6], dtype=np.complex128)),
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


def test_an_untrusted_reference_decides_nothing_but_stability() -> None:
    wanted = {"rise_time": {"max": 1.0}, "overshoot": {"max": 1.0}}
    given = evidence(checks=wanted, reference_problem="the gap is too wide")
    for found in run_checks(given):
        if found.name != "stability":
            assert found.outcome is UNDECIDED
            assert found.reason == "the gap is too wide"
    assert overall(run_checks(given)) is UNDECIDED


def test_a_record_within_the_limit_confirms_where_the_remainder_is_an_estimate() -> None:
    for end, estimated, outcome in (
        (1.0005, False, UNDECIDED),
        (1.0005, True, PASS),
        (1.002, True, UNDECIDED),
    ):
        rest = replace(steady(1.0), estimated=estimated)
        assert check("steady_state", evidence(channel(final=end), steady=rest)).outcome is outcome


@pytest.mark.parametrize(
    ("value", "uncertainty", "limit", "outcome"),
    [
        (1.0, 0.0, 1.0, PASS),
        (0.9, 0.1, 1.0, PASS),
        (0.95, 0.1, 1.0, UNDECIDED),
        (1.05, 0.1, 1.0, UNDECIDED),
        (1.2, 0.1, 1.0, FAIL),
        (1.0, math.inf, 1.0, UNDECIDED),
        (1.0, math.nan, 1.0, UNDECIDED),
        (math.nan, 0.0, 1.0, UNDECIDED),
        (math.inf, 0.0, 1.0, UNDECIDED),
        (-5.0, 0.0, 0.0, PASS),
    ],
)
def test_a_limit_within_the_uncertainty_is_undecided(
    value: float, uncertainty: float, limit: float, outcome: Outcome
) -> None:
    assert at_most(value, uncertainty, limit) is outcome


@pytest.mark.parametrize(
    ("outcomes", "whole"),
    [
        ((PASS, PASS), PASS),
        ((PASS, UNDECIDED), UNDECIDED),
        ((UNDECIDED, FAIL, PASS), FAIL),
        ((), UNDECIDED),
    ],
)
def test_the_whole_is_its_worst_part(outcomes: tuple[Outcome, ...], whole: Outcome) -> None:
    checks = [Check("x", outcome, None, None, None, None, "s", "") for outcome in outcomes]
    assert overall(checks) is whole


def test_a_contradiction_fails_and_no_contradiction_is_no_check() -> None:
    found = check("same_problem", evidence(contradiction="the board states lambda = 2.0"))
    assert (found.outcome, found.reason) == (FAIL, "the board states lambda = 2.0")
    assert "same_problem" not in {made.name for made in run_checks(evidence())}


def test_checks_that_nobody_asked_for_are_not_made() -> None:
    assert [found.name for found in run_checks(evidence())] == [
        "steady_state",
        "settling_time",
        "stability",
    ]


@pytest.mark.parametrize(
    ("factor", "uncertainty", "doubt", "outcome"),
    [
        (2.5, 0.0, "", PASS),
        (2.0, 0.0, "", PASS),
        (1.9, 0.0, "", FAIL),
        (0.0, 0.0, "", FAIL),
        (2.0 + 1e-9, 2e-6, "", UNDECIDED),
        (2.0 - 1e-9, 2e-6, "", UNDECIDED),
        (2.5, 0.0, "a pole is on the axis", UNDECIDED),
    ],
)
def test_a_stability_margin(
    factor: float, uncertainty: float, doubt: str, outcome: Outcome
) -> None:
    wanted = margin(factor, uncertainty, doubt)
    found = check("stability", evidence(checks={"stability": {"margin": 2}}, margin=wanted))
    assert (found.outcome, found.value, found.expected, found.unit) == (
        outcome, factor, 2.0, "ratio",
    )  # fmt: skip
    assert found.reason.endswith(doubt)
    # Without a crossing the margin is that of the search's end, or larger; 0 is of unstable boards.
    assert found.uncertainty == (uncertainty or (None if factor else 0.0))


@pytest.mark.parametrize(
    ("agreed", "achieved", "outcome"),
    [
        (agreement(5e-4), 1e-5, PASS),
        (agreement(5e-4), None, PASS),
        (agreement(2e-3), None, FAIL),
        (agreement(2e-3, 1e-2), None, UNDECIDED),
        (agreement(math.nan, math.nan, "no state-space form"), None, UNDECIDED),
        (agreement(5e-4), 3e-4, UNDECIDED),
        (agreement(2e-3), 3e-4, FAIL),
    ],
)
def test_two_engines_agree_but_not_within_an_error_that_was_not_reached(
    agreed: Agreement, achieved: float | None, outcome: Outcome
) -> None:
    accuracy = Accuracy(1e-4, achieved, 1.0, "trapezoidal", "")
    run: Any = SimpleNamespace(accuracy=accuracy)
    found = check("engines_agree", replace(evidence(agreement=agreed), run=run))
    assert found.outcome is outcome
    missed = achieved is not None and achieved > 1e-4 and outcome is UNDECIDED
    assert ("0.01 % allowed" in found.reason) is missed


@pytest.mark.parametrize(("difference", "outcome"), [(1e-6, PASS), (2e-3, FAIL)])
def test_two_engines_may_agree_that_nothing_moves(difference: float, outcome: Outcome) -> None:
    """Without a step the limit of 1e-3 is a share of the unit voltage."""
    still = measured(channel(target=0.0, final=0.0), amplitude=0.0)
    given = evidence(measurements=still, agreement=agreement(difference))
    found = check("engines_agree", given)
    assert (found.outcome, found.value) == (outcome, difference)
    assert "nothing moves" in found.reason
