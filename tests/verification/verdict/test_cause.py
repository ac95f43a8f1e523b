"""What decides: the cause, bounds on the errors of readings, warnings and contradictions."""

from __future__ import annotations

import math
from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from taction.netlist_gen.board.circuit import Circuit
from taction.netlist_gen.board.synthesis import synthesise
from taction.system.reading_definitions import EXCURSIONS
from taction.verification.readings.readings import Reading
from taction.verification.reference.ideal_answer import IdealAnswer, ideal_answer, ideal_network
from taction.verification.verdict.checks import Cause, Check, Outcome, cause, causes, following
from taction.verification.verdict.run import bounded
from taction.verification.verdict.verify import all_warnings, find_contradiction
from tests.support.making import make_scene, matrix_problem
from tests.support.measured import STABLE, UNSTABLE, channel, evidence, measured, rounded_poles

FAIL, UNDECIDED = Outcome.FAIL, Outcome.INCONCLUSIVE
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
    # 0.1 + 0.021 is below 0.3, 0.01 is not above 0.02
    assert max(found.readings[name].uncertainty for name in EXCURSIONS) < 1e-12
    known = {
        name: Reading(value, 1e-4) for name, value in (("overshoot", 0.1), ("undershoot", 0.02))
    }
    found = bounded(measured(channel(overshoot=0.101)), measured(channel(**known)))
    errors = [found.readings[name].uncertainty for name in EXCURSIONS]
    assert errors == pytest.approx([1.1e-3, 1e-4])


def test_the_network_settles_with_its_last_channel_within_the_bounds_of_all() -> None:
    record = measured(
        channel(0, settling_time=Reading(1.0e-3, 0.0)),
        channel(1, settling_time=Reading(0.9e-3, 0.0)),
    )
    other = measured(
        channel(0, settling_time=Reading(1.01e-3, 1e-6)),
        channel(1, settling_time=Reading(1.2e-3, 1e-6)),
    )
    found = bounded(record, other).settling_time
    assert found.value == 1.0e-3
    assert found.uncertainty == pytest.approx(2.01e-4)  # the true time is 1.2 ms


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
