"""A regression run as JUnit XML, as the reporters of Jenkins, GitLab and GitHub read it.

A scene is a test suite. Its tests are the checks of its verdict, and one test for each group of
quantities that is compared with the baseline. A failed check or a change is a failure, an
undecided check or an unreadable scene is an error, and a scene without baseline is skipped.
"""

from __future__ import annotations

import re
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from xml.etree import ElementTree as ET

from verification.pipeline.checks import Check, Outcome
from verification.report.regression.text import change_line, remarks, value_text
from verification.report.verdict.table import limit
from verification.studies.regression.compare import Difference
from verification.studies.regression.run import RegressionReport, SceneResult, Status

# Characters that XML 1.0 cannot hold; the log of a simulator may contain them.
FORBIDDEN = re.compile("[^\t\n\r\u0020-\ud7ff\ue000-\ufffd\U00010000-\U0010ffff]")
ENDS = {Outcome.PASS: "", Outcome.FAIL: "failure", Outcome.INCONCLUSIVE: "error"}
WITHOUT_VERDICT = {
    Status.MISSING: "failure",
    Status.NO_VERDICT: "error",
    Status.BAD_INPUT: "error",
    Status.NOT_RUN: "skipped",
}


@dataclass(frozen=True, slots=True)
class _Case:
    """One test: its end ("", "failure", "error" or "skipped"), a message and a longer text."""

    name: str
    end: str = ""
    message: str = ""
    text: str = ""


def regression_junit(report: RegressionReport) -> str:
    """Return a run as JUnit XML."""
    root = ET.Element("testsuites", name="taction regress")
    suites = [_suite(root, result, report) for result in report.results]
    for count in ("tests", "failures", "errors"):
        root.set(count, str(sum(int(suite.get(count, "0")) for suite in suites)))
    root.set("time", _seconds(sum(result.seconds for result in report.results)))
    ET.indent(root)
    return '<?xml version="1.0" encoding="UTF-8"?>\n' + ET.tostring(root, encoding="unicode") + "\n"


def _suite(root: ET.Element, result: SceneResult, report: RegressionReport) -> ET.Element:
    cases = list(_cases(result, updated=report.updated))
    stem = Path(result.file).stem
    suite = ET.SubElement(root, "testsuite", name=_clean(stem))
    suite.set("tests", str(len(cases)))
    for count, end in (("failures", "failure"), ("errors", "error"), ("skipped", "skipped")):
        suite.set(count, str(sum(case.end == end for case in cases)))
    suite.set("time", _seconds(result.seconds))
    suite.set("file", _clean(str(Path(report.folder) / result.file)))
    _properties(suite, result, report)
    for place, case in enumerate(cases):
        seconds = 0.0 if place else result.seconds  # the first test has the time of the one run
        element = ET.SubElement(suite, "testcase", name=_clean(case.name))
        element.set("classname", _clean(f"taction.{stem}"))
        element.set("time", _seconds(seconds))
        if case.end:
            ended = ET.SubElement(element, case.end, message=_clean(case.message), type=case.end)
            ended.text = _clean(case.text)
    return suite


def _properties(suite: ET.Element, result: SceneResult, report: RegressionReport) -> None:
    values = {"status": result.status.value, "revision": report.revision}
    if result.entry is not None:
        values["simulator"] = result.entry.simulator
    if result.baseline is not None:
        values["baseline revision"] = result.baseline.revision
        values["baseline simulator"] = result.baseline.simulator
    properties = ET.SubElement(suite, "properties")
    for name, value in values.items():
        ET.SubElement(properties, "property", name=name, value=_clean(value))


def _cases(result: SceneResult, *, updated: bool) -> Iterator[_Case]:
    if not result.checks:
        # An update of the baseline removes the scenes that are gone from the folder.
        accepted = updated and result.status is Status.MISSING
        end = "skipped" if accepted else WITHOUT_VERDICT[result.status]
        yield _Case("verify", end, f"{result.status.value}: {result.reason}", result.reason)
        return
    yield from map(_check_case, result.checks)
    if result.baseline is None:
        yield _Case("baseline", "skipped", "new: not in the baseline")
        return
    lines = remarks(result)
    for group in dict.fromkeys(d.group for d in result.differences):
        changes = [d for d in result.changes if d.group == group]
        yield _group_case(group, changes, lines, accepted=updated or not result.fails)


def _check_case(check: Check) -> _Case:
    value, bound = value_text(check.value, check.unit), value_text(limit(check), check.unit)
    message = f"{check.outcome.value}: {value}, limit {bound}; {check.reason}"
    return _Case(f"check {check.name}", ENDS[check.outcome], message, message)


def _group_case(
    group: str, changes: list[Difference], remarks_: list[str], *, accepted: bool
) -> _Case:
    name = f"baseline {group}"
    if not changes:
        return _Case(name)
    lines = list(map(change_line, changes))
    more = f" and {len(changes) - 1} more" if len(changes) > 1 else ""
    text = "\n".join([*lines, *remarks_])
    return _Case(name, "skipped" if accepted else "failure", lines[0] + more, text)


def _seconds(seconds: float) -> str:
    return f"{seconds:.3f}"


def _clean(text: str) -> str:
    return FORBIDDEN.sub("\N{REPLACEMENT CHARACTER}", text)
