"""A run of the stress cases as a table, JSON, JUnit XML and a page."""

from __future__ import annotations

import json
import math

import pytest
from lxml import etree

from taction.system.documents import plain
from taction.verification.evidence.stress.catalogue import load_catalogue, select
from taction.verification.evidence.stress.compare import TruthComparison
from taction.verification.evidence.stress.run import CaseJudgement, CaseRun, StressReport
from taction.verification.report.blocks import TERMINAL, Table
from taction.verification.report.junit import stress_junit
from taction.verification.report.renderers.terminal import page_text
from taction.verification.report.views.stress import stress_page, view
from taction.verification.verdict.checks import Check, Outcome
from tests.support.paths import DATA

NASTY = 'a <b> & "c" | `d` ]]> \x1b[31m\x00 µΩ\nnext * line'
ALL = load_catalogue()
FINE, OTHER = select(ALL, ("two-channels", "wrong-shape"))
CHECK = Check("stability", Outcome.PASS, -1.0, 1e-9, 0.0, None, "1/s", NASTY)
INSIDE = TruthComparison("overshoot of u_1", 0.101, 0.002, 0.1, "step", 0.0, 1e-3)
OUTSIDE = TruthComparison("settling_time of u_2", 1.003e-3, 1e-6, 1e-3, "s", 0.0, 1e-5)
REPORT = StressReport(
    (
        CaseRun(FINE, "statespace", "InputError", CaseJudgement.RIGHT, seconds=0.01),
        CaseRun(OTHER, "ngspice", "-", CaseJudgement.NOT_RUN, reason="no ngspice"),
        CaseRun(
            OTHER,
            "statespace",
            "pass",
            CaseJudgement.RIGHT,
            (CHECK,),
            (INSIDE, OUTSIDE),
            seconds=0.5,
        ),
        CaseRun(OTHER, "ngspice", "fail", CaseJudgement.WRONG_OUTCOME, (CHECK,), (), NASTY, 1.25),
        CaseRun(
            OTHER, "ngspice", "pass", CaseJudgement.WRONG_NUMBER, (), (OUTSIDE,), "wrong: x", 1.25
        ),
    ),
    (("numpy", "2.0"),),
)


def test_junit_is_valid_and_holds_every_run() -> None:
    text = stress_junit(REPORT)
    schema = etree.XMLSchema(etree.parse(str(DATA / "junit-10.xsd")))
    document = etree.fromstring(text.encode())
    schema.assertValid(document)
    suites = document.findall("testsuite")
    assert [suite.get("name") for suite in suites] == ["stress.refused", "stress.sizes"]
    assert document.get("tests") == "5"
    assert len(document.findall(".//failure")) == 2
    assert len(document.findall(".//skipped")) == 1
    assert "hard because two nearly equal rows" in document.findall(".//failure")[0].text


def row_of(run: CaseRun) -> dict[str, str]:
    """Return the texts of the row of a run by the titles."""
    (section, *_) = view(StressReport((run,), ())).sections
    (table,) = section.made(TERMINAL)
    assert isinstance(table, Table)
    return {title: each.text for title, each in zip(table.columns, table.rows[0], strict=True)}


def test_a_row_has_the_worst_number_with_both_errors() -> None:
    row = row_of(REPORT.runs[2])
    assert row["worst quantity"] == "settling_time of u_2"
    assert (row["true error"], row["stated error"]) == ("3 µs", "1 µs")
    assert (row["outside"], row["time"]) == ("1 of 2", "500 ms")
    assert [*row_of(REPORT.runs[0]).values()][3:7] == ["–"] * 4


def test_the_table_says_what_is_wrong_and_counts() -> None:
    text = page_text(view(REPORT))
    assert "Wrong" in text
    assert "two-channels, ngspice: wrong number: wrong: x" in text
    joined = " ".join(text.split())
    assert "5 runs: 2 right, 1 wrong outcome, 1 wrong number, 1 not run" in joined
    assert "2 of 3 numbers outside their stated error" in joined


def test_the_document_has_every_number() -> None:
    document = json.loads(json.dumps(plain(REPORT)))
    assert document["count"] == {"right": 2, "wrong outcome": 1, "wrong number": 1, "not run": 1}
    assert (document["numbers"], document["outside"]) == (3, 2)
    run = document["runs"][2]
    assert run["right_outcomes"] == ["pass"]
    assert [n["name"] for n in run["numbers"]] == ["overshoot of u_1", "settling_time of u_2"]
    assert run["numbers"][1]["error"] == pytest.approx(3e-6)
    assert [(n["outside"], n["wrong"]) for n in run["numbers"]] == [(False, False), (True, False)]


def test_a_number_without_a_true_value_is_the_worst() -> None:
    none = TruthComparison("rise_time of u_1", 1e-3, 1e-6, math.nan, "s", 0.0, 1e-5)
    run = CaseRun(OTHER, "ngspice", "pass", CaseJudgement.WRONG_NUMBER, (), (OUTSIDE, none))
    row = row_of(run)
    assert (row["worst quantity"], row["true error"]) == ("rise_time of u_1", "–")


def test_the_page_lists_what_is_wrong_and_every_case_once() -> None:
    page = stress_page(REPORT)
    assert page.count("two nearly equal rows") == 1
    assert "- two-channels, ngspice: wrong number: wrong: x" in page
    assert "## Cases: refused" in page
    rows = [line for line in page.splitlines() if line.startswith("| two-channels | ")]
    assert len(rows) == 5  # four runs, and the case in words
