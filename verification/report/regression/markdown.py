"""A regression run as Markdown, for a merge request or the summary page of a CI job."""

from __future__ import annotations

import re
from collections.abc import Iterable, Iterator, Sequence

from verification.report.regression.text import (
    CHANGES,
    SUMMARY,
    change_rows,
    headline,
    remarks,
    summary_row,
)
from verification.studies.regression.run import RegressionReport, Status

SPECIAL = re.compile(r"([\\`*_{}\[\]<>#|~&])")


def regression_markdown(report: RegressionReport) -> str:
    """Return a run as Markdown: a table of scenes, then a table of what changed in each."""
    return "\n".join(_lines(report)) + "\n"


def _lines(report: RegressionReport) -> Iterator[str]:
    yield "## taction regress"
    yield ""
    yield _escape(headline(report))
    yield ""
    yield from _table(SUMMARY, map(summary_row, report.results))
    for result in report.results:
        rows, said = change_rows(result), remarks(result)
        if result.status is Status.SAME or not (rows or said):
            continue
        yield ""
        yield f"### {_escape(result.file)}: {result.status.value}"
        yield ""
        yield from (f"- {_escape(line)}" for line in said)
        if rows:
            yield ""
            yield from _table(CHANGES, rows)


def _table(titles: Sequence[str], rows: Iterable[Sequence[str]]) -> Iterator[str]:
    yield _row(titles)
    yield _row(["---"] * len(titles))
    for row in rows:
        yield _row([_escape(cell) for cell in row])


def _row(cells: Sequence[str]) -> str:
    return f"| {' | '.join(cells)} |"


def _escape(text: str) -> str:
    """Return `text` as one line that Markdown leaves alone."""
    return SPECIAL.sub(r"\\\1", " ".join(text.split()))
