"""``taction verify``: from a scene to a verdict."""

from __future__ import annotations

import sys
from dataclasses import asdict
from typing import TYPE_CHECKING

import click

import taction
from cli.common import (
    ENGINE,
    STATUS,
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
    from verification.report.html.blocks import Report
    from verification.small_signal.margin import Margin


@scene_command
@ENGINE
@plot_option("outputs, settling band and recovered stress")
@report_option()
@click.option(
    "--margins",
    is_flag=True,
    help="Show by what factor C may shrink and the gain may grow until the board oscillates.",
)
def verify(
    scene: str,
    engine: str | None,
    plot: str | None,
    report: str | None,
    margins: bool,
    as_json: bool,
) -> None:
    """Simulate the board of SCENE, solve its problem, and check the board against the solution."""
    check_plot(plot)
    check_report(report)
    with stage_display() as progress:
        verdict = taction.verify(scene, engine=engine, progress=progress)
    _show(verdict, as_json, _margins(verdict) if margins else {})
    if plot is not None:
        from verification.report.verdict.plots import plot_verdict

        plot_verdict(verdict, plot)
        click.echo(f"drew {plot}", err=True)
    save_report(report, lambda: _report(verdict))
    sys.exit(STATUS[verdict.outcome.value])


def _report(verdict: taction.Verdict) -> Report:
    from verification.report.html.verdict_report import verdict_report

    return verdict_report(verdict)


def _margins(verdict: taction.Verdict) -> dict[str, Margin]:
    from verification.engines.statespace.linearised.board import LinearBoard
    from verification.small_signal.margin import capacitance_margin, gain_margin

    board, poles = LinearBoard(verdict.circuit), verdict.poles
    capacitance = capacitance_margin(board, found=poles)
    return {"capacitance": capacitance, "gain": gain_margin(board, found=poles)}


def _show(verdict: taction.Verdict, as_json: bool, margins: dict[str, Margin]) -> None:
    if as_json:
        from verification.report.verdict.json_document import verdict_document

        document = verdict_document(verdict)
        if margins:
            found = {name: asdict(margin) for name, margin in margins.items()}
            document["stability"]["margins"] = found
        print_json(document)
        return
    from verification.report.verdict.table import print_verdict

    print_verdict(verdict, console())
    for margin in margins.values():
        doubt = f", but {margin.doubt}" if margin.doubt else ""
        click.echo(f"margin: {margin.text}{doubt}")
