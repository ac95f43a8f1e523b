"""Measurements of the network, from those of its channels."""

from __future__ import annotations

from taction.verification.readings.readings import Reading
from tests.support.measured import channel, measured


def test_the_network_rises_with_its_slowest_channel() -> None:
    fast, slow = channel(rise_time=Reading(1e-6, 1e-9)), channel(1, rise_time=Reading(2e-6, 1e-9))
    assert (found := measured(fast, slow).rise_time) is not None
    assert found.value == 2e-6


def test_a_channel_of_small_step_does_not_count() -> None:
    still = channel(1, rise_time=None, rises=False)
    assert (found := measured(channel(), still).rise_time) is not None
    assert found.value == 10e-6
    assert measured(still).rise_time is None


def test_a_network_whose_record_ends_before_a_rise_has_no_rise_time() -> None:
    missing = channel(1, rise_time=None, rise_reason="the record ends before 90 %")
    assert measured(channel(), missing).rise_time is None
