"""The verdicts of several files: a row for each, then why files do not pass."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping
from dataclasses import replace
from typing import Any

from taction.system.charts import OUTCOMES, Outcome
from taction.system.documents import read
from taction.verification.report.blocks import BOTH, Cell, Notes, Page, Section, Table
from taction.verification.report.texts import counted, number_cell, outcome_cell
from taction.verification.report.views.answer_view import margin_lines
from taction.verification.studies.scene_files import VerifiedFiles
from taction.verification.verdict.cause import band_text, causes
from taction.verification.verdict.checks import Check

Document = Mapping[str, Any]


def view(files: VerifiedFiles) -> Page:
    """Return the page of the verdicts of several files."""
    counts = ", ".join(f"{count} {name}" for name, count in files.count().items())
    columns = {
        "scene": lambda each: each["file"],
        "outcome": lambda each: outcome_cell(each["outcome"], _outcome(each["outcome"])),
        "checks": _passed,
        "settling": _settling,
        "overshoot": lambda each: number_cell(_largest(each, "overshoot"), "step"),
        "time": lambda each: number_cell(each.get("timing", {}).get("total"), "s", 3),
    }
    remarks = (
        Notes(f"{each['file']}: {each['outcome']}", tuple(_lines(each))) for each in files.documents
    )
    return Page(
        title=counted(len(files.documents), "scene"),
        command="taction verify",
        outcome=_outcome(files.outcome),
        last_line=files.outcome,
        summary=f"{counted(len(files.documents), 'scene')}: {counts}",
        sections=(
            Section("Scenes", (Table.of("Scenes", files.documents, columns),), media=BOTH),
            Section("Remarks", tuple(remarks), media=BOTH),
        ),
    )


def _settling(document: Document) -> Cell:
    """Return a settling time with its band, which each file has of its own."""
    checks = checks_of(document) if "checks" in document else ()
    cell = number_cell(document.get("settling_time"), "s")
    bands = filter(None, map(band_text, checks))
    return cell if cell.number is None else replace(cell, text=" ".join((cell.text, *bands)))


def _outcome(name: str) -> Outcome:
    """Return the outcome whose look a file has: bad input looks like a failure."""
    return name if name in OUTCOMES else "fail" if name == "bad input" else "inconclusive"


def _lines(document: Document) -> Iterator[str]:
    yield from reasons(document)
    yield from (f"warning: {text}" for text in document.get("warnings", ()))
    yield from margin_lines(document)


def reasons(document: Document) -> Iterator[str]:
    """Yield why a file does not pass: each cause, or its error.

    Examples
    --------
    >>> check = {"name": "rise_time", "outcome": "fail", "value": 3e-6, "expected": 2e-6}
    >>> list(reasons({"outcome": "fail", "checks": [check | {"unit": "s"}]}))
    ['rises in 3 us (limit: at most 2 us)']
    """
    if "error" in document:
        yield document["error"]["message"]
    if "checks" in document:
        yield from (found.text for found in causes(checks_of(document)))


def checks_of(document: Document) -> tuple[Check, ...]:
    """Return the checks of a verdict's document."""
    return tuple(read(Check, check) for check in document["checks"])


def _passed(document: Document) -> str:
    """Return how many checks pass; a dash where there is no verdict."""
    checks = document.get("checks")
    if not checks:
        return "–"
    return f"{sum(check['outcome'] == 'pass' for check in checks)} of {len(checks)} pass"


def _largest(document: Document, name: str) -> float | None:
    """Return the largest `name` of the channels; None without one, or for a board that grows."""
    if document.get("stability", {}).get("stable") is not True:
        return None
    values = [channel[name] for channel in document.get("channels", ())]
    known = [value for value in values if value is not None and math.isfinite(value)]
    return max(known, default=None)
