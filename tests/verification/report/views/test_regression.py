"""Runs of a regression and of the stress cases as JUnit XML, Markdown, table and JSON."""

from __future__ import annotations

import math
from dataclasses import replace
from typing import Any

import pytest
from lxml import etree

from taction.system.charts import Chart
from taction.verification.evidence.stress.catalogue import load_catalogue, select
from taction.verification.evidence.stress.run_cases import (
    CaseJudgement,
    CaseRun,
    StressReport,
    TruthComparison,
)
from taction.verification.report.blocks import PAGE, TERMINAL, Table
from taction.verification.report.junit import regression_junit
from taction.verification.report.views.comparison_view import SHOWN
from taction.verification.report.views.comparison_view import regression_view as view
from taction.verification.report.views.evidence_view import stress_view
from taction.verification.studies.regression.regress import RegressionReport, SceneResult, Status
from taction.verification.verdict.checks import Check, Outcome
from taction.verification.verdict.record import Difference
from tests.support.entries import entry
from tests.support.paths import DATA

# The schema that the xUnit plugin of Jenkins publishes; GitLab and the reporters on GitHub read it.
SCHEMA = DATA / "junit-10.xsd"
NASTY = 'a <b> & "c" | `d` ]]> \x1b[31m\x00 µΩ\nnext * line'


def check(outcome: Outcome, name: str = "settling_time") -> Check:
    return Check(name, outcome, 2e-3, 1e-6, 5e-3, None, "s", NASTY)


def changed(count: int = 1) -> tuple[Difference, ...]:
    return tuple(
        Difference("figures", f"u_{n}", None, 1.0, 1.5, "V", 0.5, 0.01, 50.0 + n, "a note")
        for n in range(count)
    )


OFF = Difference("checks", "stability", None, "pass", "fail", "", None, None, math.inf)
FINE = Difference("channels", "final", 1, 1.0, 1.0, "V", 0.0, 1e-3, 0.0)
PASS, FAIL, UNDECIDED = map(check, (Outcome.PASS, Outcome.FAIL, Outcome.INCONCLUSIVE))
NOTE = "simulator was ngspice-39, now ngspice-46"


def scene(name: str, status: Status, made: Check, *found: Difference, **more: Any) -> SceneResult:
    """Return a scene with a check and differences, with and without an entry before."""
    both = {"entry": entry(), "baseline": entry()} | more
    return SceneResult(f"{name}.toml", status, (made,), found, **both)


RESULTS = (
    scene("same", Status.SAME, PASS, FINE),
    scene("changed", Status.CHANGED, PASS, FINE, *changed(SHOWN + 3), notes=(NOTE,),
          seconds=1234.5678),
    scene("broken", Status.BROKEN, FAIL, OFF),
    scene("better", Status.NEWLY_PASSING, PASS, *changed()),
    scene("new", Status.NEW, PASS, baseline=None),
    scene("undecided", Status.NO_VERDICT, UNDECIDED, reason="too near", entry=None, baseline=None),
    SceneResult("crashed.toml", Status.NO_VERDICT, reason=NASTY),
    SceneResult("gone.toml", Status.MISSING, reason="not in the folder", baseline=entry()),
    SceneResult("bad.toml", Status.BAD_INPUT, reason=NASTY),
    SceneResult("later.toml", Status.NOT_RUN, reason="interrupted"),
)  # fmt: skip


def test_the_output_that_changed_most_is_drawn_now_and_in_the_baseline() -> None:
    then, now = (entry(curves=[["0 1e-6", f"0 {volts}"]]) for volts in (1, 2))
    moved = Difference("channels", "final", 1, 1.0, 2.0, "V", 1.0, 1e-3, 1e3)
    result = scene("moved", Status.CHANGED, PASS, moved, entry=now, baseline=then)
    (drawn,) = (each for each in view(report(result)).blocks() if isinstance(each, Chart))
    assert [mark.y.tolist() for mark in drawn.marks] == [[0.0, 1.0], [0.0, 2.0]]
    blocks = view(report(replace(result, baseline=entry()))).blocks()  # of an older taction
    assert not any(isinstance(each, Chart) for each in blocks)


def report(*results: SceneResult, updated: bool = False) -> RegressionReport:
    return RegressionReport("scenes", "b.json", results or RESULTS, updated)


def parsed(text: str) -> etree._Element:
    return etree.fromstring(text.encode())


@pytest.mark.parametrize("updated", [False, True])
def test_junit_keeps_to_the_published_schema(updated: bool) -> None:
    schema = etree.XMLSchema(etree.parse(SCHEMA))
    for each in (report(updated=updated), *(report(r, updated=updated) for r in RESULTS)):
        document = parsed(regression_junit(each))
        assert schema.validate(document), schema.error_log


