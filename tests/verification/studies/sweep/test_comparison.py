"""Whether the records of two engines agree."""

from __future__ import annotations

from typing import Any

import pytest

from taction.verification.studies.sweep.hybrid import Comparison, compare_point
from taction.verification.verdict.checks import Outcome
from taction.verification.verdict.record import TRANSIENT_READINGS
from tests.support.sweeping import make_check, make_record, reading


def judged(ngspice: dict[str, Any], statespace: dict[str, Any] | None = None) -> Comparison:
    return compare_point(make_record("ngspice", **ngspice), make_record(**(statespace or {})))


def with_reading(name: str, *values: float | None) -> dict[str, Any]:
    return {name: reading(*values)}  # type: ignore[arg-type]


def test_equal_records_agree_and_the_difference_is_relative_to_the_wanted_error() -> None:
    found = judged({"attained_error": 1e-4, "wanted_error": 2.5e-4})
    assert (found.outcome, found.reason) == (Outcome.PASS, "")
    assert found.difference == pytest.approx(0.4)


def test_an_unstable_board_has_no_difference() -> None:
    found = judged({"attained_error": None, "stable": False}, {"stable": False})
    assert (found.outcome, found.difference) == (Outcome.PASS, None)


@pytest.mark.parametrize("name", TRANSIENT_READINGS)
@pytest.mark.parametrize(
    ("value", "outcome"), [(1.0039, Outcome.PASS), (1.0041, Outcome.FAIL), (0.9, Outcome.FAIL)]
)
def test_a_reading_differs_by_at_most_twice_its_uncertainties(
    name: str, value: float, outcome: Outcome
) -> None:
    found = judged(with_reading(name, value, 1e-3))  # the uncertainties are 1e-3 and 1e-3
    assert found.outcome is outcome
    assert found.reason.startswith(name) == (outcome is Outcome.FAIL)


def test_of_a_fragile_reading_either_value_counts() -> None:
    assert judged(with_reading("rise_time", 2.0, 1e-3, 1.0)).outcome is Outcome.PASS
    other = with_reading("rise_time", 1.5, 1e-3, 2.0)
    assert judged(with_reading("rise_time", 2.0, 1e-3), other).outcome is Outcome.PASS
    assert judged(with_reading("rise_time", 3.0, 1e-3), other).outcome is Outcome.FAIL


def test_readings_of_growing_records_are_not_compared() -> None:
    far = with_reading("overshoot", 7.0, 1e-3)
    assert judged(far | {"stable": False}, {"stable": False}).outcome is Outcome.PASS


def test_a_reading_of_one_engine_only_or_without_uncertainty_is_undecided() -> None:
    found = judged(with_reading("settling_time", None, None))
    assert found.outcome is Outcome.INCONCLUSIVE
    assert "only the state-space engine has this reading" in found.reason
    found = judged(with_reading("settling_time", 1.0, None))
    assert found.outcome is Outcome.INCONCLUSIVE
    assert "no second solution" in found.reason


@pytest.mark.parametrize(
    ("ours", "theirs", "outcome"),
    [
        ("pass", "pass", Outcome.PASS),
        ("pass", "fail", Outcome.FAIL),
        ("fail", "pass", Outcome.FAIL),
        ("inconclusive", "pass", Outcome.PASS),  # the limit is within the larger uncertainty
        ("fail", "fail", Outcome.PASS),
    ],
)
def test_a_check_must_not_pass_by_one_engine_and_fail_by_the_other(
    ours: str, theirs: str, outcome: Outcome
) -> None:
    found = judged(
        {"checks": (make_check("overshoot", ours),)},
        {"checks": (make_check("overshoot", theirs),)},
    )
    assert found.outcome is outcome


@pytest.mark.parametrize("outcome", list(Outcome))
def test_the_check_of_the_waveforms_decides(outcome: Outcome) -> None:
    assert judged({"checks": (make_check("engines_agree", outcome.value),)}).outcome is outcome


def test_a_disagreement_is_not_hidden_by_an_undecided_reading() -> None:
    found = judged(with_reading("overshoot", 2.0, 1e-3) | with_reading("rise_time", None, None))
    assert found.outcome is Outcome.FAIL
    assert found.reason.startswith("overshoot")


def test_without_a_verdict_nothing_is_confirmed() -> None:
    found = judged({"outcome": "error", "reason": "timed out\nmore"})
    assert found == Comparison(Outcome.INCONCLUSIVE, None, "no verdict by ngspice: timed out")
