"""Running stress cases: no case ends as a pass with a wrong number."""

from __future__ import annotations

import random
from dataclasses import replace

import pytest

from taction.verification.evidence.stress import run_cases as running
from taction.verification.evidence.stress.catalogue import (
    Case,
    load_catalogue,
    select,
    stored_values,
)
from taction.verification.evidence.stress.run_cases import (
    CaseJudgement,
    CaseRun,
    StressReport,
    run_case,
)
from taction.verification.report.views.evidence_view import headline
from taction.verification.verdict.checks import Outcome
from tests.support.true_values import true_values

ALL = load_catalogue()
FAST = 0.25  # s: `make stress` runs all cases
SECONDS = {name: record["seconds"] for name, record in stored_values().items()}
QUICK = [c for c in ALL if SECONDS[c.name] and max(SECONDS[c.name].values()) < FAST]
SAMPLE = random.Random(11).sample(QUICK, 8)  # noqa: S311
LINEAR = [c for c in QUICK if c.truth is not None and c.truth.readable and "Arb, 320" in c.truth.by]
AGAIN = random.Random(12).sample(LINEAR, 3)  # noqa: S311


def name_of(case: Case) -> str:
    return case.name


def one(name: str) -> Case:
    return select(ALL, (name,))[0]


@pytest.mark.usefixtures("ngspice")
@pytest.mark.parametrize("case", SAMPLE, ids=name_of)
def test_no_case_ends_as_a_pass_with_a_wrong_number(case: Case) -> None:
    for engine in case.engines:
        run = run_case(case, engine)
        assert run.judgement is CaseJudgement.RIGHT, run.reason


@pytest.mark.parametrize("case", AGAIN, ids=name_of)
def test_stored_true_values_are_those_of_the_oracle(case: Case) -> None:
    truth = true_values(case.scene())
    assert case.truth is not None
    assert truth.rightmost == pytest.approx(case.truth.rightmost, rel=1e-9, abs=1e-12)
    assert truth.steady_state == pytest.approx(case.truth.steady_state, rel=1e-6, abs=1e-15)
    for found, stored in zip(truth.channels, case.truth.channels, strict=True):
        assert found == pytest.approx(stored, rel=1e-9, abs=1e-12)


def test_a_dip_within_the_first_step_is_within_the_stated_error() -> None:
    """The true undershoot is SciPy's; the op-amps are too fast for the steps of both runs."""
    found = run_case(one("exponential-slope-100V"), "statespace")
    dips = [number for number in found.comparisons if "undershoot" in number.name]
    assert len(dips) == 2
    assert all(number.truth > 1e-6 for number in dips)
    assert not any(number.outside for number in found.comparisons)


@pytest.mark.parametrize("name", ["offset-within", "offset-beyond", "conductance-1S"])
def test_numbers_that_rounding_or_the_first_grid_hid_are_within_their_bounds(name: str) -> None:
    """Wrong ways of 5e-12 in the first 20 ps; 100 uF beside 5 pF, whose sum loses seven digits."""
    found = run_case(one(name), "statespace")
    assert len(found.comparisons) == 13
    assert [number.name for number in found.comparisons if number.outside] == []


def test_a_refusal_is_a_right_outcome() -> None:
    run = run_case(one("wrong-shape"), "statespace")
    assert (run.outcome, run.judgement) == ("InputError", CaseJudgement.RIGHT)
    assert run.comparisons == ()


def test_another_outcome_than_the_right_ones_is_wrong() -> None:
    case = replace(one("two-channels"), outcome={"statespace": ("fail",)})
    run = run_case(case, "statespace")
    assert run.judgement is CaseJudgement.WRONG_OUTCOME
    assert "pass instead of fail" in run.reason
    either = replace(case, outcome={"statespace": ("fail", "pass")})
    assert run_case(either, "statespace").judgement is CaseJudgement.RIGHT


def test_a_check_of_its_own_must_have_its_outcome() -> None:
    case = replace(one("two-channels"), decided={"stability": "fail", "overshoot": "pass"})
    run = run_case(case, "statespace")
    assert run.judgement is CaseJudgement.WRONG_OUTCOME
    assert "stability must be fail, is pass" in run.reason
    assert "overshoot must be pass, is missing" in run.reason


def test_a_pass_with_a_wrong_number_is_wrong() -> None:
    case = one("two-channels")
    assert case.truth is not None
    channels = tuple(dict(c) | {"settling_time": 1.0} for c in case.truth.channels)
    run = run_case(replace(case, truth=replace(case.truth, channels=channels)), "statespace")
    assert (run.outcome, run.judgement) == ("pass", CaseJudgement.WRONG_NUMBER)
    assert "settling_time of u_1" in run.reason


def test_an_unforeseen_exception_is_a_wrong_outcome(monkeypatch: pytest.MonkeyPatch) -> None:
    def broken(*_: object) -> None:
        raise ZeroDivisionError("planted")

    monkeypatch.setattr(running, "verify", broken)
    run = run_case(one("two-channels"), "statespace")
    assert (run.outcome, run.judgement) == ("ZeroDivisionError", CaseJudgement.WRONG_OUTCOME)


def report_of(*judgements: CaseJudgement) -> StressReport:
    case = one("two-channels")
    runs = tuple(CaseRun(case, "statespace", Outcome.PASS.value, j) for j in judgements)
    return StressReport(runs, {})


@pytest.mark.parametrize(
    ("judgements", "status"),
    [
        ((CaseJudgement.RIGHT,), 0),
        ((CaseJudgement.RIGHT, CaseJudgement.NOT_RUN), 3),
        ((CaseJudgement.WRONG_OUTCOME, CaseJudgement.NOT_RUN), 1),
        ((CaseJudgement.RIGHT, CaseJudgement.WRONG_NUMBER), 1),
    ],
)
def test_exit_status(judgements: tuple[CaseJudgement, ...], status: int) -> None:
    assert report_of(*judgements).exit_status == status


def test_without_true_values_outcomes_are_judged_and_the_headline_says_so() -> None:
    run = run_case(replace(one("two-channels"), truth=None), "statespace")
    assert (run.judgement, run.comparisons) == (CaseJudgement.RIGHT, ())
    assert "a checkout has their true values" in headline(StressReport((run,), {}))
