"""``taction accuracy``: error against run time."""

from __future__ import annotations

import click

from cli.common import json_option, print_json, reports_errors, scene_argument


@click.command(short_help="Error against run time over engines, methods and tolerances.")
@scene_argument
@click.option(
    "--budget",
    type=click.FloatRange(min=0.5),
    default=30.0,
    show_default=True,
    help="Wall time that the study should take, s; how much of the transient it runs follows.",
)
@click.option(
    "--plot", type=click.Path(dir_okay=False), help="Draw error against run time (PNG, SVG or PDF)."
)
@json_option
@reports_errors
def accuracy(scene: str, budget: float, plot: str | None, as_json: bool) -> None:
    """Compare every engine, method and setting on SCENE: error against run time."""
    from verification.ideal.lambda_rule import read_scene

    asked = read_scene(scene)
    if plot is not None:
        from verification.report.verdict.plots import check_plot_file

        check_plot_file(plot)
    from verification.report.work_precision.tables import accuracy_document, print_study
    from verification.studies.work_precision.study import run_study

    found = run_study(asked, budget=budget, progress=lambda stage: click.echo(stage, err=True))
    if as_json:
        print_json(accuracy_document(found))
    else:
        from rich.console import Console

        print_study(found, Console(highlight=False))
    if plot is not None:
        from verification.report.work_precision.plot import plot_study

        plot_study(found, plot)
        click.echo(f"drew {plot}", err=True)
