"""``taction onset``: every stability crossing over a range, confirmed by transients."""

from __future__ import annotations

import sys
from typing import TYPE_CHECKING

import click

import taction
from taction.cli.common import (
    STATUS,
    ask_axes,
    check_plot,
    check_report,
    console,
    plot_option,
    print_json,
    report_option,
    save_report,
    scene_command,
    stage_display,
)

if TYPE_CHECKING:
    from taction.verification.report.html.blocks import Report
    from taction.verification.studies.onset.onset import Onset


@scene_command
@click.option(
    "--over",
    required=True,
    metavar="KEY[=LOW:HIGH:N]",
    help="Key to change: C, gain, stray_capacitance or any other number of the scene. Without a"
    " range: from 1/30 to 30 times the scene's own value.",
)
@click.option(
    "--confirm/--no-confirm",
    "transients",
    default=True,
    help="Run ngspice on both sides of each crossing.",
)
@plot_option("the pole map and the root locus")
@report_option()
def onset(
    scene: str, over: str, transients: bool, plot: str | None, report: str | None, as_json: bool
) -> None:
    """Find every value of a key at which the board of SCENE begins or ceases to oscillate.

    Exit status: 0 if the question was answered, 3 if a transient contradicts a crossing.
    """
    from taction.verification.report.onset.tables import onset_document, print_onset

    check_plot(plot)
    check_report(report)
    with stage_display() as progress:
        result = taction.onset(scene, over=over, transients=transients, progress=progress)
    ask_axes(result.scene, [[result.axis]])
    if plot is not None:  # before the text: its reader may go
        from taction.verification.report.onset.plot import plot_onset

        plot_onset(result, plot)
        click.echo(f"drew {plot}", err=True)
    save_report(report, lambda: _page(result))
    if as_json:
        print_json(onset_document(result))
    else:
        print_onset(result, console())
    sys.exit(STATUS["inconclusive"] if result.disagreement else 0)


def _page(result: Onset) -> Report:
    from taction.verification.report.html.onset_report import onset_report

    return onset_report(result)
