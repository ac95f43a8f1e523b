"""A regression run: every scene, what changed, and by how much."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Sequence
from functools import partial
from typing import Any

from taction.system.charts import Outcome
from taction.verification.report.blocks import (
    BOTH,
    PAGE,
    TERMINAL,
    Bars,
    Block,
    Cell,
    Notes,
    Page,
    Section,
    Table,
)
from taction.verification.report.texts import outcome_cell, readable, value_text
from taction.verification.report.views.answer_view import check_bar
from taction.verification.report.views.origin_view import origin_section
from taction.verification.studies.regression.regress import RegressionReport, SceneResult, Status
from taction.verification.verdict.cause import causes
from taction.verification.verdict.compare import Difference

SHOWN = 12  # changed quantities of a scene in a terminal; the page and JSON have them all
LEAST_OFF = 1e-3  # tolerances: a smaller difference has no number
OUTCOMES: dict[Status, Outcome] = {
    Status.SAME: "pass",
    Status.NEWLY_PASSING: "pass",
    Status.NEW: "inconclusive",
    Status.NOT_RUN: "inconclusive",
    Status.NO_VERDICT: "inconclusive",
}
EXITS: dict[int, Outcome] = {0: "pass", 1: "fail"}


def view(report: RegressionReport) -> Page:
    """Return the page of a regression run."""
    revision = (("revision", report.commit.revision), ("baseline", _baseline(report)))
    changes = tuple(block for each in report.results for block in _scene(each, TERMINAL))
    scenes = (
        Section(f"{result.file}: {result.status.value}", tuple(_scene(result, PAGE)))
        for result in report.results
    )
    return Page(
        title=report.folder,
        command="taction regress",
        outcome=EXITS.get(report.exit_status, "inconclusive"),
        summary=headline(report),
        lines=(
            *(("The run was interrupted.",) if report.interrupted else ()),
            *((f"Not stored, a check fails: {', '.join(report.left)}.",) if report.left else ()),
        ),
        sections=(
            Section("Scenes", (_scenes(report.results),), media=BOTH),
            Section("Changes", changes, media=(TERMINAL,)),
            *scenes,
            origin_section(None, revision),
        ),
    )


def _scenes(results: Sequence[SceneResult]) -> Table:
    columns = {
        "scene": lambda each: each.file.removesuffix(".toml"),
        "status": lambda each: outcome_cell(each.status.value, OUTCOMES.get(each.status, "fail")),
        "checks": _passing,
        "tolerances off": lambda each: None if each.worst is None else _off(each.worst),
        "simulator": lambda each: each.entry and each.entry.solved_by.partition(",")[0],
        "baseline from": lambda each: each.baseline and _short(each.baseline.revision),
    }
    return Table.of("Scenes", results, columns)


def _passing(result: SceneResult) -> str | None:
    """Return how many checks pass; None without a verdict."""
    passed = sum(check.outcome.value == "pass" for check in result.checks)
    return f"{passed} of {len(result.checks)} pass" if result.checks else None


def _scene(result: SceneResult, medium: str) -> Iterator[Block]:
    """Yield what changed in a scene; a terminal shows the largest changes."""
    lines = remarks(result)
    if result.status is Status.SAME or not (result.changes or lines):
        return
    name = f"{result.file}: {result.status.value}" if medium == TERMINAL else ""
    if lines or name:
        yield Notes(name, tuple(map(readable, lines)))
    columns: dict[str, Callable[[Difference], Any]] = {
        "what": lambda each: each.label,
        **{title: partial(_stored, name=name) for title, name in VALUES.items()},
        "times": lambda each: _off(each.off),
        "note": lambda each: each.note,
    }
    title, most = "" if name else "Changes", {TERMINAL: SHOWN}
    note = "" if medium == TERMINAL else "Times: the difference over the tolerance."
    yield Table.of(title, result.changes, columns, note, most, "and {} more (--json has all)")
    if result.checks and medium == PAGE:
        yield Bars("Checks", tuple(check_bar(check) for check in result.checks))


VALUES = {
    "value": "second", "baseline": "first", "difference": "difference", "tolerance": "allowed",
}  # fmt: skip


def _stored(change: Difference, name: str) -> str:
    return readable(stored_value(getattr(change, name), change.unit))


def _off(off: float) -> Cell:
    return Cell(off_text(off), off if math.isfinite(off) else None)


def change_line(change: Difference) -> str:
    """Return a changed quantity as one line of text."""
    now, then = stored_value(change.second, change.unit), stored_value(change.first, change.unit)
    text = f"{change.label}: {now}, baseline {then}"
    if change.allowed is not None:
        text += f", tolerance {stored_value(change.allowed, change.unit)}"
        text += f", {off_text(change.off)} tolerances off"
    return f"{text} ({change.note})" if change.note else text


def remarks(result: SceneResult) -> list[str]:
    """Return what explains the changes of a scene, and why it does not pass, in lines."""
    reasons = [found.text for found in causes(result.checks)] if result.checks else [result.reason]
    return [*result.notes, *filter(None, reasons)]


def changes_line(changes: Sequence[Difference]) -> str:
    """Return the first of changed quantities, and how many more there are."""
    more = f" and {len(changes) - 1} more" if len(changes) > 1 else ""
    return change_line(changes[0]) + more


def headline(report: RegressionReport) -> str:
    """Return the counts of the run as one line of text."""
    counts = ", ".join(f"{count} {status}" for status, count in report.count().items())
    text = f"{report.folder} against {_baseline(report)}: {counts}"
    return f"{text}; at {report.commit.text}" if report.commit.text else text


def _baseline(report: RegressionReport) -> str:
    """Return the file of the baseline and its commit."""
    return report.baseline + (f" of {report.written.text}" if report.written.text else "")


def _short(revision: str) -> str:
    """Return the first twelve digits of a commit."""
    return revision if revision == "unknown" else revision[:12]


def off_text(off: float) -> str:
    """Return a difference in tolerances, or "differs" for values that cannot be compared."""
    if 0.0 < off < LEAST_OFF:
        return f"under {LEAST_OFF:g}"
    return f"{off:.3g}" if math.isfinite(off) else "differs"


def stored_value(value: float | str | None, unit: str) -> str:
    """Return a value with its unit and six digits; a dash for a missing value."""
    return value_text(value, "" if unit == "step" else unit, 6)
