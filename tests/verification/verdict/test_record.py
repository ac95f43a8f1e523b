"""A verdict as one flat record."""

from __future__ import annotations

import json
import math

import numpy as np
import pytest

from taction.netlist_gen.scene.axes import with_value
from taction.verification.verdict.checks import Outcome
from taction.verification.verdict.record import (
    CHANNEL_FIGURES,
    ERROR,
    FIGURES,
    Figure,
    Record,
)
from taction.verification.verdict.verify import Verdict, verify
from tests.support.studying import small_scene


@pytest.fixture(scope="module")
def verdict() -> Verdict:
    return verify(small_scene())


@pytest.fixture(scope="module")
def record(verdict: Verdict) -> Record:
    return Record.of(verdict)


def test_a_record_states_what_the_verdict_states(verdict: Verdict, record: Record) -> None:
    settling = verdict.measurements.settling_time
    assert settling is not None
    assert (record.outcome, record.reason, record.failed) == ("pass", "", ())
    assert record.figure("settling_time") == Figure(settling.value, "s", settling.uncertainty)
    assert record.figures.keys() == FIGURES.keys()
    assert record.checks == verdict.checks
    pole = verdict.poles.rightmost
    assert record.pole == pytest.approx((pole.real, abs(pole.imag)), rel=1e-12)
    assert record.engine == "statespace"
    assert record.figure("growth_rate").uncertainty == verdict.poles.resolution


def test_channels_of_a_record(verdict: Verdict, record: Record) -> None:
    for channel, measure in zip(record.channels, verdict.measurements.channels, strict=True):
        assert channel.index == measure.index + 1
        assert channel.figures.keys() == {*CHANNEL_FIGURES, "equilibrium"}
        assert channel.figures["reference"] == measure.target
        assert channel.figure("overshoot").uncertainty == measure.readings["overshoot"].uncertainty
    volts = [channel.figures["equilibrium"] for channel in record.channels]
    np.testing.assert_array_equal(np.array(volts, float), verdict.steady.values)
    assert Record.of(verdict, channels=False).channels == ()


def test_plain_data_are_json_and_lead_back(record: Record) -> None:
    data = json.loads(json.dumps(record.to_plain(), allow_nan=False))
    assert data["settling_time"] == record.value("settling_time")
    assert data["channels"][0]["reference"] == record.channels[0].figures["reference"]
    assert Record.from_plain(data).to_plain() == record.to_plain()
    with pytest.raises(ValueError, match="outcome"):
        Record.from_plain({name: value for name, value in data.items() if name != "outcome"})


def test_a_failed_verdict_says_why() -> None:
    scene = with_value(small_scene(), "checks.settling_time.max", 1e-9)
    verdict = verify(scene)
    record = Record.of(verdict)
    assert verdict.outcome is Outcome.FAIL
    assert record.failed == ("settling_time",)
    assert record.reason.startswith("settling_time: ")


def test_without_a_verdict_there_is_a_record_too() -> None:
    record = Record.without_verdict("SimulationError", "x" * 9000, "ngspice")
    assert (record.outcome, record.failure, len(record.reason)) == (ERROR, "SimulationError", 4000)
    assert set(record.figures.values()) == {None}
    assert record.pole is None
    assert Record.from_plain(record.to_plain()) == record


def test_what_is_not_finite_is_none() -> None:
    rule = FIGURES["wanted_error"]
    assert type(rule)("V", lambda source: source).of(math.inf) is None  # type: ignore[arg-type]
