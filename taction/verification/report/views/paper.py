"""The reproduction of the paper: every claim beside what taction finds, and a folder of all."""

from __future__ import annotations

import importlib.util
import re
from collections.abc import Iterator
from pathlib import Path

import numpy as np

from taction.system.atomic_files import write_atomically
from taction.verification.evidence.paper.findings import ClaimOutcome
from taction.verification.evidence.paper.pictures import Panel, PaperCurve
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
from taction.verification.report.charts import (
    SERIES,
    Axis,
    Chart,
    Curve,
    Limit,
    Line,
    Outcome,
    Scale,
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
MANY = 400  # points above which a line is thin
# The parts of a style of the paper's curves: colour, mark and line, as in "C0o-".
STYLE = re.compile(r"(?P<colour>C\d|k)?(?P<mark>[os*x])?(?P<line>--|-\.|-|:)?")
COLOUR = {"k": "ink", "": SERIES[0]} | {f"C{k}": colour for k, colour in enumerate(SERIES)}
MARK = {"o": "circle", "s": "square", "*": "star", "x": "x"}
LINE: dict[str, Line] = {"-": "solid", "--": "dash", "-.": "dashdot", ":": "dot"}


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
    for picture in chapter.pictures:
        yield from (panel_chart(panel, picture.caption) for panel in picture.panels)


def panel_chart(panel: Panel, caption: str) -> Chart:
    """Return one panel of a picture; `caption` is that of the whole picture."""
    x, y = (_scale(panel, name) for name in "xy")
    levels = (
        Limit(level, "y", f"{text}: {level:.3g}", SERIES[k], "dash")
        for k, (level, text) in enumerate(panel.marks, 1)
    )
    named = sum(bool(curve.label) for curve in panel.curves) + len(panel.marks)
    return Chart(
        panel.title,
        Axis(panel.x, scale=x),
        Axis(panel.y, scale=y, limits=panel.limits),
        (*map(_curve, panel.curves), *levels),
        summary=caption,
        legend="inside" if named <= 2 else "below",
        height=330,
    )


def _scale(panel: Panel, name: str) -> Scale:
    return "log" if name in panel.logs else "linear"


def _curve(curve: PaperCurve) -> Curve:
    found = STYLE.fullmatch(curve.style)
    if found is None:
        raise ValueError(f"no style of a curve: {curve.style!r}")
    parts = {name: text or "" for name, text in found.groupdict().items()}
    return Curve(
        np.asarray(curve.x),
        np.asarray(curve.y),
        curve.label,
        COLOUR[parts["colour"]],
        LINE.get(parts["line"], ""),
        MARK.get(parts["mark"], ""),
        width=0.6 if len(curve.x) > MANY else 1.4,
        size=5.0,
        label="legend" if curve.label else "",
    )


MARKDOWN, HTML = "paper.md", "paper.html"
PAGES = (MARKDOWN, HTML)


def write_paper(result: Reproduction, folder: str) -> tuple[str, ...]:
    """Write `PAGES` and their pictures into `folder`; return the files' names.

    Without the packages of ``taction[report]`` there is no HTML page, and without matplotlib there
    are no pictures.

    Raises
    ------
    InputError
        A file cannot be written.
    """
    page, names = view(result), list[str]()
    images: dict[str, list[tuple[str, str]]] = {}
    if importlib.util.find_spec("matplotlib") is not None:
        for section in result.sections:
            for picture in section.pictures:
                charts = [panel_chart(panel, picture.caption) for panel in picture.panels]
                draw_blocks(picture.caption, charts, path=Path(folder) / f"{picture.name}.png")
                names.append(f"{picture.name}.png")
                images.setdefault(section.title, []).append((names[-1], picture.caption))
    text = markdown(page, medium=TERMINAL, images=images)
    machine = (f"- {name}: {line(str(value))}" for name, value in describe_machine().items())
    write_atomically(Path(folder) / MARKDOWN, "\n".join((text, *machine)) + "\n")
    if all(importlib.util.find_spec(name) for name in PACKAGES):
        write_page(page, str(Path(folder) / HTML))
        return (MARKDOWN, HTML, *names)
    return (MARKDOWN, *names)
