"""``taction tune``: the design with the least settling time under an overshoot limit."""

from __future__ import annotations

import sys
from typing import TYPE_CHECKING, Any

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
    stage_display,
)

if TYPE_CHECKING:
    from taction.verification.design.tune import Tuning
    from taction.verification.report.html.blocks import Report
    from taction.verification.verdict.verify import Verdict


@scene_command
@click.option(
    "--over",
    default="gain",
    help="Keys to change, each with an optional range: gain,capacitance or gain=1M:10M.",
)
@click.option(
    "--reach",
    type=click.FloatRange(1, 1000, min_open=True),
    default=20.0,
    help="A key without a range goes from its value divided by this factor to its value times it.",
)
@click.option(
    "--overshoot",
    type=click.FloatRange(0, min_open=True),
    help="Largest overshoot, fraction of the step; by default the scene's limit, or 0.05.",
)
@click.option(
    "--margin",
    type=click.FloatRange(1, 100),
    help="Factor by which C must be able to shrink; by default the scene's margin.",
)
@plot_option("settling time against overshoot")
@report_option()
def tune(
    scene: str,
    over: str,
    reach: float,
    overshoot: float | None,
    margin: float | None,
    plot: str | None,
    report: str | None,
    as_json: bool,
) -> None:
    """Find the values with the least settling time, at the scene's lambda, and verify the design.

    The search uses the state-space engine, all checks of the scene, and values that can be bought:
    in the scene's series, else of three digits. The verification decides the exit status; its
    checks include the limits of the search.
    """
    from taction.verification.design.tune import tune as run
    from taction.verification.reference.ideal_answer import read_scene
    from taction.verification.verdict.verify import verify

    requested_scene = read_scene(scene)
    check_plot(plot)
    check_report(report)
    keys = [key.strip() for key in over.split(",") if key.strip()]
    with stage_display() as progress:
        limits = {"overshoot": overshoot, "margin": margin, "reach": reach}
        tuning = run(requested_scene, keys, **limits, progress=progress)
        verdict = verify(tuning.scene, progress)
    if plot is not None:
        from taction.verification.report.tuning_plot import plot_tradeoff

        plot_tradeoff(tuning, plot)
        click.echo(f"drew {plot}", err=True)
    save_report(report, lambda: _page(tuning, verdict))
    if as_json:
        print_json(_document(tuning, verdict))
    else:
        _show(tuning, verdict, reach)
    sys.exit(STATUS[verdict.outcome.value])


def _document(tuning: Tuning, verdict: Verdict) -> dict[str, Any]:
    from taction.verification.report.verdict.json_document import verdict_document

    return {
        "outcome": verdict.outcome.value,
        "before": tuning.before.summary(),
        "after": tuning.after.summary(),
        "resistance": verdict.circuit.value("R"),
        "lambda": verdict.circuit.value("lambda"),
        "overshoot_limit": tuning.overshoot_limit,
        "margin": tuning.margin,
        "tried": tuning.tried,
        "ranges": {each.path: [each.low, each.high] for each in tuning.ranges},
        "at_edges": tuning.at_edges,
        "frontier": [trial.summary() for trial in tuning.frontier],
        "verification": verdict_document(verdict),
    }


def _show(tuning: Tuning, verdict: Verdict, reach: float) -> None:
    from taction.netlist_gen.scene.keys import find_key
    from taction.system.quantities import show, written
    from taction.verification.report.tables import make_table, whole
    from taction.verification.report.verdict.table import print_verdict

    units = {path: find_key(tuning.scene, path).unit for path in tuning.after.values}
    page, rows = console(), []
    for name, candidate in (("before", tuning.before), ("after", tuning.after)):
        values = [show(value, units[path], 5) for path, value in candidate.values.items()]
        settling = show(candidate.settling_time, "s")
        rows.append((name, *values, settling, f"{100 * candidate.overshoot:.3g} %"))
    page.print(make_table(whole("", *tuning.after.values, "settling time", "overshoot"), rows))
    facts, resistance = verdict.circuit.facts, verdict.circuit.value("R")
    page.print(
        f"{tuning.tried} designs tried, {len(tuning.frontier)} on the trade-off curve; lambda stays"
        f" {facts['lambda'].text}, so R = {show(resistance, 'ohm')}. For the scene's table"
        " \\[design]:"
    )
    for path, value in tuning.after.values.items():
        page.print(f"  {path.removeprefix('design.')} = {written(value, units[path])}")
    page.print(f"  resistance = {written(resistance, 'ohm')}")
    for path, edge in tuning.at_edges.items():
        name = path.removeprefix("design.")
        page.print(
            f"{name} is at the edge of its range, {show(edge, units[path])}: a wider range may hold"
            f" a better design, such as --over {name}=LOW:HIGH or --reach {2 * reach:g}"
        )
    print_verdict(verdict, page)


def _page(tuning: Tuning, verdict: Verdict) -> Report:
    from taction.verification.report.html.tuning_report import tuning_report

    return tuning_report(tuning, verdict)
