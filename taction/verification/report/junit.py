"""Results for CI: JUnit XML, for GitHub, GitLab and Jenkins.

Every study is a list of suites of tests: a scene is a suite, and each of its checks is a test. A
failed check is a failure, an undecided one an error, and what was not run is skipped.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterable, Iterator, Sequence
from pathlib import Path
from typing import Literal, NamedTuple
from xml.etree import ElementTree as ET

from taction.system.errors import first_ones
from taction.system.foreign_files import visible, visible_lines
from taction.verification.report.texts import figure
from taction.verification.report.views import comparison_view as comparison
from taction.verification.studies.regression.regress import RegressionReport, SceneResult, Status
from taction.verification.studies.scene_files import NOT_RUN, VerifiedFiles
from taction.verification.verdict.checks import Check, band_text, cause, causes, following

End = Literal["", "failure", "error", "skipped"]
ENDS: dict[str, End] = {"pass": "", "fail": "failure", "inconclusive": "error", NOT_RUN: "skipped"}
WITHOUT_VERDICT: dict[Status, End] = {
    Status.MISSING: "failure",
    Status.NO_VERDICT: "error",
    Status.BAD_INPUT: "error",
    Status.NOT_RUN: "skipped",
}


class JUnitTest(NamedTuple):
    """One test: its end (empty for a success), a message, and a longer text."""

    name: str
    end: End = ""
    message: str = ""
    text: str = ""


def files_junit(files: VerifiedFiles) -> str:
    """Return the verdicts of several files as JUnit XML."""
    return junit_text("taction verify", map(_verdict_suite, files.documents))


def regression_junit(report: RegressionReport) -> str:
    """Return a regression run as JUnit XML; a group of compared quantities is a test, too."""
    return junit_text("taction regress", (_scene_suite(each, report) for each in report.results))


def junit_text(name: str, suites: Iterable[ET.Element]) -> str:
    """Return suites under a `name` as JUnit XML."""
    root = ET.Element("testsuites", name=name)
    root.extend(suites)
    for count in ("tests", "failures", "errors"):
        root.set(count, str(sum(int(suite.attrib[count]) for suite in root)))
    root.set("time", f"{sum(float(suite.attrib['time']) for suite in root):.3f}")
    ET.indent(root)
    return '<?xml version="1.0" encoding="UTF-8"?>\n' + ET.tostring(root, encoding="unicode") + "\n"


def junit_suite(
    file: str, tests: Iterable[JUnitTest], seconds: float = 0.0, **properties: str
) -> ET.Element:
    """Return the tests of a file; the first of them has the time of the run, s, which made all."""
    name, cases = visible(Path(file).stem), [*tests]
    ends = Counter(case.end for case in cases)
    counts = {"tests": len(cases), "failures": ends["failure"], "errors": ends["error"]}
    suite = ET.Element("testsuite", name=name, file=visible(file), time=f"{seconds:.3f}")
    suite.attrib |= {key: str(n) for key, n in {**counts, "skipped": ends["skipped"]}.items()}
    known = ET.SubElement(suite, "properties")
    for key, value in properties.items():
        ET.SubElement(known, "property", name=key.replace("_", " "), value=visible_lines(value))
    for case in cases:
        own = {"name": visible(case.name), "classname": f"taction.{name}", "time": f"{seconds:.3f}"}
        test, seconds = ET.SubElement(suite, "testcase", own), 0.0
        if case.end:
            ended = ET.SubElement(
                test, case.end, message=visible_lines(case.message), type=case.end
            )
            ended.text = visible_lines(case.text)
    return suite


def _check_tests(checks: Sequence[Check]) -> Iterator[JUnitTest]:
    """Yield a test for each check; what follows from a failure is skipped, and names it."""
    known = {each.check: each for each in causes(checks)}
    first, follows = cause(checks), following(checks)
    for check in checks:
        limit = check.expected if check.tolerance is None else check.tolerance
        value, bound = (figure(number, check.unit, 6) for number in (check.value, limit))
        value += f" {band_text(check)}" if check.band and check.value is None else ""
        text = f"{check.outcome.value}: {value}, limit {bound}; {check.reason}"
        end, message = ENDS[check.outcome.value], text
        if check.name in known:
            message = known[check.name].text
        elif check.name in follows and first is not None:
            end, message = "skipped", f"follows: {first.text}"
        yield JUnitTest(f"check {check.name}", end, message, text)


def _verdict_suite(document: comparison.Document) -> ET.Element:
    properties = {key: document[key] for key in ("outcome", "simulator") if key in document}
    if "checks" in document:
        tests = [*_check_tests(comparison.checks_of(document))]
    else:
        outcome = document["outcome"]
        text = document.get("error", {}).get("message", "interrupted")
        tests = [JUnitTest("verify", ENDS.get(outcome, "error"), f"{outcome}: {text}", text)]
    seconds = document.get("timing", {}).get("total", 0.0)
    return junit_suite(document["file"], tests, seconds, **properties)


def _scene_suite(result: SceneResult, report: RegressionReport) -> ET.Element:
    entries = {"simulator": result.entry, "baseline_simulator": result.baseline}
    properties = {name: entry.solved_by for name, entry in entries.items() if entry is not None}
    properties = {"status": result.status.value} | properties
    tests = _scene_tests(result, report)
    return junit_suite(str(Path(report.folder) / result.file), tests, result.seconds, **properties)


def _scene_tests(result: SceneResult, report: RegressionReport) -> Iterator[JUnitTest]:
    if not result.checks:
        # An update of the baseline removes the scenes that are gone from the folder.
        accepted = report.updated and result.status is Status.MISSING
        end: End = "skipped" if accepted else WITHOUT_VERDICT[result.status]
        yield JUnitTest("verify", end, f"{result.status.value}: {result.reason}", result.reason)
        return
    yield from _check_tests(result.checks)
    if result.baseline is None:
        yield JUnitTest("baseline", "skipped", "new: not in the baseline")
        return
    end = "skipped" if report.updated or not result.fails else "failure"
    for group in dict.fromkeys(d.group for d in result.differences):
        name, changes = f"baseline {group}", [d for d in result.changes if d.group == group]
        if not changes:
            yield JUnitTest(name)
        else:
            lines = [*map(comparison.change_line, changes)]
            text = "\n".join((*lines, *comparison.remarks(result)))
            yield JUnitTest(name, end, first_ones(lines, 1), text)
