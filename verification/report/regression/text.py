"""A regression run as text: the rows that all its reports share, the table, the JSON document."""

from __future__ import annotations

import math
from typing import Any

from rich.console import Console
from rich.markup import escape
from rich.table import Column
from rich.text import Text

from taction.system.documents import plain
from taction.verification.report import tables
from taction.verification.report.verdict.json_document import check_record
from taction.verification.studies.regression.run import RegressionReport, SceneResult, Status
from taction.verification.verdict.compare import Difference

SHOWN = 12  # changed quantities of a scene in a table; JSON has them all
LEAST_OFF = 1e-3  # tolerances: a smaller difference has no number
SUMMARY = ("scene", "status", "checks", "tolerances off", "simulator", "baseline from")
CHANGES = ("what", "value", "baseline", "tolerance", "tolerances off", "note")
COLOUR = {
    Status.SAME: "green",
    Status.NEWLY_PASSING: "green",
    Status.NEW: "cyan",
    Status.NOT_RUN: "yellow",
    Status.NO_VERDICT: "yellow",
}


def summary_row(result: SceneResult) -> tuple[str, ...]:
    """Return the row of one scene under the titles `SUMMARY`."""
    passed = sum(check.outcome.value == "pass" for check in result.checks)
    checks = f"{passed} of {len(result.checks)} pass" if result.checks else "-"
    worst = off_text(result.worst) if result.differences else "-"
    simulator = result.entry.solved_by.partition(",")[0] if result.entry else "-"
    revision = short(result.baseline.revision) if result.baseline else "-"
    scene = result.file.removesuffix(".toml")
    return scene, result.status.value, checks, worst, simulator, revision


def change_rows(result: SceneResult) -> list[tuple[str, ...]]:
    """Return at most `SHOWN` changed quantities under the titles `CHANGES`."""
    rows: list[tuple[str, ...]] = [
        (
            d.label,
            value_text(d.second, d.unit),
            value_text(d.first, d.unit),
            value_text(d.allowed, d.unit),
            off_text(d.off),
            d.note,
        )
        for d in result.changes[:SHOWN]
    ]
    more = len(result.changes) - SHOWN
    return [*rows, (f"and {more} more (--json has all)", "", "", "", "", "")] if more > 0 else rows


def change_line(d: Difference) -> str:
    """Return a changed quantity as one line of text."""
    text = f"{d.label}: {value_text(d.second, d.unit)}, baseline {value_text(d.first, d.unit)}"
    if d.allowed is not None:
        text += f", tolerance {value_text(d.allowed, d.unit)}, {off_text(d.off)} tolerances off"
    return f"{text} ({d.note})" if d.note else text


def remarks(result: SceneResult) -> list[str]:
    """Return the failed checks, the reason and the notes of a scene, one line each."""
    failed = [c for c in result.checks if c.outcome.value == "fail"]
    lines = [f"check {tables.spaced(c.name)} fails: {c.reason}" for c in failed]
    return [*lines, *([result.reason] if result.reason else []), *result.notes]


def headline(report: RegressionReport) -> str:
    """Return the counts of the run as one line of text."""
    counts = ", ".join(f"{count} {status}" for status, count in report.count().items())
    text = f"{report.folder} against {report.baseline}: {counts}"
    return text if report.revision == "unknown" else f"{text}; at {short(report.revision)}"


def short(revision: str) -> str:
    """Return the first twelve digits of a commit."""
    return revision if revision == "unknown" else revision[:12]


def off_text(off: float) -> str:
    """Return a difference in tolerances, or "differs" for values that cannot be compared."""
    if 0.0 < off < LEAST_OFF:
        return f"under {LEAST_OFF:g}"
    return f"{off:.3g}" if math.isfinite(off) else "differs"


def value_text(value: float | str | None, unit: str) -> str:
    """Return a value with its unit and six digits; a dash for a missing value."""
    return tables.value_text(value, "" if unit == "step" else unit, 6)


def print_regression(report: RegressionReport, console: Console) -> None:
    """Print the scenes, then the changes of each scene."""
    rows: list[list[str | Text]] = []
    for result in report.results:
        file, status, *others = map(escape, summary_row(result))
        rows.append([file, Text(status, style=COLOUR.get(result.status, "red")), *others])
    titles = [*tables.whole(*SUMMARY)]
    titles[3:6:2] = map(Column, SUMMARY[3:6:2])  # titles of two words may wrap
    console.print(tables.make_table(titles, rows, padding=0))
    for result in report.results:
        _print_scene(result, console)
    console.print(Text(headline(report), style="bold"))


def _print_scene(result: SceneResult, console: Console) -> None:
    rows, lines = change_rows(result), remarks(result)
    if result.status is Status.SAME or not (rows or lines):
        return
    console.print(Text(f"{result.file}: {result.status.value}", style="bold"))
    for line in lines:
        console.print(Text(f"  {line}"))
    if rows:
        console.print(tables.make_table(CHANGES, [[*map(escape, row)] for row in rows]))


def regression_document(report: RegressionReport) -> dict[str, Any]:
    """Return a run as plain data in SI base units; `off` is infinite for values of other kinds."""
    return {
        "exit_status": report.exit_status,
        "folder": report.folder,
        "baseline": report.baseline,
        "revision": report.revision,
        "updated": report.updated,
        "interrupted": report.interrupted,
        "counts": report.count(),
        "scenes": [_record(result) for result in report.results],
    }


def _record(result: SceneResult) -> dict[str, Any]:
    then, now = result.baseline, result.entry
    return {
        "file": result.file,
        "status": result.status.value,
        "outcome": now.record.outcome if now else None,
        "reason": result.reason,
        "notes": list(result.notes),
        "simulator": now.solved_by if now else None,
        "baseline": then
        and {
            "outcome": then.record.outcome,
            "revision": then.revision,
            "taction": then.taction,
            "simulator": then.solved_by,
            "fingerprint": then.fingerprint,
        },
        "worst": result.worst if result.differences else None,
        "checks": [check_record(check) for check in result.checks],
        "differences": [plain(each) for each in result.differences],
        "seconds": result.seconds,
    }
