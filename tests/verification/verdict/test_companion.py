"""Bounds on the errors of readings, from those of a better solution."""

from __future__ import annotations

import math

import pytest

from taction.system.reading_definitions import EXCURSIONS
from taction.verification.readings.measurements import Measurements
from taction.verification.readings.readings import Reading
from taction.verification.verdict.companion import bounded, step_error
from tests.support.measured import channel, measured


def better(error: float = 0.0, **changes: object) -> Measurements:
    known = {"overshoot": Reading(0.1, error), "undershoot": Reading(0.02, error)}
    return measured(channel(**{**known, **changes}))


def test_an_error_is_the_difference_and_the_doubt_of_the_better_reading() -> None:
    record = measured(channel(rise_time=Reading(10e-6, 5e-7), overshoot=0.101))
    other = better(1e-4, rise_time=Reading(9e-6, 2e-8))
    found = bounded(record, other)
    assert found.channels[0].rise_time.uncertainty == pytest.approx(1.02e-6)
    error = step_error(found, 3e-4)
    assert error.readings["rise_time"] == pytest.approx(1.02e-6)
    assert error.readings["overshoot"] == pytest.approx(1.1e-3)
    assert error.readings["undershoot"] == pytest.approx(1e-4)
    assert error.steady_state == pytest.approx(3e-4)


def test_every_channel_has_the_error_of_its_own_excursions() -> None:
    record = measured(channel(0, overshoot=0.1), channel(1, overshoot=0.3, undershoot=0.0))
    other = measured(
        channel(0, overshoot=Reading(0.12, 1e-3)), channel(1, overshoot=0.3, undershoot=0.01)
    )
    found = bounded(record, other, 2.0)
    errors = [[c.readings[name].uncertainty for name in EXCURSIONS] for c in found.channels]
    assert errors == [[pytest.approx(0.041), 0.0], [0.0, pytest.approx(0.02)]]
    # 0.1 + 0.041 is below 0.3, 0.02 is not above 0.02
    assert [found.readings[name].uncertainty for name in EXCURSIONS] == [0.0, 0.0]


def test_ends_are_fractions_of_the_step() -> None:
    record = measured(channel(0), channel(1), amplitude=2.0)
    assert step_error(record, 0.2).steady_state == pytest.approx(0.1)


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


def test_the_value_of_a_fragile_reading_counts_not_its_alternative() -> None:
    record = measured(channel(rise_time=Reading(10e-6, 0.0)))
    other = better(rise_time=Reading(4e-6, 0.0, True, 10.3e-6))
    assert bounded(record, other).channels[0].rise_time.uncertainty == pytest.approx(6e-6)


def test_a_reading_that_only_one_solution_has_is_infinitely_uncertain() -> None:
    record = bounded(measured(channel()), better(rise_time=None, settling_time=None))
    assert record.channels[0].rise_time.uncertainty == math.inf
    assert record.settling_time.uncertainty == math.inf
    neither = bounded(measured(channel(rise_time=None)), better(rise_time=None))
    assert neither.channels[0].rise_time is None
    assert step_error(neither, 0.0).readings["rise_time"] == 0.0


def test_without_another_solution_nothing_is_known() -> None:
    record = bounded(measured(channel()), None)
    found = step_error(record, math.inf)
    assert {found.steady_state, *found.readings.values()} == {math.inf}
