"""A run of the stress cases for people and programs: one row per case and engine."""

from __future__ import annotations

import math
from typing import Any

from rich.console import Console
from rich.markup import escape
from rich.text import Text

from taction.verification.evidence.stress.run import CaseRun, Judgement, StressReport
from taction.verification.report.tables import make_table, value_text
from taction.verification.report.verdict.json_document import check_record

TITLES = (
    *("case", "engine", "outcome", "worst quantity", "true error", "stated error"),
    *("outside", "time"),
)
COLOUR = {
    Judgement.RIGHT: "green",
    Judgement.WRONG_OUTCOME: "red",
    Judgement.WRONG_NUMBER: "red",
    Judgement.NOT_RUN: "yellow",
}


def case_row(run: CaseRun) -> tuple[str, ...]:
    """Return the row of one run under the titles `TITLES`.

    The worst quantity is the stated number whose true error is largest in its stated error;
    "outside" counts the numbers whose true error is larger than the stated one.
    """
    worst, seconds = run.worst, value_text(run.seconds, "s", 2)
    if worst is None:
        return run.case.name, run.engine, run.outcome, "-", "-", "-", "-", seconds
    errors = (error_text(error, worst.unit) for error in (worst.error, worst.uncertainty))
    outside = f"{run.outside} of {len(run.comparisons)}"
    return run.case.name, run.engine, run.outcome, worst.name, *errors, outside, seconds


def error_text(error: float, unit: str) -> str:
    """Return an error with its unit and two digits."""
    return "-" if math.isnan(error) else value_text(error, unit, 2)


def print_stress(report: StressReport, console: Console) -> None:
    """Print the table, what is wrong, and the counts."""
    rows: list[list[str | Text]] = []
    for run in report.runs:
        name, engine, outcome, *others = case_row(run)
        coloured = Text(outcome, style=COLOUR[run.judgement])
        rows.append([name, engine, coloured, *others])
    console.print(make_table(TITLES, rows))
    for run in report.wrong:
        line = f"{run.case.name}, {run.engine}: {run.judgement.value}: {run.reason}"
        console.print(f"[red]wrong[/red] {escape(line)}")
    console.print(headline(report))


def headline(report: StressReport) -> str:
    """Return the counts, the time and the versions as one line of text."""
    counts = ", ".join(f"{count} {kind}" for kind, count in report.count().items())
    cases = len({run.case.name for run in report.runs})
    numbers, seconds = report.numbers, sum(run.seconds for run in report.runs)
    versions = ", ".join(f"{name} {version}" for name, version in report.versions)
    return (
        f"{cases} cases, {len(report.runs)} runs: {counts}; {report.outside} of {numbers} numbers"
        f" outside their stated error; {seconds:.0f} s; {versions}"
    )


def stress_document(report: StressReport) -> dict[str, Any]:
    """Return a run as plain data: every case, every stated number and its true value."""
    return {
        "runs": [_record(run) for run in report.runs],
        "count": report.count(),
        "numbers": report.numbers,
        "outside": report.outside,
        "versions": dict(report.versions),
    }


def _record(run: CaseRun) -> dict[str, Any]:
    return {
        "case": run.case.name,
        "family": run.case.family,
        "engine": run.engine,
        "why": run.case.why,
        "known": run.case.known,
        "judgement": run.judgement.value,
        "outcome": run.outcome,
        "right_outcomes": list(run.case.outcome[run.engine]),
        "reason": run.reason,
        "seconds": run.seconds,
        "checks": [check_record(check) for check in run.checks],
        "numbers": [
            {
                "name": c.name,
                "value": c.value,
                "uncertainty": c.uncertainty,
                "truth": c.truth,
                "error": c.error,
                "unit": c.unit,
                "outside": c.outside,
                "wrong": c.wrong,
            }
            for c in run.comparisons
        ],
    }
