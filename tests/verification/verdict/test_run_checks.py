"""Every check: pass, fail or undecided, by value, uncertainty and limit."""

from __future__ import annotations

import math
import re
from dataclasses import replace
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from taction.system.reading_definitions import EXCURSIONS
from taction.verification.readings.measurements import ChannelMeasure
from taction.verification.readings.readings import Reading
from taction.verification.readings.settling import ChannelState
from taction.verification.verdict.checks import Check, Evidence, Outcome, at_most, overall
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
Case = tuple[Outcome, str, str, Any, Evidence]
ASKED = {"overshoot": {"max": 0.5}, "undershoot": {"max": 0.5}, "rise_time": {"max": 1.0}}


def case(
    outcome: Outcome,
    name: str,
    *known: ChannelMeasure,
    says: str = "",
    value: Any = ...,
    limits: dict[str, float] | None = None,
    **changes: Any,
) -> Case:
    """A check of some channels and limits: its outcome, its reason as a pattern, and its value."""
    checks = {name: limits} if limits else {name: ASKED[name]} if name in ASKED else {}
    return outcome, name, says, value, evidence(*known, checks=checks, **changes)


def settles(
    outcome: Outcome, error: float = 1e-7, says: str = "", value: Any = ..., **limits: float
) -> Case:
    """A board that settles after 1 ms with this error."""
    known = channel(settling_time=Reading(1e-3, error))
    return case(outcome, "settling_time", known, says=says, value=value, limits=limits)


def rises(outcome: Outcome, other: float | None = None, **limits: float) -> Case:
    """A channel whose rise time of 10 us is `other` if a level moves a little."""
    fragile = {} if other is None else {"rise_time": Reading(10e-6, 1e-9, True, other)}
    return case(outcome, "rise_time", channel(**fragile), limits=limits)


def slowest(outcome: Outcome, number: int, which: str, count: int = 5, **limits: float) -> Case:
    """Some of five channels, the last without a rise time: which number is judged."""
    says, value = f"^10-90 % of channel {number}{which}", 1e-6 * (2, 9, 4, 1)[number - 1]
    return case(outcome, "rise_time", *RISES[:count], says=says, value=value, limits=limits)


def rests(outcome: Outcome, volts: float, error: float = 1e-12, **changes: float) -> Case:
    """A board whose equilibrium stands at these volts, which the record's end confirms."""
    known, rest = channel(final=volts), steady(volts, error=error)
    return case(outcome, "steady_state", known, value=abs(volts - 1.0), steady=rest, **changes)


def ends(outcome: Outcome, volts: float, says: str = "", value: Any = ..., **rest: Any) -> Case:
    """A board that rests at 1 V, or at `volts` of `rest`, and whose record ends elsewhere."""
    still = replace(steady(rest.pop("at", 1.0), left=rest.pop("left", 0.0)), **rest)
    return case(outcome, "steady_state", channel(final=volts), says=says, value=value, steady=still)


RISES = [channel(n, rise_time=Reading(t * 1e-6, 1e-12)) for n, t in enumerate((2, 9, 4, 1))]
RISES += [channel(4, rise_time=None, rises=False, rise_reason="step too small")]
LOST = channel(5, rise_time=None, rise_reason="the record is too short")
SMALL = channel(rise_time=None, rise_reason="step too small")
LATE = channel(final=1.05, settling_time=None, state=ChannelState.NOT_SETTLED)
BEFORE_REST = steady(1.0, left=0.05)
EITHER = "if it decays, the settling time is 1 ms; if it does not, it never settles"
UNCLEAR = channel(state=ChannelState.UNDECIDED, settling_time=None, reason=EITHER)
MAY_RING, BOTH_MAY = steady(1.0, linear=False), steady(1.0, 1.0, linear=False)
ON_AXIS = rounded_poles(np.array([1e-9, -1e6], dtype=np.complex128))
UNTRUSTED = "the gap is too wide"
NOTHING = "^nothing to judge: the step amplitude is below the rounding"
THREE = ("steady_state", "settling_time", "overshoot")

