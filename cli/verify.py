"""``taction verify``: from a scene to a verdict."""

from __future__ import annotations

import sys
from dataclasses import asdict
from typing import TYPE_CHECKING, Any

import click

import taction
from cli.common import (
    ENGINE,
    STATUS,
    check_plot,
    console,
    plot_option,
    print_json,
    scene_command,
    stage_display,
)

if TYPE_CHECKING:
    from verification.small_signal.margin import Margin
    from verification.studies.remedies.remedies import Remedies
    from verification.studies.remedies.stable_ranges import StableRange


@scene_command
@ENGINE
@plot_option("outputs, settling band and recovered stress")
@click.option(
    "--margins",
    is_flag=True,
    help="Show by what factor C may shrink and the gain may grow until the board oscillates; of an"
    " unstable board, how far it is from stability in C, gain, stray capacitance and bandwidth.",
)
@click.option(
    "--changes",
    type=click.FloatRange(0),
    default=4.0,
    metavar="SECONDS",
    help="Time limit of the search for changes that mend a failed verdict; 0: no search.",
)
def verify(
    scene: str, engine: str | None, plot: str | None, margins: bool, changes: float, as_json: bool
) -> None:
    """Simulate the board of SCENE, solve its problem, and check the board against the solution.

    A verdict that fails ends with the nearest changes of the design that mend it.
    """
    check_plot(plot)
    with stage_display() as progress:
        verdict = taction.verify(scene, engine=engine, progress=progress)
        remedies = None
        if changes and verdict.outcome.value == "fail":
            from verification.studies.remedies.remedies import find_remedies

            progress("what to change")
            remedies = find_remedies(verdict, changes)
    _show(verdict, as_json, _margins(verdict) if margins else {}, remedies)
    if plot is not None:
        from verification.report.verdict.plots import plot_verdict

        plot_verdict(verdict, plot)
        click.echo(f"drew {plot}", err=True)
    sys.exit(STATUS[verdict.outcome.value])


def _margins(verdict: taction.Verdict) -> dict[str, Margin | StableRange]:
    from verification.engines.statespace.linearised.board import LinearBoard
    from verification.small_signal.margin import capacitance_margin, gain_margin

    board, poles = LinearBoard(verdict.circuit), verdict.poles
    margins: dict[str, Margin | StableRange] = {
        "capacitance": capacitance_margin(board, found=poles),
        "gain": gain_margin(board, found=poles),
    }
    if poles.certain and not poles.stable:
        from verification.studies.remedies.stable_ranges import stable_ranges
        from verification.studies.remedies.trials import Trials

        margins |= {each.path: each for each in stable_ranges(Trials(verdict.scene))}
    return margins


def _show(
    verdict: taction.Verdict,
    as_json: bool,
    margins: dict[str, Margin | StableRange],
    remedies: Remedies | None,
) -> None:
    if as_json:
        from verification.report.verdict.json_document import verdict_document

        document = verdict_document(verdict)
        if margins:
            document["stability"]["margins"] = {n: _record(m) for n, m in margins.items()}
        if remedies is not None:
            from verification.report.verdict.remedies import remedies_document

            document["what_to_change"] = remedies_document(remedies)
        print_json(document)
        return
    from verification.report.verdict.remedies import remedies_text
    from verification.report.verdict.table import print_verdict

    print_verdict(verdict, console())
    if remedies is not None:
        click.echo(remedies_text(verdict.scene, remedies))
    for margin in margins.values():
        click.echo(f"margin: {_margin_text(margin)}")


def _record(margin: Margin | StableRange) -> Any:
    from verification.report.verdict.remedies import range_record
    from verification.studies.remedies.stable_ranges import StableRange

    return range_record(margin) if isinstance(margin, StableRange) else asdict(margin)


def _margin_text(margin: Margin | StableRange) -> str:
    from verification.report.verdict.remedies import distance_text
    from verification.studies.remedies.stable_ranges import StableRange

    if isinstance(margin, StableRange):
        return distance_text(margin)
    return margin.text + (f", but {margin.doubt}" if margin.doubt else "")
