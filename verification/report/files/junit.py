"""The verdicts of several files as JUnit XML: a suite a scene, a test a check."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path

from taction.verification.report.files.reasons import Document
from taction.verification.report.junit import End, JUnitSuite, JUnitTest, junit_text
from taction.verification.report.tables import value_text
from taction.verification.studies.verify_files import NOT_RUN, VerifiedFiles

ENDS: dict[str, End] = {"pass": "", "fail": "failure", "inconclusive": "error", NOT_RUN: "skipped"}


def files_junit(files: VerifiedFiles) -> str:
    """Return the verdicts as JUnit XML."""
    return junit_text("taction verify", list(map(_suite, files.documents)))


def _suite(document: Document) -> JUnitSuite:
    first, *others = _cases(document)
    properties = {"outcome": document["outcome"]}
    if "simulator" in document:
        properties["simulator"] = document["simulator"]
    return JUnitSuite(
        name=Path(document["file"]).stem,
        file=document["file"],
        cases=(replace(first, seconds=document.get("timing", {}).get("total", 0.0)), *others),
        properties=properties,
    )


def _cases(document: Document) -> Iterator[JUnitTest]:
    for check in document.get("checks", ()):
        tolerance = check["tolerance"]
        limit = check["expected"] if tolerance is None else tolerance
        value, bound = (value_text(number, check["unit"]) for number in (check["value"], limit))
        text = f"{check['outcome']}: {value}, limit {bound}; {check['reason']}"
        yield JUnitTest(f"check {check['name']}", ENDS[check["outcome"]], text, text)
    if "checks" not in document:
        outcome = document["outcome"]
        text = document.get("error", {}).get("message", "interrupted")
        yield JUnitTest("verify", ENDS.get(outcome, "error"), f"{outcome}: {text}", text)
