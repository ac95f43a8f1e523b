"""The checks: pass, fail or undecided, by value, uncertainty and limit."""

from __future__ import annotations

import math

import pytest

from taction.verification.verdict.checks import (
    Check,
    Outcome,
    at_most,
    overall,
)
from taction.verification.verdict.run_checks import run_checks
from tests.support.measured import (
    agreement,
    channel,
    check,
    evidence,
    margin,
    measured,
)

PASS, FAIL, UNDECIDED = Outcome.PASS, Outcome.FAIL, Outcome.INCONCLUSIVE


@pytest.mark.parametrize(
    ("value", "uncertainty", "limit", "outcome"),
    [
        (1.0, 0.0, 1.0, PASS),
        (0.9, 0.1, 1.0, PASS),
        (0.95, 0.1, 1.0, UNDECIDED),
        (1.05, 0.1, 1.0, UNDECIDED),
        (1.2, 0.1, 1.0, FAIL),
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


def test_a_contradiction_fails_and_no_contradiction_is_no_check() -> None:
    found = check("same_problem", evidence(contradiction="the board states lambda = 2.0"))
    assert (found.outcome, found.reason) == (FAIL, "the board states lambda = 2.0")
    assert "same_problem" not in {made.name for made in run_checks(evidence())}


def test_checks_that_nobody_asked_for_are_not_made() -> None:
    assert [found.name for found in run_checks(evidence())] == [
        "steady_state",
        "settling_time",
        "stability",
    ]


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
def test_a_stability_margin(
    factor: float, uncertainty: float, doubt: str, outcome: Outcome
) -> None:
    wanted = margin(factor, uncertainty, doubt)
    found = check("stability", evidence(checks={"stability": {"margin": 2}}, margin=wanted))
    assert (found.outcome, found.value, found.expected, found.unit) == (
        outcome, factor, 2.0, "ratio",
    )  # fmt: skip
    assert found.reason.endswith(doubt)


@pytest.mark.parametrize(
    ("difference", "step_error", "reason", "outcome"),
    [
        (5e-4, 0.0, "", PASS),
        (2e-3, 0.0, "", FAIL),
        (2e-3, 1e-2, "", UNDECIDED),
        (math.nan, math.nan, "no state-space form", UNDECIDED),
    ],
)
def test_two_engines_agree(
    difference: float, step_error: float, reason: str, outcome: Outcome
) -> None:
    given = evidence(agreement=agreement(difference, step_error, reason))
    assert check("engines_agree", given).outcome is outcome


@pytest.mark.parametrize(("difference", "outcome"), [(1e-6, PASS), (2e-3, FAIL)])
def test_two_engines_may_agree_that_nothing_moves(difference: float, outcome: Outcome) -> None:
    """Without a step the limit of 1e-3 is a share of the unit voltage."""
    still = measured(channel(target=0.0, final=0.0), amplitude=0.0)
    given = evidence(measurements=still, agreement=agreement(difference))
    found = check("engines_agree", given)
    assert (found.outcome, found.value) == (outcome, difference)
    assert "nothing moves" in found.reason