def test_junit_counts_what_is_in_it() -> None:
    root = parsed(regression_junit(report()))
    named = root.findall(".//property[@name='simulator']")
    assert {each.get("value") for each in named} == {"ngspice-46, KLU, trapezoidal"}
    for node in (root, *root.findall("testsuite")):
        assert int(node.get("tests")) == len(node.findall(".//testcase"))
        assert int(node.get("failures")) == len(node.findall(".//failure"))
        assert int(node.get("errors")) == len(node.findall(".//error"))
    assert all(len(case) <= 1 for case in root.iter("testcase"))
    assert root.find("testsuite[@name='changed']").get("time") == "1234.568"


@pytest.mark.parametrize(
    ("suite", "case", "end"),
    [
        ("same", "baseline channels", None),
        ("changed", "check settling_time", None),
        ("changed", "baseline figures", "failure"),
        ("changed", "baseline channels", None),
        ("broken", "check settling_time", "failure"),
        ("broken", "baseline checks", "failure"),
        ("better", "baseline figures", "skipped"),
        ("new", "baseline", "skipped"),
        ("undecided", "check settling_time", "error"),
        ("crashed", "verify", "error"),
        ("gone", "verify", "failure"),
        ("bad", "verify", "error"),
        ("later", "verify", "skipped"),
    ],
)
def test_each_test_ends_as_its_scene_did(suite: str, case: str, end: str | None) -> None:
    root = parsed(regression_junit(report()))
    node = root.find(f"testsuite[@name='{suite}']/testcase[@name='{case}']")
    assert [child.tag for child in node] == ([end] if end else [])


def test_junit_says_value_baseline_tolerance_and_how_far_off() -> None:
    text = parsed(regression_junit(report())).find(".//testsuite[@name='changed']//failure").text
    assert f"u_{SHOWN + 2}: 1.5 V, baseline 1 V, tolerance 10 mV, 64 tolerances off" in text
    assert "simulator was ngspice-39" in text


def test_an_accepted_change_is_no_failure() -> None:
    root = parsed(regression_junit(report(RESULTS[1], RESULTS[7], updated=True)))
    assert (root.get("failures"), len(root.findall(".//skipped"))) == ("0", 2)


def test_a_page_has_every_change_and_a_terminal_the_largest() -> None:
    sections = view(report()).sections
    whole = next(each for each in sections if each.title == "changed.toml: changed")
    (table,) = (block for block in whole.made(PAGE) if isinstance(block, Table))
    assert len(table.rows) == SHOWN + 3
    shown = [b for s in sections for b in s.made(TERMINAL) if isinstance(b, Table)]
    assert (len(shown[1].rows), shown[1].note) == (
        SHOWN,
        "Times: the difference over the tolerance. 3 more: --json has all.",
    )
    assert [row[1].outcome for row in shown[0].rows[:3]] == ["pass", "fail", "fail"]


@pytest.mark.parametrize(
    ("places", "status"),
    [
        ((0,), 0), ((0, 4), 0), ((3,), 0), ((1,), 1), ((2,), 1), ((7,), 1),
        ((5,), 3), ((6,), 3), ((8,), 2), ((9,), 130), ((5, 1), 1), ((8, 1, 6), 2),
    ],
)  # fmt: skip
def test_the_worst_scene_decides_the_exit_status(places: tuple[int, ...], status: int) -> None:
    assert report(*(RESULTS[place] for place in places)).exit_status == status


FINE_CASE, OTHER = select(load_catalogue(), ("two-channels", "wrong-shape"))
INSIDE = TruthComparison("overshoot of u_1", 0.101, 0.002, 0.1, "step", 0.0, 1e-3)
OUTSIDE = TruthComparison("settling_time of u_2", 1.003e-3, 1e-6, 1e-3, "s", 0.0, 1e-5)
RUNS = (
    CaseRun(FINE_CASE, "statespace", "InputError", CaseJudgement.RIGHT, seconds=0.01),
    CaseRun(OTHER, "statespace", "pass", CaseJudgement.RIGHT, (), (INSIDE, OUTSIDE), seconds=0.5),
)


def row_of(run: CaseRun) -> dict[str, str]:
    """Return the texts of the row of a run by the titles."""
    (section, *_) = stress_view(StressReport((run,), {})).sections
    (table,) = section.made(TERMINAL)
    assert isinstance(table, Table)
    return {title: each.text for title, each in zip(table.columns, table.rows[0], strict=True)}


def test_a_row_has_the_worst_number_with_both_errors() -> None:
    row = row_of(RUNS[1])
    assert row["worst quantity"] == "settling_time of u_2"
    assert (row["true error"], row["stated error"]) == ("3 µs", "1 µs")
    assert (row["outside"], row["time"]) == ("1 of 2", "500 ms")
    assert [*row_of(RUNS[0]).values()][3:7] == ["–"] * 4
