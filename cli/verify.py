"""``taction verify``: the main job."""

from __future__ import annotations

import sys
from typing import TYPE_CHECKING

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

if TYPE_CHECKING:
    from taction import Verdict
    from verification.small_signal.margin import Margin


@click.command(short_help="Netlist, transient, measurements, reference, verdict.")
@scene_argument
@json_option
@click.option("--engine", type=click.Choice(["auto", "ngspice", "statespace"]), default=None)
@click.option(
    "--plot",
    type=click.Path(dir_okay=False),
    help="Draw outputs, settling band and recovered stress (PNG, SVG or PDF).",
)
@click.option(
    "--margins",
    is_flag=True,
    help="Say how much smaller C, and how much larger gain, to the next stability crossing.",
)
@reports_errors
def verify(scene: str, as_json: bool, engine: str | None, plot: str | None, margins: bool) -> None:
    """Verify SCENE: simulate its board, solve its problem, compare, judge."""
    if plot is not None:
        from verification.report.verdict.plots import check_plot_file

        check_plot_file(plot)
    with stage_display() as progress:
        verdict = taction.verify(scene, engine=engine, progress=progress)
    _show(verdict, as_json, _margins(verdict) if margins else {})
    if plot is not None:
        from verification.report.verdict.plots import plot_verdict

        plot_verdict(verdict, plot)
        click.echo(f"drew {plot}", err=True)
    sys.exit(STATUS[verdict.outcome.value])


def _margins(verdict: Verdict) -> dict[str, Margin]:
    from verification.small_signal.margin import capacitance_margin, gain_margin

    board = verdict.circuit
    return {"capacitance": capacitance_margin(board), "gain": gain_margin(board)}


def _show(verdict: Verdict, as_json: bool, margins: dict[str, Margin]) -> None:
    if as_json:
        from verification.report.verdict.json_document import verdict_document

        document = verdict_document(verdict)
        if margins:
            found = {name: {"factor": m.factor, "text": m.text} for name, m in margins.items()}
            document["stability"]["margins"] = found
        print_json(document)
        return
    from rich.console import Console

    from verification.report.verdict.table import print_verdict

    print_verdict(verdict, Console(highlight=False))
    for margin in margins.values():
        click.echo(f"margin: {margin.text}")
