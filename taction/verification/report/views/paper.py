"""The reproduction of the paper: every claim beside what taction finds, and a folder of all."""

from __future__ import annotations

import importlib.util
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path

from taction.system.atomic_files import write_atomically
from taction.system.charts import Outcome
from taction.verification.evidence.paper.findings import ClaimOutcome
from taction.verification.evidence.paper.reproduce import Judged, Reproduction
from taction.verification.evidence.paper.reproduce import PaperSection as Chapter
from taction.verification.report.blocks import (
    BOTH,
    TERMINAL,
    Block,
    Cell,
    Notes,
    Page,
    Section,
    Table,
)
from taction.verification.report.output_checks import PACKAGES
from taction.verification.report.renderers.markdown import line, markdown
from taction.verification.report.renderers.page import write_page
from taction.verification.report.renderers.picture import draw_blocks
from taction.verification.report.texts import outcome_cell
from taction.verification.report.views.origin import origin_section
from taction.verification.studies.running.versions import describe_machine

TITLE = "The paper, claim by claim"
SOURCE = (
    "Y. C. Pati, P. S. Krishnaprasad and M. C. Peckerar, Neural network solutions to problems in"
    " early taction"
)
OUTCOMES: dict[ClaimOutcome, Outcome] = {
    ClaimOutcome.HOLDS: "pass",
    ClaimOutcome.FITTED: "pass",
    ClaimOutcome.CONDITION: "inconclusive",
    ClaimOutcome.FAILS: "fail",
    ClaimOutcome.NOT_RUN: "error",
}


def view(result: Reproduction) -> Page:
    """Return the page of the reproduction."""
    chapters = []
    columns = {
        "claim": lambda each: each.claim.claim,
        "verdict": _verdict,
        "place": lambda each: each.claim.place,
        "what was run": lambda each: each.finding.run,
        "printed": lambda each: each.claim.printed,
        "ours": lambda each: each.finding.ours,
    }
    for chapter in result.sections:
        table = Table.of(chapter.title, chapter.judged, columns)
        chapters.append(Section(chapter.title, (table,), media=BOTH))
        if chapter.pictures:
            chapters.append(Section(f"{chapter.title}: pictures", tuple(_charts(chapter))))
    names = ", ".join(claim.id for claim in result.left_out)
    left_out = Notes("", (names,)) if names else None
    return Page(
        title=TITLE,
        command="taction reproduce",
        outcome=result.outcome,
        summary=f"{summary(result)} {result.seconds:.0f} s.",
        lines=(f"{SOURCE}.",),
        sections=(
            *chapters,
            Section("Left out of a quick run", (left_out,), media=BOTH),
            Section("Unexpected", (_unexpected(result),), media=BOTH),
            origin_section(None),
        ),
    )


def summary(result: Reproduction) -> str:
    """Return the number of claims with each verdict."""
    outcomes = [each.finding.outcome for each in result.judged]
    counts = ", ".join(f"{o.value} {outcomes.count(o)}" for o in ClaimOutcome if o in outcomes)
    return f"{len(outcomes)} claims: {counts}."


def _verdict(each: Judged) -> Cell:
    text = each.finding.outcome.value
    if not each.as_expected:
        text += f" (expected: {each.claim.expected.value})"
    return outcome_cell(text, OUTCOMES[each.finding.outcome])


def _unexpected(result: Reproduction) -> Notes:
    lines = (
        f"{each.claim.id}: {each.finding.outcome.value}; expected: {each.claim.expected.value}."
        f" {each.finding.ours}"
        for each in result.judged
        if not each.as_expected
    )
    return Notes("", tuple(lines), "fail")


def _charts(chapter: Chapter) -> Iterator[Block]:
    """Yield the charts of all pictures; the caption is that of the whole picture."""
    for picture in chapter.pictures:
        yield from (replace(chart, summary=picture.caption) for chart in picture.charts)


MARKDOWN, HTML = "paper.md", "paper.html"
PAGES = (MARKDOWN, HTML)


def write_paper(result: Reproduction, folder: str) -> tuple[str, ...]:
    """Write `PAGES` and their pictures into `folder`; return the files' names.

    Without the packages of ``taction[report]`` there is no HTML page, and without matplotlib there
    are no pictures. InputError: a file cannot be written.
    """
    page, names = view(result), list[str]()
    images: dict[str, list[tuple[str, str]]] = {}
    if importlib.util.find_spec("matplotlib") is not None:
        for section in result.sections:
            for picture in section.pictures:
                file = Path(folder) / f"{picture.name}.png"
                draw_blocks(picture.caption, picture.charts, path=file)
                names.append(f"{picture.name}.png")
                images.setdefault(section.title, []).append((names[-1], picture.caption))
    text = markdown(page, medium=TERMINAL, images=images)
    machine = (f"- {name}: {line(str(value))}" for name, value in describe_machine().items())
    write_atomically(Path(folder) / MARKDOWN, "\n".join((text, *machine)) + "\n")
    if all(importlib.util.find_spec(name) for name in PACKAGES):
        write_page(page, str(Path(folder) / HTML))
        return (MARKDOWN, HTML, *names)
    return (MARKDOWN, *names)
