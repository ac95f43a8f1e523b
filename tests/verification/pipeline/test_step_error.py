"""The simulation's own error from two runs."""

from __future__ import annotations

import math

import pytest

from tests.support.measured import channel, measured
from verification.measures.readings import Reading
from verification.pipeline.step_error import LATER, simulation_error, undecided

SHARE = 1 / 3  # second order, twice the step


def test_a_second_order_method_is_extrapolated() -> None:
    """Errors h² and (2h)²: the difference is 3 h², and a third of it the finer run's error."""
    fine = measured(
        channel(final=1.0 + 1e-4, rise_time=Reading(10e-6 + 1e-9, 0.0), overshoot=0.101)
    )
    coarse = measured(
        channel(final=1.0 + 4e-4, rise_time=Reading(10e-6 + 4e-9, 0.0), overshoot=0.104)
    )
    found = simulation_error(fine, coarse.readings, SHARE)
    assert found.steady_state == pytest.approx(1e-4)
    assert found.rise_time == pytest.approx(1e-9)
    assert found.overshoot == pytest.approx(1e-3)


def test_the_worst_channel_counts_and_levels_are_fractions_of_the_step() -> None:
    fine = measured(channel(0), channel(1), amplitude=2.0)
    coarse = measured(channel(0, final=1.3), channel(1, final=0.4), amplitude=2.0)
    assert simulation_error(fine, coarse.readings, SHARE).steady_state == pytest.approx(0.1)


def test_a_settling_time_counts_in_full() -> None:
    fine = measured(channel(settling_time=Reading(1.0e-3, 0.0)))
    coarse = measured(channel(settling_time=Reading(1.2e-3, 0.0)))
    assert simulation_error(fine, coarse.readings, SHARE).settling_time == pytest.approx(2e-4)


def test_a_fragile_reading_may_fall_either_way() -> None:
    fine = measured(channel(rise_time=Reading(10e-6, 0.0)))
    coarse = measured(channel(rise_time=Reading(4e-6, 0.0, True, 10.3e-6)))
    assert simulation_error(fine, coarse.readings, SHARE).rise_time == pytest.approx(1e-7)


def test_a_reading_that_only_one_run_has_is_infinitely_uncertain() -> None:
    fine, coarse = measured(channel()), measured(channel(rise_time=None, settling_time=None))
    found = simulation_error(fine, coarse.readings, SHARE)
    assert (found.rise_time, found.settling_time) == (math.inf, math.inf)
    neither = measured(channel(rise_time=None))
    assert simulation_error(neither, neither.readings, SHARE).rise_time == 0.0


def test_without_a_step_there_is_no_error_and_without_a_second_run_no_knowledge() -> None:
    assert simulation_error(measured(channel()), None, 0.0).steady_state == 0.0
    assert simulation_error(measured(channel()), None, math.inf).steady_state == math.inf


def test_a_second_run_is_judged_where_it_shows_more_than_the_first() -> None:
    """A time that only the second run has may be one that its record does not prove."""
    full, empty = measured(channel()), measured(channel(rise_time=None, settling_time=None))
    assert not undecided(full, full.readings)
    assert not undecided(empty, empty.readings)
    assert not undecided(full, empty.readings)
    assert undecided(empty, full.readings)
    assert undecided(measured(channel(rise_time=None)), full.readings)


def test_a_second_run_that_settles_clearly_later_is_judged() -> None:
    fine = measured(channel(settling_time=Reading(1e-3, 0.0)))
    near, far = (
        measured(channel(settling_time=Reading(1e-3 * (1 + times * LATER), 0.0))).readings
        for times in (0.9, 1.1)
    )
    assert not undecided(fine, near)
    assert undecided(fine, far)


def test_an_engine_without_steps_errs_by_its_rounding() -> None:
    fine = measured(channel(rise_time=Reading(1e-5, 0.0), settling_time=Reading(1e-3, 0.0)))
    found = simulation_error(fine, None, 0.0, rounding=1e-9)  # of a step of 1 V, a band of 1 %
    assert found.steady_state == found.overshoot == 1e-9
    assert found.settling_time == pytest.approx(1e-10)
    assert found.rise_time == pytest.approx(2e-13)
    none = simulation_error(measured(channel(rise_time=None)), None, 0.0, rounding=1e-9)
    assert none.rise_time == 0.0
    assert simulation_error(fine, None, math.inf).settling_time == math.inf
