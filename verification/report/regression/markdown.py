"""A regression run as Markdown, for a merge request or the summary page of a CI job."""

from __future__ import annotations

from collections.abc import Iterator

from taction.verification.report.regression.text import (
    CHANGES,
    SUMMARY,
    change_rows,
    headline,
    remarks,
    summary_row,
)
from taction.verification.report.tables import markdown_line, markdown_table
from taction.verification.studies.regression.run import RegressionReport, Status


def regression_markdown(report: RegressionReport) -> str:
    """Return a run as Markdown: a table of the scenes, then a table of changes for each."""
    return "\n".join(_lines(report)) + "\n"


def _lines(report: RegressionReport) -> Iterator[str]:
    yield "## taction regress"
    yield ""
    yield markdown_line(headline(report))
    yield ""
    yield from markdown_table(SUMMARY, map(summary_row, report.results))
    for result in report.results:
        rows, lines = change_rows(result), remarks(result)
        if result.status is Status.SAME or not (rows or lines):
            continue
        yield ""
        yield f"### {markdown_line(result.file)}: {result.status.value}"
        yield ""
        yield from (f"- {markdown_line(line)}" for line in lines)
        if rows:
            yield ""
            yield from markdown_table(CHANGES, rows)
