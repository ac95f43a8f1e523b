"""``taction accuracy``: error against run time."""

from __future__ import annotations

import sys
from typing import TYPE_CHECKING

import click

from taction.cli.common import (
    STATUS,
    check_plot,
    check_report,
    console,
    plot_option,
    print_json,
    report_option,
    save_report,
    scene_command,
)

if TYPE_CHECKING:
    from taction.verification.report.html.blocks import Report
    from taction.verification.studies.work_precision.study import WorkPrecisionStudy


@scene_command
@click.option(
    "--budget",
    type=click.FloatRange(min=0.5),
    default=30.0,
    help="Wall time for the study, s; with less time a shorter part of the transient is run.",
)
@plot_option("error against run time")
@report_option()
def accuracy(
    scene: str, budget: float, plot: str | None, report: str | None, as_json: bool
) -> None:
    """Compare the error and the run time of every engine, method and setting on SCENE.

    Exit status: 3 if no run of the board ended within the budget.
    """
    from taction.verification.reference.ideal_answer import read_scene

    requested_scene = read_scene(scene)
    check_plot(plot)
    check_report(report)
    from taction.verification.report.work_precision.tables import accuracy_document, print_study
    from taction.verification.studies.work_precision.study import run_study

    result = run_study(requested_scene, budget=budget, progress=lambda s: click.echo(s, err=True))
    if plot is not None:
        from taction.verification.report.work_precision.plot import plot_study

        plot_study(result, plot)
        click.echo(f"drew {plot}", err=True)
    save_report(report, lambda: _page(result))
    if as_json:
        print_json(accuracy_document(result))
    else:
        print_study(result, console())
    if not result.conclusive:
        click.echo(
            "taction: no run of the board has a known error; give a larger --budget", err=True
        )
        sys.exit(STATUS["inconclusive"])


def _page(result: WorkPrecisionStudy) -> Report:
    from taction.verification.report.html.accuracy_report import accuracy_report

    return accuracy_report(result)