JUDGED: list[Case] = [
    settles(PASS),
    settles(PASS, max=2e-3, min=0.9e-3, says="at least 900 us$"),
    settles(UNDECIDED, max=2e-3, min=1e-3, value=1e-3),
    settles(FAIL, max=2e-3, min=1.1e-3),
    settles(UNDECIDED, max=1e-3),
    settles(UNDECIDED, 2e-5, max=1.01e-3),
    settles(FAIL, max=0.9e-3),
    settles(UNDECIDED, math.inf),
    rises(PASS, max=11e-6, min=9e-6),
    rises(FAIL, max=9e-6),
    rises(FAIL, min=11e-6),
    rises(UNDECIDED, min=10e-6),
    rises(PASS, 4e-6, max=11e-6),
    rises(UNDECIDED, 14e-6, max=11e-6),
    rises(UNDECIDED, 4e-6, min=9e-6),
    rises(PASS, 4e-6, min=3e-6),
    rises(FAIL, 4e-6, max=3e-6),
    slowest(PASS, 2, ", the slowest", max=10e-6),
    slowest(FAIL, 2, ", the slowest", max=5e-6),  # the middle channel is fast enough
    slowest(FAIL, 4, ", the fastest; at least", max=10e-6, min=1.5e-6),
    slowest(FAIL, 2, ", the slowest", max=5e-6, min=1.5e-6),
    slowest(UNDECIDED, 2, ", the slowest; the limit is within", max=9e-6),
    slowest(PASS, 3, "", max=5e-6, channel=3),
    slowest(FAIL, 1, "; at least", max=10e-6, min=3e-6, channel=1),
    slowest(PASS, 1, "$", 1, max=10e-6),
    slowest(PASS, 2, ", the slowest$", 2, max=10e-6),
    # A rise time that is missing is not passed over.
    case(UNDECIDED, "rise_time", *RISES[:4], LOST, limits={"max": 10e-6}),
    case(FAIL, "rise_time", *RISES[:4], LOST, limits={"max": 5e-6}),
    case(UNDECIDED, "rise_time", *RISES[:4], limits={"channel": 5}),
    case(UNDECIDED, "rise_time", SMALL, limits={"max": 1}, says="step too small"),
    # A board that is outside its band after the limit settles too late.
    case(FAIL, "settling_time", LATE, limits={"max": 0.5}, steady=BEFORE_REST),
    case(UNDECIDED, "settling_time", LATE, limits={"max": 2.0}, steady=BEFORE_REST),
    case(UNDECIDED, "settling_time", LATE, steady=BEFORE_REST, says=r"analysis\.stop = "),
    # An equilibrium outside the band never settles.
    case(FAIL, "settling_time", channel(settling_time=Reading(1e-3, 0.0)), steady=steady(1.02),
         says="^the equilibrium is 2 % off the reference, outside ±1 % of the step amplitude$"),
    # An output's later excursion may exceed the limit.
    *(case(outcome, "overshoot", channel(overshoot=known), limits={"max": 0.15},
           steady=steady(1.0, left=left))
      for left, known, outcome in ((0.04, 0.1, PASS), (0.2, 0.1, UNDECIDED), (0.2, 0.3, FAIL))),
    *(case(outcome, name, channel(**{name: Reading(0.1, error)}), limits={"max": limit})
      for name in EXCURSIONS
      for limit, error, outcome in (
          (0.11, 1e-9, PASS), (0.11, 0.0, UNDECIDED), (0.09, 1e-9, FAIL), (0.1, 1e-3, UNDECIDED))),
    # The steady state is that of the equilibrium, as a fraction of the step amplitude.
    rests(PASS, 1.0009),
    rests(UNDECIDED, 1.0009, 0.0),
    rests(FAIL, 1.0011, 0.0),
    rests(FAIL, 0.9989, 0.0),
    rests(UNDECIDED, 1.0009, 2e-4),
    rests(UNDECIDED, 1.0009, 0.0, reference_error=2e-4),
    case(FAIL, "steady_state", measurements=measured(channel(final=1.001), amplitude=0.5),
         value=2e-3),
    # The end of a record confirms the equilibrium within the wanted error of 2.5e-4, and else
    # decides nothing: it does not save a board that comes to rest beside the target.
    ends(FAIL, 1.0, "0 % at the record's end$", 2e-3, at=1.002, left=0.01),
    ends(UNDECIDED, 1.0005, "the record ends 0.05 % from the equilibrium"),
    ends(PASS, 1.0005, left=3e-4),
    # Where the remainder is an estimate, the limit counts.
    ends(PASS, 1.0005, estimated=True),
    ends(UNDECIDED, 1.002, estimated=True),
    # A step below rounding or the reference's error is nothing to judge.
    *(case(UNDECIDED, name, channel(settling_time=None), says=NOTHING, value=None,
           steady=steady(1.0, error=error), reference_error=off)
      for name in ("steady_state", "settling_time")
      for error, off in ((1.5, 0.0), (math.inf, 0.0), (1e-15, 1.5))),
    # Behavioural amplifiers may sustain an oscillation about a stable equilibrium.
    case(FAIL, "steady_state", oscillating(), steady=MAY_RING,
         says=r"no steady state: channel 1 oscillating at 40 kHz, growth rate \+1 k/s"),
    case(FAIL, "settling_time", oscillating(), steady=MAY_RING, value=None),
    *(case(FAIL, name, oscillating(), steady=MAY_RING) for name in EXCURSIONS),
    # A ringing that may persist leaves its checks undecided; one that persists does not.
    *(case(UNDECIDED, name, UNCLEAR, channel(1), steady=BOTH_MAY, says=EITHER) for name in THREE),
    *(case(FAIL, name, UNCLEAR, oscillating(1), steady=BOTH_MAY) for name in THREE[:2]),
    # A linear board that oscillates contradicts its stable poles.
    *(case(UNDECIDED, name, oscillating()) for name in (*THREE[1:], "stability")),
    case(UNDECIDED, "steady_state", oscillating(),
         says="the poles are stable, the transient is not"),
    # An unstable board fails whatever its transient shows, and whatever the reference is.
    *(case(FAIL, name, poles=UNSTABLE, reference_problem=UNTRUSTED,
           says=r"oscillates at 15\.92 kHz, growth rate \+1 k/s")
      for name in (*THREE, "undershoot", "stability")),
    case(UNDECIDED, "rise_time", poles=UNSTABLE, reference_problem=UNTRUSTED),
    # A pole within rounding of the axis decides nothing.
    *(case(outcome, "stability", poles=rounded_poles(np.array([at + 1e6j, at - 1e6j, -1e8])))
      for at, outcome in ((-1.0, PASS), (-1e-7, UNDECIDED), (1e-7, UNDECIDED), (1.0, FAIL))),
    *(case(UNDECIDED, name, poles=ON_AXIS, says="the board may be stable or unstable")
      for name in (*THREE, "rise_time", "stability")),
    # An untrusted reference decides nothing but stability.
    *(case(UNDECIDED, name, reference_problem=UNTRUSTED, says=f"^{UNTRUSTED}$")
      for name in (*THREE, "rise_time")),
    case(PASS, "stability", reference_problem=UNTRUSTED),
    case(FAIL, "same_problem", contradiction="the board states lambda = 2",
         says="^the board states lambda = 2$"),
]  # fmt: skip


@pytest.mark.parametrize(("outcome", "name", "says", "value", "given"), JUDGED)
def test_a_check_is_judged_by_what_is_known(
    outcome: Outcome, name: str, says: str, value: Any, given: Evidence
) -> None:
    found = check(name, given)
    assert found.outcome is outcome
    assert re.search(says, found.reason)
    if value is not ...:
        assert found.value == (value if value is None else pytest.approx(value, rel=1e-12))
    if name == "steady_state" and value not in (..., None):
        assert found.tolerance == 1e-3


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


@pytest.mark.parametrize(
    ("value", "uncertainty", "limit", "outcome"),
    [
        (1.0, 0.0, 1.0, PASS),
        (1.05, 0.1, 1.0, UNDECIDED),
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
def test_stability_margins(factor: float, uncertainty: float, doubt: str, outcome: Outcome) -> None:
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
