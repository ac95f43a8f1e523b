"""``taction tune``: least settling time under a limit on overshoot, verified by the whole loop."""

from __future__ import annotations

import sys
from typing import TYPE_CHECKING, Any

import click

from cli.common import (
    STATUS,
    json_option,
    print_json,
    reports_errors,
    scene_argument,
    stage_display,
)

if TYPE_CHECKING:
    from verification.studies.tune import Candidate, Tuning
    from verification.verify import Verdict


@click.command(short_help="Gain for least settling time under an overshoot limit.")
@scene_argument
@click.option("--over", default="gain", show_default=True, help="Keys, such as gain,capacitance.")
@click.option(
    "--overshoot",
    type=click.FloatRange(0, min_open=True),
    help="Limit, fraction of the step; else the scene's own, else 0.05.",
)
@click.option(
    "--margin",
    type=click.FloatRange(1, 100),
    help="Factor by which C may shrink; else the scene's own.",
)
@click.option("--plot", type=click.Path(dir_okay=False), help="Draw the trade-off (PNG, SVG, PDF).")
@json_option
@reports_errors
def tune(
    scene: str,
    over: str,
    overshoot: float | None,
    margin: float | None,
    plot: str | None,
    as_json: bool,
) -> None:
    """Tune SCENE by the state-space engine, holding lambda; verify what was found.

    The verification checks the limits as well; its outcome decides the exit status.
    """
    from verification.ideal.lambda_rule import read_scene
    from verification.studies.tune import tune as run
    from verification.verify import verify

    asked = read_scene(scene)
    if plot is not None:
        from verification.report.verdict.plots import check_plot_file

        check_plot_file(plot)
    keys = [key.strip() for key in over.split(",") if key.strip()]
    with stage_display() as progress:
        tuning = run(asked, keys, overshoot=overshoot, margin=margin, progress=progress)
        verdict = verify(tuning.scene, progress)
    if plot is not None:
        from verification.report.tuning_plot import plot_tradeoff

        plot_tradeoff(tuning, plot)
        click.echo(f"drew {plot}", err=True)
    if as_json:
        print_json(_document(tuning, verdict))
    else:
        _show(tuning, verdict)
    sys.exit(STATUS[verdict.outcome.value])


def _document(tuning: Tuning, verdict: Verdict) -> dict[str, Any]:
    from verification.report.verdict.json_document import verdict_document

    return {
        "outcome": verdict.outcome.value,
        "before": _record(tuning.before),
        "after": _record(tuning.after),
        "resistance": verdict.circuit.scalings.resistance,
        "lambda": verdict.circuit.scalings.lam,
        "overshoot_limit": tuning.overshoot_limit,
        "margin": tuning.margin,
        "tried": tuning.tried,
        "frontier": [_record(candidate) for candidate in tuning.frontier],
        "verification": verdict_document(verdict),
    }


def _record(candidate: Candidate) -> dict[str, Any]:
    return {
        "values": candidate.values,
        "settling_time": candidate.settling_time,
        "overshoot": candidate.overshoot,
        "stable": candidate.stable,
    }


def _show(tuning: Tuning, verdict: Verdict) -> None:
    from rich.box import SIMPLE_HEAD
    from rich.console import Console
    from rich.table import Table

    from netlist_gen.quantities import show
    from verification.report.verdict.table import print_verdict

    console = Console(highlight=False)
    table = Table("", *tuning.after.values, "settling time", "overshoot", box=SIMPLE_HEAD)
    for name, candidate in (("before", tuning.before), ("after", tuning.after)):
        values = [f"{value:.5g}" for value in candidate.values.values()]
        settling = show(candidate.settling_time, "s")
        table.add_row(name, *values, settling, f"{100 * candidate.overshoot:.3g} %")
    console.print(table)
    scalings = verdict.circuit.scalings
    console.print(
        f"{tuning.tried} designs tried, {len(tuning.frontier)} on the trade-off; lambda held at"
        f" {scalings.lam:.4g}, so R = {show(scalings.resistance, 'ohm')}. The scene's \\[design]:"
    )
    for path, value in tuning.after.values.items():
        console.print(f"  {path.removeprefix('design.')} = {value!r}")
    console.print(f"  resistance = {scalings.resistance!r}")
    print_verdict(verdict, console)
