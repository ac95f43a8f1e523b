"""``taction montecarlo`` and ``taction corners``: what component tolerances do."""

from __future__ import annotations

import sys
from dataclasses import asdict
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
from spice_models.errors import Complaint, InputError

if TYPE_CHECKING:
    from verification.studies.tolerance.varied_board import VariedBoard
    from verification.studies.tolerance.yield_report import Tally, YieldReport

ENGINES = click.Choice(["auto", "ngspice", "statespace"])
JOBS = click.option("--jobs", type=click.IntRange(1, 4096), help="Processes; one a core if absent.")
CLUSTER = click.option("--cluster", metavar="tcp://HOST:PORT", help="Run on this Dask cluster.")


@click.command(short_help="Yield under component tolerances.")
@scene_argument
@click.option("-n", "count", default=1000, show_default=True, type=click.IntRange(1, 10_000_000))
@click.option("--seed", default=1, show_default=True, type=click.IntRange(0))
@click.option("--sample", type=click.IntRange(0), help="Run this one sample alone, in full.")
@click.option("--until", help="Stop when the 95 % interval is ± this narrow: 1% or 0.01.")
@click.option("--min-yield", type=click.FloatRange(0, 1), help="Fail (1) below this yield.")
@click.option("--engine", type=ENGINES, default="statespace", show_default=True)
@click.option(
    "-o",
    "--output",
    type=click.Path(dir_okay=False),
    help="Database of the samples, kept as they come; a later run goes on from there.",
)
@JOBS
@CLUSTER
@json_option
@reports_errors
def montecarlo(scene: str, count: int, seed: int, as_json: bool, **options: Any) -> None:
    """Verify SCENE with components drawn from its [tolerances], and tell the yield.

    Ends with 0, or where --min-yield is given with 0, 1 or 3 as the whole 95 % interval lies above
    it, below it, or the samples do not decide.
    """
    from verification.ideal.lambda_rule import read_scene
    from verification.studies.tolerance.drawing import half_width
    from verification.studies.tolerance.varied_board import prepare
    from verification.studies.tolerance.yield_report import Tally, report

    width = half_width(options["until"])
    study = prepare(read_scene(scene, options["engine"]))
    if options["sample"] is not None:
        _one(study, seed, options["sample"], as_json)
        return
    tally = Tally(count, width)
    interrupted = _draw(study, seed, tally, options)
    found = report(study, tally.samples, seed)
    if as_json:
        document = {"scene": study.scene.name, "engine": study.scene.analysis.engine, "seed": seed}
        print_json(document | {"complete": not interrupted} | asdict(found))
    else:
        from verification.report.tolerance.tables import print_yield

        print_yield(found, seed)
    if interrupted:
        sys.exit(130)
    sys.exit(_status(found, options["min_yield"]))


@click.command(short_help="Worst cases within the tolerances, or a list of one's own.")
@scene_argument
@click.option(
    "--corner",
    "own",
    multiple=True,
    metavar="KEY=Z,...",
    help="A corner of your own, in tolerances: capacitor=-1,opamp_gbw=-1,Rf_3_5=1. Repeatable.",
)
@click.option("--engine", type=ENGINES, default=None, help="Instead of the scene's own.")
@JOBS
@CLUSTER
@json_option
@reports_errors
def corners(
    scene: str, own: tuple[str, ...], engine: str | None, as_json: bool, **options: Any
) -> None:
    """Verify SCENE at the corners of its [tolerances].

    Ends with 1 if one of them fails, else with 3 if one of them has no verdict.
    """
    from verification.ideal.lambda_rule import read_scene
    from verification.report.tolerance.tables import print_corners
    from verification.studies.running.executors import workers_at
    from verification.studies.tolerance.corners import named_corner, worst_corners
    from verification.studies.tolerance.varied_board import prepare, quantities

    asked = read_scene(scene, engine)
    wanted = [(text, _ends(text)) for text in own]
    if wanted:
        study = prepare(asked, full_margin=True)
        found = tuple(named_corner(study, text, ends) for text, ends in wanted)
    else:
        where = workers_at(options["cluster"], options["jobs"])
        with where as workers, stage_display() as progress:
            found = worst_corners(asked, workers, progress)
    if as_json:
        print_json({"scene": asked.name, "corners": [asdict(corner) for corner in found]})
    else:
        print_corners(found, quantities(asked))
    outcomes = {corner.result.outcome for corner in found}
    sys.exit(STATUS[next((o for o in ("fail", "inconclusive") if o in outcomes), "pass")])


def _draw(study: VariedBoard, seed: int, tally: Tally, options: dict[str, Any]) -> bool:
    """Draw what is missing; return whether Ctrl-C ended it."""
    from verification.studies.running.executors import workers_at
    from verification.studies.tolerance.drawing import draw_samples

    workers = workers_at(options["cluster"], options["jobs"])
    try:
        with stage_display() as progress:
            draw_samples(study, seed, tally, workers, options["output"], progress)
    except KeyboardInterrupt:
        click.echo("taction: interrupted; this is what there is", err=True)
        return True
    return False


def _one(study: VariedBoard, seed: int, number: int, as_json: bool) -> None:
    """Judge one sample as in the batch, then run it as a full verification."""
    from netlist_gen.board.variation import draw, vary
    from verification.report.verdict.json_document import verdict_document
    from verification.studies.tolerance.varied_board import evaluate
    from verification.verify import verify

    tolerances = study.scene.tolerances
    z = draw(tolerances, len(study.varied), seed, number)
    board = vary(study.nominal, tolerances, z)
    verdict = verify(study.scene, problem=study.problem, circuit=board, ideal=study.ideal)
    if as_json:
        sample = asdict(evaluate(study, number, z))
        deviations = {p.name: float(v) for p, v in zip(study.varied, z, strict=True)}
        head = {"seed": seed, "sample": sample, "deviations": deviations}
        print_json(head | verdict_document(verdict))
    else:
        from rich.console import Console

        from verification.report.verdict.table import print_verdict

        print_verdict(verdict, Console(highlight=False))
    sys.exit(STATUS[verdict.outcome.value])


def _status(found: YieldReport, wanted: float | None) -> int:
    if wanted is None or found.low >= wanted:
        return STATUS["pass"]
    return STATUS["fail"] if found.high < wanted else STATUS["inconclusive"]


def _ends(text: str) -> dict[str, float]:
    ends = {}
    for part in text.split(","):
        name, _, value = part.partition("=")
        try:
            number = float(value)
        except ValueError:
            number = float("inf")
        if not abs(number) <= 100:
            accepted = "expected KEY=Z with Z in tolerances, such as capacitor=-1"
            raise InputError("--corner", Complaint("KEY=Z", repr(part), accepted))
        ends[name.strip()] = number
    return ends
