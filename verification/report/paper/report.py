"""The paper's reproduction as JSON, as a table, and as a folder with Markdown, HTML and PNG."""

from __future__ import annotations

from pathlib import Path
from typing import Any

from rich.console import Console
from rich.markup import escape
from rich.text import Text

from taction.system.atomic_files import write_atomically
from taction.system.errors import Complaint, InputError
from taction.verification.evidence.paper.findings import ClaimOutcome
from taction.verification.evidence.paper.reproduce import Judged, Reproduction
from taction.verification.report.paper.pages import paper_html, paper_markdown
from taction.verification.report.paper.plots import can_draw, draw
from taction.verification.report.tables import make_table
from taction.verification.studies.running.machine import describe_machine

COLOURS = {
    ClaimOutcome.HOLDS: "green",
    ClaimOutcome.FITTED: "blue",
    ClaimOutcome.CONDITION: "yellow",
    ClaimOutcome.FAILS: "red",
    ClaimOutcome.NOT_RUN: "magenta",
}
PAGES = ("paper.md", "paper.html")


def paper_document(result: Reproduction) -> dict[str, Any]:
    """Return `result` as plain data, SI base units."""
    return {
        "outcome": result.outcome,
        "quick": result.quick,
        "seconds": result.seconds,
        "machine": describe_machine(),
        "claims": [_record(each) for each in result.judged],
        "left_out": [claim.id for claim in result.left_out],
        "chapters": [{"title": s.title, "seconds": s.seconds} for s in result.sections],
    }


def _record(each: Judged) -> dict[str, Any]:
    claim, finding = each.claim, each.finding
    return {
        "id": claim.id,
        "claim": claim.claim,
        "place": claim.place,
        "run": finding.run,
        "printed": claim.printed,
        "ours": finding.ours,
        "verdict": finding.outcome.value,
        "expected": claim.expected.value,
        "as_expected": each.as_expected,
        "values": finding.values,
    }


def print_paper(result: Reproduction, console: Console) -> None:
    """Print one table for each chapter, and the unexpected verdicts at the end."""
    for section in result.sections:
        console.print(f"\n[bold]{escape(section.title)}[/bold] ({section.seconds:.1f} s)")
        titles = ("claim", "printed", "run", "ours", "verdict")
        console.print(make_table(titles, map(_row, section.judged)))
    if result.left_out:
        names = ", ".join(claim.id for claim in result.left_out)
        console.print(f"left out of a quick run: {names}")
    for each in result.judged:
        if not each.as_expected:
            console.print(
                f"[red]{each.claim.id}[/red]: {each.finding.outcome.value}; expected:"
                f" {each.claim.expected.value}. {escape(each.finding.ours)}"
            )
    console.print(f"{summary(result)} {result.seconds:.0f} s.")


def _row(each: Judged) -> list[str | Text]:
    claim, finding = each.claim, each.finding
    texts = (f"{claim.claim} ({claim.place})", claim.printed, finding.run, finding.ours)
    outcome = finding.outcome
    return [*map(escape, texts), Text(outcome.value, style=COLOURS[outcome])]


def summary(result: Reproduction) -> str:
    """Return the number of claims with each verdict."""
    outcomes = [each.finding.outcome for each in result.judged]
    counts = ", ".join(f"{o.value} {outcomes.count(o)}" for o in ClaimOutcome if o in outcomes)
    return f"{len(outcomes)} claims: {counts}."


def check_report_folder(folder: str) -> None:
    """Make a missing `folder`, before any work is done.

    Raises
    ------
    InputError
        `folder` is a file, or cannot be made.
    """
    try:
        Path(folder).mkdir(parents=True, exist_ok=True)
    except OSError as error:
        text = f"{error.strerror}; expected a folder that can be written to"
        raise InputError("--output", Complaint("DIR", repr(folder), text)) from None


def write_paper(result: Reproduction, folder: str) -> tuple[str, ...]:
    """Write `PAGES` and their pictures into `folder`; return the files' names.

    Without matplotlib the pages have no pictures. The HTML page holds its pictures itself.

    Raises
    ------
    InputError
        A file cannot be written.
    """
    pictures = [picture for section in result.sections for picture in section.pictures]
    images = {each.name: draw(each) for each in pictures} if can_draw() else {}
    machine = {name: str(value) for name, value in describe_machine().items()}
    texts = (paper_markdown, paper_html)
    for name, page in zip(PAGES, texts, strict=True):
        write_atomically(Path(folder) / name, page(result, images, summary(result), machine))
    for name, image in images.items():
        write_atomically(Path(folder) / f"{name}.png", image)
    return (*PAGES, *(f"{name}.png" for name in images))
