"""``taction regress``: every scene of a folder against a stored baseline."""

from __future__ import annotations

import sys
from collections.abc import Callable
from typing import TYPE_CHECKING

import click

from taction.cli.common import (
    JOBS,
    STATUS,
    check_report,
    command,
    console,
    print_json,
    report_option,
    stage_display,
    write_all,
)

if TYPE_CHECKING:
    from taction.verification.studies.regression.run import RegressionReport


@command
@click.argument("folder", metavar="DIR", type=click.Path())
@click.option(
    "--baseline", required=True, type=click.Path(), metavar="FILE", help="Stored results (JSON)."
)
@click.option("--update", is_flag=True, help="Write changed results into the baseline.")
@click.option("--junit", type=click.Path(), metavar="FILE", help="Write a JUnit XML report.")
@click.option("--markdown", type=click.Path(), metavar="FILE", help="Write a Markdown summary.")
@report_option()
@JOBS
def regress(
    folder: str,
    baseline: str,
    update: bool,
    junit: str | None,
    markdown: str | None,
    report: str | None,
    jobs: int | None,
    as_json: bool,
) -> None:
    """Verify every scene (*.toml) in DIR and compare the results with the baseline.

    Exit status: 1 if a check failed, or if a result differs from the baseline by more than the
    scene's table [regression] allows. --update accepts differences, but no failed check.
    """
    from pathlib import Path

    from taction.verification.report.junit import regression_junit
    from taction.verification.report.output_checks import check_folder
    from taction.verification.report.regression.markdown import regression_markdown
    from taction.verification.studies.regression.baseline import baseline_text, load_baseline
    from taction.verification.studies.regression.run import regress as run
    from taction.verification.studies.regression.run import updated_baseline

    check_folder(baseline, "--baseline")
    check_report(report)
    entries = {} if update and not Path(baseline).exists() else load_baseline(baseline)
    with stage_display() as progress:
        result = run(folder, baseline, entries, updated=update, jobs=jobs, progress=progress)
    texts: dict[str, Callable[[], str]] = {}
    if update:
        texts[baseline] = lambda: baseline_text(updated_baseline(result, entries))
    if junit is not None:
        texts[junit] = lambda: regression_junit(result)
    if markdown is not None:
        texts[markdown] = lambda: regression_markdown(result)
    if report is not None:
        from taction.verification.report.html.file import report_html
        from taction.verification.report.html.regression_report import regression_report

        texts[report] = lambda: report_html(regression_report(result))
    written = write_all(texts)
    _show(result, as_json)
    if result.interrupted:
        click.echo("taction: interrupted; the finished scenes are in the report", err=True)
    sys.exit(result.exit_status if written else STATUS["bad input"])


def _show(report: RegressionReport, as_json: bool) -> None:
    if as_json:
        from taction.verification.report.regression.text import regression_document

        print_json(regression_document(report))
        return
    from taction.verification.report.regression.text import print_regression

    print_regression(report, console())
