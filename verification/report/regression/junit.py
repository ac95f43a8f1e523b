"""A regression run as JUnit XML.

A scene is a test suite. Its tests are the checks of its verdict, and one test for each group of
quantities that is compared with the baseline. A failed check or a change is a failure, an
undecided check or an unreadable scene is an error, and a scene without baseline is skipped.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path

from taction.verification.report.junit import End, JUnitSuite, JUnitTest, junit_text
from taction.verification.report.regression.text import change_line, remarks, value_text
from taction.verification.report.verdict.table import limit
from taction.verification.studies.regression.compare import Difference
from taction.verification.studies.regression.run import RegressionReport, SceneResult, Status
from taction.verification.verdict.checks import Check, Outcome

ENDS: dict[Outcome, End] = {
    Outcome.PASS: "",
    Outcome.FAIL: "failure",
    Outcome.INCONCLUSIVE: "error",
}
WITHOUT_VERDICT: dict[Status, End] = {
    Status.MISSING: "failure",
    Status.NO_VERDICT: "error",
    Status.BAD_INPUT: "error",
    Status.NOT_RUN: "skipped",
}


def regression_junit(report: RegressionReport) -> str:
    """Return a run as JUnit XML."""
    return junit_text("taction regress", [_suite(result, report) for result in report.results])


def _suite(result: SceneResult, report: RegressionReport) -> JUnitSuite:
    first, *others = _cases(result, updated=report.updated)
    return JUnitSuite(
        name=Path(result.file).stem,
        file=str(Path(report.folder) / result.file),
        cases=(replace(first, seconds=result.seconds), *others),  # one run has all tests
        properties=_properties(result, report),
    )


def _properties(result: SceneResult, report: RegressionReport) -> dict[str, str]:
    values = {"status": result.status.value, "revision": report.revision}
    if result.entry is not None:
        values["simulator"] = result.entry.simulator
    if result.baseline is not None:
        values["baseline revision"] = result.baseline.revision
        values["baseline simulator"] = result.baseline.simulator
    return values


def _cases(result: SceneResult, *, updated: bool) -> Iterator[JUnitTest]:
    if not result.checks:
        # An update of the baseline removes the scenes that are gone from the folder.
        accepted = updated and result.status is Status.MISSING
        end: End = "skipped" if accepted else WITHOUT_VERDICT[result.status]
        yield JUnitTest("verify", end, f"{result.status.value}: {result.reason}", result.reason)
        return
    yield from map(_check_case, result.checks)
    if result.baseline is None:
        yield JUnitTest("baseline", "skipped", "new: not in the baseline")
        return
    lines = remarks(result)
    for group in dict.fromkeys(d.group for d in result.differences):
        changes = [d for d in result.changes if d.group == group]
        yield _group_case(group, changes, lines, accepted=updated or not result.fails)


def _check_case(check: Check) -> JUnitTest:
    value, bound = value_text(check.value, check.unit), value_text(limit(check), check.unit)
    message = f"{check.outcome.value}: {value}, limit {bound}; {check.reason}"
    return JUnitTest(f"check {check.name}", ENDS[check.outcome], message, message)


def _group_case(
    group: str, changes: list[Difference], remarks_: list[str], *, accepted: bool
) -> JUnitTest:
    name = f"baseline {group}"
    if not changes:
        return JUnitTest(name)
    lines = list(map(change_line, changes))
    more = f" and {len(changes) - 1} more" if len(changes) > 1 else ""
    text = "\n".join([*lines, *remarks_])
    return JUnitTest(name, "skipped" if accepted else "failure", lines[0] + more, text)
