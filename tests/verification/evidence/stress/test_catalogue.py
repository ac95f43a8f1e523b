"""The catalogue of stress cases, its true values, and that no case passes with a wrong number."""

from __future__ import annotations

import json
import math
import random
from dataclasses import replace
from pathlib import Path

import pytest

from taction.netlist_gen.scene.check_keys import ExcursionCheck
from taction.netlist_gen.scene.inverse_problem import make_problem
from taction.netlist_gen.scene.scene import load_scene
from taction.system import errors
from taction.system.errors import InputError
from taction.verification.evidence.stress import run_cases as running
from taction.verification.evidence.stress.catalogue import (
    TRUE_VALUES,
    Case,
    TrueValues,
    load_catalogue,
    select,
    stored_values,
)
from taction.verification.evidence.stress.run_cases import (
    CaseJudgement,
    CaseRun,
    StressReport,
    TruthComparison,
    compare,
    run_case,
    wrong_checks,
)
from taction.verification.report.views.evidence_view import headline
from taction.verification.verdict.checks import Outcome
from taction.verification.verdict.verify import Verdict, verify
from tests.support.paths import CASES
from tests.support.true_values import deck_digest, true_values

ALL = load_catalogue()
STORED = json.loads(TRUE_VALUES.read_text("utf-8"))
BOARDS = [case for case in ALL if not case.refused]
FILE = """
[base.problem]
kind = "matrix"
matrix = [[1.0]]
strain = [1.0]
[case.a]
why = "w"
known = "k"
outcome = "pass"
"""
# In the catalogue this board has op-amps that do not slew, as the report assumed.
SLEWING = {"rise-after-band"}
LARGEST = "channels-500"  # its deck alone takes 7 s of processor time; `make stress` verifies it
FAST = 0.25  # s: `make stress` runs all cases
SECONDS = {name: record["seconds"] for name, record in stored_values().items()}
QUICK = [c for c in ALL if SECONDS[c.name] and max(SECONDS[c.name].values()) < FAST]
SAMPLE = random.Random(11).sample(QUICK, 8)  # noqa: S311
LINEAR = [c for c in QUICK if c.truth is not None and c.truth.readable and "Arb, 320" in c.truth.by]
AGAIN = random.Random(12).sample(LINEAR, 3)  # noqa: S311


def name_of(case: Case) -> str:
    return case.name


@pytest.mark.parametrize("path", sorted(CASES.glob("*.toml")), ids=lambda path: path.stem)
def test_their_numbers_are_those_of_the_reports(path: Path) -> None:
    case, scene = select(ALL, (path.stem,))[0].scene(), load_scene(path)
    assert case.checks == scene.checks
    same = {"opamp": scene.design.opamp} if path.stem in SLEWING else {}
    assert case.design.model_copy(update=same) == scene.design
    ours, theirs = make_problem(case), make_problem(scene)
    assert (ours.matrix == theirs.matrix).all()
    assert (ours.strain == theirs.strain).all()


@pytest.mark.parametrize(
    "case",
    [
        pytest.param(c, marks=[pytest.mark.nightly] * (k % 4 != 0 or c.name == LARGEST))
        for k, c in enumerate(BOARDS)
    ],
    ids=name_of,
)
def test_a_scene_is_read_and_its_true_values_are_those_of_its_tables_and_deck(case: Case) -> None:
    assert {case.scene(engine).analysis.engine for engine in case.outcome} == set(case.outcome)
    assert case.truth is not None, "scripts/stress_truth.py computes it"
    record = STORED[case.name]
    assert record["tables"] == case.digest
    assert record["deck"] == deck_digest(case), "scripts/stress_truth.py computes the truth anew"


def test_no_true_values_of_cases_that_are_gone() -> None:
    assert set(STORED) <= {case.name for case in ALL}


def test_every_case_has_its_own_name_and_an_outcome_that_exists() -> None:
    refusals = {name for name, kind in vars(errors).items() if isinstance(kind, type)}
    words = {word for case in ALL for each in case.outcome.values() for word in each}
    assert words <= {outcome.value for outcome in Outcome} | refusals
    assert len({case.name for case in ALL}) == len(ALL)


def test_tables_of_a_case_are_laid_over_the_base(tmp_path: Path) -> None:
    (tmp_path / "one.toml").write_text(FILE + "problem.strain = [2.0]\n")
    (case,) = load_catalogue(tmp_path)
    assert case.tables["problem"] == {"kind": "matrix", "matrix": [[1.0]], "strain": [2.0]}
    assert case.outcome == {"ngspice": ("pass",), "statespace": ("pass",)}


