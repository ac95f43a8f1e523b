"""Every check, by value, uncertainty and limit; the cause, warnings and contradictions."""

from __future__ import annotations

import math
import re
from dataclasses import replace
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from taction.netlist_gen.board.circuit import Circuit
from taction.netlist_gen.board.synthesis import synthesise
from taction.system.reading_definitions import EXCURSIONS
from taction.verification.readings.measurements import ChannelMeasure
from taction.verification.readings.readings import Reading
from taction.verification.readings.settling import ChannelState
from taction.verification.reference.ideal_answer import IdealAnswer, ideal_answer, ideal_network
from taction.verification.verdict.checks import (
    Cause,
    Check,
    Evidence,
    Outcome,
    at_most,
    cause,
    causes,
    following,
    overall,
)
from taction.verification.verdict.run import Accuracy, Agreement, bounded
from taction.verification.verdict.run_checks import run_checks
from taction.verification.verdict.verify import all_warnings, find_contradiction
from tests.support.making import make_scene, matrix_problem
from tests.support.measured import (
    STABLE,
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
    # Where nothing moves the limit of 1e-3 is a share of the unit voltage.
    *(case(outcome, "engines_agree", says="nothing moves", value=off, agreement=agreement(off),
           measurements=measured(channel(target=0.0, final=0.0), amplitude=0.0))
      for off, outcome in ((1e-6, PASS), (2e-3, FAIL))),
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


def test_a_value_that_is_no_number_is_undecided() -> None:
    for value, uncertainty in ((math.nan, 0.0), (math.inf, 0.0), (1.0, math.nan)):
        assert at_most(value, uncertainty, 1.0) is UNDECIDED


def test_the_whole_is_its_worst_part() -> None:
    passed, failed, undecided = (Check("x", outcome) for outcome in (PASS, FAIL, UNDECIDED))
    assert overall([passed, undecided]) is UNDECIDED
    assert overall([undecided, failed, passed]) is FAIL
    assert overall([]) is UNDECIDED


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


SLOW = Check("settling_time", FAIL, 3e-3, 1e-9, 2e-3, None, "s", "to ±1 %", 0.01)
HIGH = Check("overshoot", FAIL, 0.25, 1e-6, 0.2, None, "step", "largest overshoot")
LOW = Check("rise_time", FAIL, 8e-6, 1e-9, 2e-5, None, "s", "10-90 % of channel 4; at least 10 us")
MARGIN = Check("stability", FAIL, 1.3, 1e-6, 2.0, None, "ratio", "rightmost pole -1 /s; C can")
OUTSIDE = Check("settling_time", FAIL, None, None, 2e-3, None, "s", "the equilibrium is 3 % off")
OFF = Check("steady_state", FAIL, 0.03, 1e-9, 0.0, 1e-3, "step", "largest")
PROBLEM = matrix_problem([[1.0, -0.3], [0.2, 0.8]], [1.0, 0.5])


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
    (found,) = causes(run_checks(evidence(poles=UNSTABLE, checks=ASKED)))
    assert found.check == "stability"
    assert re.fullmatch(r"oscillates at .*growth rate \+.*\(limit: below 0 /s\)", found.text)
    follows = {"steady_state", "settling_time", "rise_time", "overshoot", "undershoot"}
    assert set(found.follows) == follows


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
    with_high = [each.check for each in causes([*checks, HIGH])]
    assert with_high == ["overshoot", "steady_state", "noise"]


@pytest.mark.parametrize(
    ("own", "better", "error"),
    [
        (Reading(10e-6, 5e-7), Reading(9e-6, 2e-8), 1.02e-6),
        # The value of a fragile reading counts, not its alternative.
        (Reading(10e-6, 0.0), Reading(4e-6, 0.0, True, 10.3e-6), 6e-6),
        (Reading(10e-6, 0.0), None, math.inf),
        (None, None, None),
    ],
)
def test_an_error_is_the_difference_and_the_doubt_of_the_better_reading(
    own: Reading | None, better: Reading | None, error: float | None
) -> None:
    record, other = measured(channel(rise_time=own)), measured(channel(rise_time=better))
    found = bounded(record, other).channels[0].rise_time
    assert found is error or found.uncertainty == pytest.approx(error)
    unsettled = bounded(record, measured(channel(rise_time=better, settling_time=None)))
    assert unsettled.settling_time.uncertainty == math.inf


def test_every_channel_has_the_error_of_its_own_excursions() -> None:
    record = measured(channel(0, overshoot=0.1), channel(1, overshoot=0.3, undershoot=0.0))
    other = measured(
        channel(0, overshoot=Reading(0.12, 1e-3)), channel(1, overshoot=0.3, undershoot=0.01)
    )
    found = bounded(record, other)
    errors = [[c.readings[name].uncertainty for name in EXCURSIONS] for c in found.channels]
    assert np.array(errors) == pytest.approx(np.array([[0.021, 0.0], [0.0, 0.01]]))


def test_the_network_settles_with_its_last_channel_within_the_bounds_of_all() -> None:
    times = Reading(1.0e-3, 0.0), Reading(0.9e-3, 3e-4)  # the true time may be 1.2 ms
    found = measured(*(channel(n, settling_time=each) for n, each in enumerate(times)))
    assert found.settling_time.value == 1.0e-3
    assert found.settling_time.uncertainty == pytest.approx(2e-4)


def test_a_fragile_reading_and_a_faint_damping_are_warnings() -> None:
    fragile = channel(3, rise_time=Reading(10.4e-6, 0.0, True, 4.3e-6))
    (found,) = all_warnings(evidence(fragile))
    assert found == (
        "channel 4: rise time 10.4 us is fragile: 4.3 us with the level shifted by 0.5% of the step"
    )
    (found,) = all_warnings(evidence(poles=rounded_poles(np.array([-50.0 + 1e5j, -50.0 - 1e5j]))))
    assert found.startswith("damping ratio 0.0005: the board nearly oscillates")
    for others in (STABLE, UNSTABLE):
        assert not all_warnings(evidence(poles=others))


def made(**design: Any) -> tuple[Circuit, IdealAnswer]:
    scene = make_scene(design=design)
    return synthesise(scene, PROBLEM), ideal_answer(ideal_network(PROBLEM, scene), scene)


@pytest.mark.parametrize(
    ("number", "text"),
    [
        ("lambda", "the board states lambda = 0.6, the reference uses 0.3"),
        ("U0", "the board states unit_voltage = 2.0, the reference uses 1.0"),
        ("Ve", "the board states exponential_slope = 0.14, the reference uses 0.07"),
    ],
)
def test_another_number_is_a_contradiction(number: str, text: str) -> None:
    slope = {"amplifier": "exponential", "exponential_slope": "70mV"} if number == "Ve" else {}
    circuit, ideal = made(**{"lambda": 0.3}, **slope)
    assert find_contradiction(circuit, ideal, ideal.start) == ""
    doubled = replace(circuit.facts[number], value=2.0 * circuit.value(number))
    changed = replace(circuit, facts={**circuit.facts, number: doubled})
    assert text in find_contradiction(changed, ideal, ideal.start)


@pytest.mark.parametrize(("away", "found"), [(0.09, False), (0.11, True)])
def test_a_record_starts_where_the_reference_starts(away: float, found: bool) -> None:
    circuit, ideal = made(amplifier="exponential", **{"lambda": 0.3})
    amplitude = float(np.abs(ideal.target - ideal.start).max())
    start = ideal.start + np.array([0.0, away * amplitude])
    text = find_contradiction(circuit, ideal, start)
    assert text.startswith("channel 2 starts at") is found
    assert bool(text) is found
