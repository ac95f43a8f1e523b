"""The paper's reproduction as JSON, as a table, and as a folder with Markdown, HTML and PNG."""

from __future__ import annotations

from pathlib import Path
from typing import Any

from rich.box import SIMPLE_HEAD
from rich.console import Console
from rich.markup import escape
from rich.table import Table

from spice_models.errors import Complaint, InputError
from verification.report.atomic_files import write_atomically
from verification.report.paper.pages import paper_html, paper_markdown
from verification.report.paper.plots import can_draw, draw
from verification.studies.paper.findings import ClaimOutcome
from verification.studies.paper.reproduce import Judged, Reproduction
from verification.studies.running.machine import describe_machine

COLOURS = {
    ClaimOutcome.HOLDS: "green",
    ClaimOutcome.CONDITION: "yellow",
    ClaimOutcome.FAILS: "red",
    ClaimOutcome.NOT_RUN: "magenta",
}
PAGES = ("paper.md", "paper.html")


def paper_document(found: Reproduction) -> dict[str, Any]:
    """Return `found` as plain data, SI base units."""
    return {
        "outcome": found.outcome,
        "quick": found.quick,
        "seconds": found.seconds,
        "machine": describe_machine(),
        "claims": [_record(each) for each in found.judged],
        "left_out": [claim.id for claim in found.left_out],
        "chapters": [{"title": s.title, "seconds": s.seconds} for s in found.sections],
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


def print_paper(found: Reproduction, console: Console) -> None:
    """Print one table a chapter, and what is not as expected at the end."""
    for section in found.sections:
        console.print(f"\n[bold]{escape(section.title)}[/bold] ({section.seconds:.1f} s)")
        table = Table("claim", "printed", "run", "ours", "verdict", box=SIMPLE_HEAD, pad_edge=False)
        for each in section.judged:
            claim, finding = each.claim, each.finding
            colour = COLOURS[finding.outcome]
            table.add_row(
                escape(f"{claim.claim} ({claim.place})"),
                escape(claim.printed),
                escape(finding.run),
                escape(finding.ours),
                f"[{colour}]{finding.outcome.value}[/{colour}]",
            )
        console.print(table)
    if found.left_out:
        names = ", ".join(claim.id for claim in found.left_out)
        console.print(f"left out of a quick run: {names}")
    for each in found.judged:
        if not each.as_expected:
            console.print(
                f"[red]{each.claim.id}[/red]: {each.finding.outcome.value}; expected:"
                f" {each.claim.expected.value}. {escape(each.finding.ours)}"
            )
    console.print(f"{summary(found)} {found.seconds:.0f} s.")


def summary(found: Reproduction) -> str:
    """Return how many claims there are of each verdict."""
    outcomes = [each.finding.outcome for each in found.judged]
    counts = ", ".join(f"{o.value} {outcomes.count(o)}" for o in ClaimOutcome if o in outcomes)
    return f"{len(outcomes)} claims: {counts}."


def check_report_folder(folder: str) -> None:
    """Make `folder` where it is missing, before any work is done.

    Raises
    ------
    InputError
        It is a file, or cannot be made.
    """
    try:
        Path(folder).mkdir(parents=True, exist_ok=True)
    except OSError as error:
        text = f"{error.strerror}; expected a folder that can be written to"
        raise InputError("--output", Complaint("DIR", repr(folder), text)) from None


def write_paper(found: Reproduction, folder: str) -> tuple[str, ...]:
    """Write `PAGES` and their pictures into `folder`; return the files' names.

    Without matplotlib the pages have no pictures. The HTML page holds its pictures itself.

    Raises
    ------
    InputError
        A file cannot be written.
    """
    pictures = [picture for section in found.sections for picture in section.pictures]
    images = {each.name: draw(each) for each in pictures} if can_draw() else {}
    machine = {name: str(value) for name, value in describe_machine().items()}
    texts = (paper_markdown, paper_html)
    for name, page in zip(PAGES, texts, strict=True):
        write_atomically(Path(folder) / name, page(found, images, summary(found), machine))
    for name, image in images.items():
        try:
            (Path(folder) / f"{name}.png").write_bytes(image)
        except OSError as error:
            text = f"{error.strerror}; expected a folder that can be written to"
            raise InputError("--output", Complaint("DIR", repr(folder), text)) from None
    return (*PAGES, *(f"{name}.png" for name in images))