def test_cases_are_selected_by_name_and_by_family() -> None:
    assert [case.name for case in select(ALL, ("identity",))] == ["identity"]
    assert {case.family for case in select(ALL, ("gain", "strain"))} == {"gain", "strain"}
    with pytest.raises(InputError, match="did you mean 'identity'"):
        select(ALL, ("identiti",))


def stated(
    value: float, uncertainty: float, truth: float = 1.0, doubt: float = 0.0
) -> TruthComparison:
    return TruthComparison("overshoot", value, uncertainty, truth, "step", doubt, accuracy=0.01)


@pytest.mark.parametrize(
    ("number", "outside", "wrong"),
    [
        (stated(1.0, 1e-9), False, False),
        (stated(1.001, 0.002), False, False),
        (stated(1.003, 0.002), True, False),
        (stated(1.003, 0.002, doubt=0.001), False, False),
        (stated(1.02, 0.002), True, True),
        (stated(1.0, 0.1, truth=math.nan), True, True),
        (stated(1.0, 0.0), False, False),
        (stated(1.001, 0.0), True, False),
    ],
)
def test_a_number_is_wrong_beyond_its_error_and_the_accuracy_of_the_scene(
    number: TruthComparison, outside: bool, wrong: bool
) -> None:
    assert (number.outside, number.wrong) == (outside, wrong)


def run(name: str, **limits: object) -> tuple[Verdict, TrueValues]:
    (case,) = select(ALL, (name,))
    assert case.truth is not None
    scene = case.scene("statespace")
    checks = scene.checks.model_copy(update=limits)
    return verify(scene.model_copy(update={"checks": checks})), case.truth


def test_every_reading_of_a_verdict_is_compared() -> None:
    verdict, truth = run("two-channels")
    names = {number.name for number in compare(verdict, truth)}
    readings = ("settling_time", "rise_time", "overshoot", "undershoot", "final value")
    of_channels = {f"{name} of u_{n}" for name in readings for n in (1, 2)}
    assert names == of_channels | {"steady_state", "settling_time", "rightmost pole"}


def test_a_margin_is_compared() -> None:
    verdict, truth = run("margin-over-window-1e-2")
    (margin,) = [number for number in compare(verdict, truth) if number.name == "margin"]
    assert margin.truth == pytest.approx(1.53e-9 / 1.19235e-9, rel=1e-4)
    assert not margin.outside


def test_of_an_unstable_board_only_the_pole_is_compared() -> None:
    verdict, truth = run("growing-by-1e-2")
    assert [number.name for number in compare(verdict, truth)] == ["rightmost pole"]


@pytest.mark.parametrize(
    ("name", "change", "text"),
    [
        ("two-channels", {"steady_state": 0.2}, "steady_state is pass, the truth is fail"),
        ("two-channels", {"rightmost": (1.0, 0.0)}, "stability is pass, the truth is fail"),
        ("two-channels", {"arrives": False}, "settling_time is pass, the truth is fail"),
        ("growing-by-1e-2", {"rightmost": (-1.0, 0.0)}, "stability is fail, the truth is pass"),
        ("low-gain-opamp", {"steady_state": 0.0}, "steady_state is fail, the truth is pass"),
        ("margin-over-window-1e-2", {"margin": 2.5}, "stability is fail, the truth is pass"),
    ],
)
def test_a_check_that_contradicts_the_truth_is_found(
    name: str, change: dict[str, object], text: str
) -> None:
    verdict, truth = run(name)
    assert list(wrong_checks(verdict, truth)) == []
    assert text in list(wrong_checks(verdict, replace(truth, **change)))  # type: ignore[arg-type]


def test_a_limit_of_an_excursion_is_judged_by_the_true_excursion() -> None:
    verdict, truth = run("points-500", overshoot=ExcursionCheck(max=0.9))
    assert list(wrong_checks(verdict, truth)) == []
    channels = tuple(dict(channel) | {"overshoot": 0.95} for channel in truth.channels)
    planted = replace(truth, channels=channels)
    assert "overshoot is pass, the truth is fail" in list(wrong_checks(verdict, planted))
    assert any(number.wrong for number in compare(verdict, planted))


def one(name: str) -> Case:
    return select(ALL, (name,))[0]


@pytest.mark.usefixtures("ngspice")
@pytest.mark.parametrize("case", SAMPLE, ids=name_of)
def test_no_case_ends_as_a_pass_with_a_wrong_number(case: Case) -> None:
    for engine in case.outcome:
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


@pytest.mark.parametrize(
    "name",
    [
        "exponential-slope-100V",  # dips within the first step; the true ones are SciPy's
        "offset-within",  # wrong ways of 5e-12 in the first 20 ps
        "offset-beyond",
        "conductance-1S",  # 100 uF beside 5 pF, whose sum loses seven digits
    ],
)
def test_numbers_that_the_first_step_or_rounding_hid_are_within_their_bounds(name: str) -> None:
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
