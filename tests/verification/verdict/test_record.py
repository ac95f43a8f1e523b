"""A verdict as one flat record, and the one comparison of two records."""

from __future__ import annotations

import json
import math
import re
from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from taction.netlist_gen.scene.axes import with_value
from taction.system.documents import plain, read
from taction.verification.verdict.checks import Check, Outcome
from taction.verification.verdict.compare import Difference, compare, within_uncertainties
from taction.verification.verdict.record import (
    CHANNEL_FIGURES,
    ERROR,
    FIGURES,
    Channel,
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
    data = json.loads(json.dumps(plain(record), allow_nan=False))
    assert data["settling_time"] == record.value("settling_time")
    assert data["channels"][0]["reference"] == record.channels[0].figures["reference"]
    assert plain(read(Record, data)) == plain(record)
    with pytest.raises(ValueError, match="outcome"):
        read(Record, {name: value for name, value in data.items() if name != "outcome"})


def test_a_failed_verdict_says_why() -> None:
    scene = with_value(small_scene(), "checks.settling_time.max", 1e-9)
    verdict = verify(scene)
    record = Record.of(verdict)
    assert verdict.outcome is Outcome.FAIL
    assert record.failed == ("settling_time",)
    assert re.fullmatch(r"settles to ±1 % in [\d.]+ [mu]s \(limit: at most 1 ns\)", record.reason)


def test_without_a_verdict_there_is_a_record_too() -> None:
    record = Record.without_verdict("SimulationError", "x" * 9000, "ngspice")
    assert (record.outcome, record.failure, len(record.reason)) == (ERROR, "SimulationError", 4000)
    assert set(record.figures.values()) == {None}
    assert record.pole is None
    assert read(Record, plain(record)) == record


def check(name: str, outcome: str = "pass", value: float | None = 1.0) -> Check:
    return Check(name, Outcome(outcome), value, 0.125, None, None, "s", "")


def make(value: float | None = 1.0, bound: float | None = 0.25, **changes: Any) -> Record:
    channel = Channel(1, "settled", {"final": 2.0}, {"final": 0.0})
    record = Record(
        "pass",
        "statespace",
        stable=True,
        figures={"rise_time": value},
        uncertainties={} if bound is None else {"rise_time": bound},
        checks=(check("stability"),),
        channels=(channel,),
    )
    return replace(record, **changes)


def one(first: Record, second: Record, group: str, times: float = 1.0) -> Difference:
    (found,) = compare(first, second, within_uncertainties(times), groups=(group,))
    return found


@pytest.mark.parametrize(("value", "beyond"), [(1.5, False), (1.51, True), (0.4, True)])
def test_both_uncertainties_are_allowed(value: float, beyond: bool) -> None:
    found = one(make(), make(value), "figures")
    assert (found.allowed, found.beyond) == (0.5, beyond)
    assert found.difference == value - 1.0
    assert found.off == pytest.approx(abs(value - 1.0) / 0.5)
    assert one(make(), make(value), "figures", times=2.0).beyond is False or value < 0.4


def test_an_unknown_uncertainty_leaves_a_difference_undecided_and_equality_decided() -> None:
    found = one(make(), make(1.1, None), "figures")
    assert (found.beyond, found.allowed) == (None, None)
    assert math.isnan(found.off)
    assert one(make(), make(1.0, None), "figures").beyond is False


def test_what_only_one_record_has_is_beyond() -> None:
    found = one(make(), make(None), "figures")
    assert (found.beyond, found.difference, found.second) == (True, None, None)
    assert compare(make(None), make(None), within_uncertainties(), groups=("figures",)) == ()
    found = one(make(), make(checks=()), "checks")
    assert (found.first, found.second, found.beyond) == ("pass", None, True)


def test_of_a_fragile_time_the_nearest_value_counts_but_not_two_alternatives() -> None:
    fragile = make(3.0, alternatives={"rise_time": 1.1})
    found = one(make(), fragile, "figures")
    assert (found.first, found.second, found.beyond) == (1.0, 1.1, False)
    assert one(fragile, make(), "figures").first == 1.1
    other = make(9.0, alternatives={"rise_time": 1.1})
    assert one(fragile, other, "figures").beyond is True


def test_words_and_values_of_checks() -> None:
    second = make(outcome="fail", checks=(check("stability", "fail", 2.0),))
    assert one(make(), second, "outcome").beyond is True
    assert one(make(), second, "checks").second == "fail"
    found = one(make(), second, "values")
    assert (found.name, found.unit, found.difference, found.allowed) == (
        "stability",
        "s",
        1.0,
        0.25,
    )
