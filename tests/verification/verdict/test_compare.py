"""The one comparison of two records."""

from __future__ import annotations

import math
from dataclasses import replace
from typing import Any

import pytest

from taction.verification.verdict.checks import Check, Outcome
from taction.verification.verdict.compare import Difference, compare, within_uncertainties
from taction.verification.verdict.record import Channel, Record


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


def test_equal_records_have_no_difference() -> None:
    found = compare(make(), make(), within_uncertainties())
    assert {each.off for each in found} == {0.0}
    groups = ["outcome", "checks", "values", "figures", "states", "channels"]
    assert [each.group for each in found] == groups


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


def test_channels_and_states() -> None:
    second = make(channels=(Channel(1, "oscillating", {"final": 2.5}, {"final": 0.25}),))
    assert one(make(), second, "states").second == "oscillating"
    found = one(make(), second, "channels")
    assert (found.channel, found.unit, found.off) == (1, "V", 2.0)
