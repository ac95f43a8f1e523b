"""``taction onset``: every stability crossing over a range, confirmed by transients."""

from __future__ import annotations

import sys

import click

import taction
from cli.common import (
    STATUS,
    json_option,
    print_json,
    reports_errors,
    scene_argument,
    stage_display,
)


@click.command(short_help="Every stability crossing over a range, confirmed by transients.")
@scene_argument
@click.option(
    "--over",
    required=True,
    metavar="KEY[=LOW:HIGH:N]",
    help="C, gain, stray_capacitance, any number of the scene; alone: its value / 30 to * 30.",
)
@click.option(
    "--confirm/--no-confirm",
    "transients",
    default=True,
    help="Run ngspice on both sides of each crossing (the default).",
)
@click.option(
    "--plot",
    type=click.Path(dir_okay=False),
    help="Draw the pole map and the root locus (PNG, SVG or PDF).",
)
@json_option
@reports_errors
def onset(scene: str, over: str, transients: bool, plot: str | None, as_json: bool) -> None:
    """Find where the board of SCENE begins or ceases to oscillate as one value changes.

    Ends with 0 when answered, whatever the answer, and with 3 where a transient contradicts it.
    """
    from verification.report.onset.tables import onset_document, print_onset

    if plot is not None:
        from verification.report.verdict.plots import check_plot_file

        check_plot_file(plot)
    with stage_display() as progress:
        found = taction.onset(scene, over=over, transients=transients, progress=progress)
    if as_json:
        print_json(onset_document(found))
    else:
        from rich.console import Console

        print_onset(found, Console(highlight=False))
    if plot is not None:
        from verification.report.onset.plot import plot_onset

        plot_onset(found, plot)
        click.echo(f"drew {plot}", err=True)
    sys.exit(STATUS["inconclusive"] if found.disagreement else 0)
