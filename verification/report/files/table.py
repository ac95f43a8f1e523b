"""The verdicts of several files as one table, with the reasons below, and as one document."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

from rich.console import Console
from rich.text import Text

from taction.verification.report.files.reasons import (
    Document,
    largest,
    margin_lines,
    passed_text,
    reasons,
)
from taction.verification.report.tables import make_table, value_text, whole
from taction.verification.studies.verify_files import VerifiedFiles

TITLES = ("scene", "outcome", "checks", "settling", "overshoot", "time")
COLOUR = {"pass": "green", "fail": "red", "bad input": "red"}


def print_files(files: VerifiedFiles, console: Console) -> None:
    """Print a row for each file, then why files do not pass, their warnings and the counts."""
    console.print(make_table(whole(*TITLES), map(_row, files.documents), padding=0))
    for document in files.documents:
        _print_lines(document, console)
    counts = ", ".join(f"{count} {name}" for name, count in files.count().items())
    console.print(Text(f"{len(files.documents)} scenes: {counts}", style="bold"))


def _row(document: Document) -> tuple[str | Text, ...]:
    outcome, timing = document["outcome"], document.get("timing", {})
    return (
        Text(document["file"]),
        Text(outcome, style=COLOUR.get(outcome, "yellow")),
        passed_text(document),
        value_text(document.get("settling_time"), "s"),
        value_text(largest(document, "overshoot"), "step"),
        value_text(timing.get("total"), "s", 3),
    )


def _print_lines(document: Document, console: Console) -> None:
    warnings = [f"warning: {text}" for text in document.get("warnings", ())]
    lines: Sequence[str] = (*reasons(document), *warnings, *margin_lines(document))
    if lines:
        console.print(Text(f"{document['file']}: {document['outcome']}", style="bold"))
    for line in lines:
        console.print(Text(f"  {line}"))


def files_document(files: VerifiedFiles) -> dict[str, Any]:
    """Return the verdicts of all files as plain data; each is the document of a single run."""
    return {
        "outcome": files.outcome,
        "exit_status": files.exit_status,
        "interrupted": files.interrupted,
        "counts": files.count(),
        "verdicts": list(files.documents),
    }
