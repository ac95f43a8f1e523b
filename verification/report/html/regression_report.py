"""The report of a regression run: every scene, what changed, and by how much."""

from __future__ import annotations

import math
from collections.abc import Iterator

from taction.system.quantities import readable
from taction.verification.report.html.blocks import Bars, Block, Cell, Notes, Report, Section, Table
from taction.verification.report.html.sections.checks import check_bar
from taction.verification.report.html.sections.origin import plain_origin
from taction.verification.report.regression.text import (
    CHANGES,
    SUMMARY,
    headline,
    off_text,
    remarks,
    summary_row,
    value_text,
)
from taction.verification.report.verdict.json_document import check_record
from taction.verification.studies.regression.run import RegressionReport, SceneResult, Status

OUTCOMES = {
    Status.SAME: "pass",
    Status.NEWLY_PASSING: "pass",
    Status.NEW: "inconclusive",
    Status.NOT_RUN: "inconclusive",
    Status.NO_VERDICT: "inconclusive",
}
EXITS = {0: "pass", 1: "fail"}


def regression_report(report: RegressionReport) -> Report:
    """Return the report of a regression run."""
    revision = (("revision", report.revision), ("baseline", report.baseline))
    scenes = [
        Section(f"{result.file}: {result.status.value}", tuple(_scene(result)))
        for result in report.results
    ]
    return Report(
        title=report.folder,
        command="taction regress",
        outcome=EXITS.get(report.exit_status, "inconclusive"),
        summary=headline(report),
        lines=("The run was interrupted.",) if report.interrupted else (),
        sections=(
            Section("Scenes", (_summary(report),)),
            *(section for section in scenes if section.blocks),
            plain_origin(revision),
        ),
    )


def _summary(report: RegressionReport) -> Table:
    rows = tuple(_summary_cells(result) for result in report.results)
    return Table("Scenes", (*SUMMARY[:1], "outcome", *SUMMARY[1:]), rows)


def _summary_cells(result: SceneResult) -> tuple[Cell, ...]:
    scene, status, checks, worst, *others = summary_row(result)
    off = result.worst if result.differences and math.isfinite(result.worst) else None
    outcome = OUTCOMES.get(result.status, "fail")
    mark = Cell(outcome, None, outcome)
    return Cell(scene), mark, Cell(status), Cell(checks), Cell(worst, off), *map(Cell, others)


def _scene(result: SceneResult) -> Iterator[Block]:
    lines = remarks(result)
    if result.status is Status.SAME or not (result.changes or lines):
        return
    if lines:
        yield Notes("", tuple(map(readable, lines)))
    if result.changes:
        rows = tuple(
            (
                Cell(each.label),
                Cell(readable(value_text(each.second, each.unit))),
                Cell(readable(value_text(each.first, each.unit))),
                Cell(readable(value_text(each.allowed, each.unit))),
                Cell(off_text(each.off), each.off if math.isfinite(each.off) else None),
                Cell(each.note),
            )
            for each in result.changes
        )
        yield Table("Changes", CHANGES, rows)
    if result.checks:
        yield Bars("Checks", tuple(check_bar(check_record(check)) for check in result.checks))
