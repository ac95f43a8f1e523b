"""``taction montecarlo`` and ``taction corners``: the effects of component tolerances."""

from __future__ import annotations

import sys
from dataclasses import asdict, replace
from functools import partial
from typing import TYPE_CHECKING, Any

import click

from taction.cli.common import (
    CLUSTER,
    ENGINE,
    ENGINES,
    JOBS,
    STATUS,
    EngineChoice,
    check_plot,
    check_report,
    console,
    output_option,
    plot_option,
    print_json,
    report_option,
    save_report,
    say,
    scene_command,
    stage_display,
)
from taction.system.documents import plain
from taction.system.errors import Complaint, InputError

if TYPE_CHECKING:
    from taction.netlist_gen.scene.scene import Scene
    from taction.verification.report.html.blocks import Report
    from taction.verification.studies.tolerance.corners import CornerStudy
    from taction.verification.studies.tolerance.varied_board import VariedBoard
    from taction.verification.studies.tolerance.yield_report import YieldReport


@scene_command
@click.option(
    "-n",
    "--samples",
    "count",
    default=1000,
    type=click.IntRange(1, 10_000_000),
    help="Most samples to draw.",
)
@click.option("--seed", default=1, type=click.IntRange(0), help="Seed of the samples.")
@click.option("--sample", type=click.IntRange(0), help="Verify only the sample with this number.")
@click.option(
    "--until", help="Stop when the half width of the 95 % interval is below this: 1% or 0.01."
)
@click.option("--min-yield", type=click.FloatRange(0, 1), help="Smallest yield that passes.")
@click.option(
    "--remedy/--no-remedy",
    default=True,
    help="Below a yield of 99 %, find what to buy better, and draw 300 samples again with it.",
)
@click.option(
    "--engine", type=EngineChoice(ENGINES), default="statespace", help="Engine of all samples."
)
@output_option("Database that stores every sample; a later run computes only the missing ones.")
@plot_option("histograms with limits, and the components behind the spread,")
@report_option()
@JOBS
@CLUSTER
def montecarlo(scene: str, count: int, seed: int, as_json: bool, **options: Any) -> None:
    """Verify SCENE with random components within its [tolerances] and estimate the yield.

    Exit status with --min-yield: 0 if the whole 95 % interval of the yield lies above that value,
    1 if it lies below, else 3. Without --min-yield: 0.
    """
    from taction.verification.reference.ideal_answer import read_scene
    from taction.verification.studies.running.executors import workers_at
    from taction.verification.studies.tolerance.drawing import (
        SampleCollection,
        draw_samples,
        half_width,
    )
    from taction.verification.studies.tolerance.remedy import TARGET
    from taction.verification.studies.tolerance.remedy_search import verified_remedy
    from taction.verification.studies.tolerance.varied_board import prepare
    from taction.verification.studies.tolerance.yield_report import summarise_samples

    check_plot(options["plot"])
    check_report(options["report"])
    tally = SampleCollection(count, half_width(options["until"]))
    study = prepare(read_scene(scene, options["engine"]))
    if options["sample"] is not None:
        _verify_sample(study, seed, options["sample"], as_json, options["report"])
        return
    interrupted, remedy = False, None
    workers = partial(workers_at, options["cluster"], options["jobs"], say)
    place, target = options["output"], max(TARGET, options["min_yield"] or 0.0)
    try:
        with stage_display() as progress:
            draw_samples(study, seed, tally, workers(), place, progress)
            if options["remedy"]:
                ask = partial(verified_remedy, target=target, output=place, progress=progress)
                remedy = ask(study, tally.samples, seed, workers)
    except KeyboardInterrupt:
        click.echo("taction: interrupted; the report holds the finished samples", err=True)
        interrupted = True
    if tally.damaged:
        numbers = ", ".join(map(str, tally.damaged))
        click.echo(f"taction: damaged in the database, computed again: samples {numbers}", err=True)
    result = replace(summarise_samples(study, tally.samples, seed), remedy=remedy)
    if options["plot"] is not None:  # before the text: its reader may go
        from taction.verification.report.tolerance.yield_plot import plot_yield

        plot_yield(study.scene.name, result, tally.samples, options["plot"])
        click.echo(f"drew {options['plot']}", err=True)
    if options["report"] is not None:
        from taction.verification.report.html.yield_report import yield_report

        page = yield_report(study.scene, result, tally.samples, seed)
        save_report(options["report"], lambda: page)
    if as_json:
        document = {"scene": study.scene.name, "engine": study.scene.analysis.engine, "seed": seed}
        print_json(document | {"complete": not interrupted} | asdict(result))
    else:
        from taction.verification.report.tolerance.tables import print_yield

        print_yield(result, seed, console())
    sys.exit(130 if interrupted else _status(result, options["min_yield"]))


@scene_command
@click.option(
    "--corner",
    "named",
    multiple=True,
    metavar="KEY=Z,...",
    help="Verify this corner only, in units of the tolerances: capacitor=-1,opamp_gbw=-1,Rf_3_5=1."
    " Repeat the option for several corners.",
)
@ENGINE
@report_option()
@JOBS
@CLUSTER
def corners(
    scene: str, named: tuple[str, ...], engine: str | None, as_json: bool, **options: Any
) -> None:
    """Verify SCENE with the components at the ends of their [tolerances].

    Exit status: 1 if a corner fails, else 3 if a corner has no verdict.
    """
    from taction.verification.reference.ideal_answer import read_scene
    from taction.verification.report.tolerance.tables import (
        DIRECTION,
        print_corners,
        print_directions,
    )
    from taction.verification.studies.running.executors import workers_at
    from taction.verification.studies.tolerance.corners import (
        CornerStudy,
        named_corner,
        worst_corners,
    )
    from taction.verification.studies.tolerance.varied_board import prepare, quantities

    check_report(options["report"])
    requested_scene = read_scene(scene, engine)
    deviations = [(text, _deviations(text)) for text in named]
    if named:
        study = prepare(requested_scene, full_margin=True)
        found = CornerStudy(tuple(named_corner(study, text, ends) for text, ends in deviations))
    else:
        pool = workers_at(options["cluster"], options["jobs"], say)
        with pool as workers, stage_display() as progress:
            found = worst_corners(requested_scene, workers, progress)
    save_report(options["report"], lambda: _corners_page(requested_scene, found))
    if as_json:
        directions = [{name: getattr(d, name) for name in DIRECTION} for d in found.directions]
        records = [plain(corner) for corner in found.corners]
        print_json({"scene": requested_scene.name, "corners": records, "directions": directions})
    else:
        print_corners(found.corners, quantities(requested_scene), console())
        if found.directions:
            print_directions(found.directions, console())
    outcomes = {corner.result.outcome for corner in found.corners}
    bad = "fail" if "fail" in outcomes else "inconclusive"
    sys.exit(STATUS["pass" if outcomes == {"pass"} else bad])


def _verify_sample(
    study: VariedBoard, seed: int, number: int, as_json: bool, report: str | None
) -> None:
    """Verify one sample in full; JSON also holds the sample as the study evaluates it."""
    from taction.netlist_gen.board.variation import draw, vary
    from taction.verification.report.verdict.json_document import verdict_document
    from taction.verification.studies.tolerance.varied_board import evaluate
    from taction.verification.verdict.verify import verify

    tolerances = study.scene.tolerances
    z = draw(tolerances, len(study.varied), seed, number)
    board = vary(study.nominal, tolerances, z)
    verdict = verify(study.scene, problem=study.problem, circuit=board, ideal=study.ideal)
    if report is not None:
        from taction.verification.report.html.verdict_report import verdict_report

        save_report(
            report, lambda: verdict_report(verdict, f"taction montecarlo --sample {number}")
        )
    if as_json:
        sample = plain(evaluate(study, number, z))
        deviations = {p.name: float(v) for p, v in zip(study.varied, z, strict=True)}
        head = {"seed": seed, "sample": sample, "deviations": deviations}
        print_json(head | verdict_document(verdict), "montecarlo-sample")
    else:
        from taction.verification.report.verdict.table import print_verdict

        print_verdict(verdict, console())
    sys.exit(STATUS[verdict.outcome.value])


def _status(result: YieldReport, min_yield: float | None) -> int:
    if min_yield is None or result.low >= min_yield:
        return STATUS["pass"]
    return STATUS["fail"] if result.high < min_yield else STATUS["inconclusive"]


def _deviations(text: str) -> dict[str, float]:
    """Return the deviation of each key of a corner, in units of its tolerance."""
    deviations = {}
    for part in text.split(","):
        name, _, value = part.partition("=")
        try:
            number = float(value)
        except ValueError:
            number = float("inf")
        if not abs(number) <= 100:
            accepted = "expected KEY=Z, Z from -100 to 100 in units of the tolerance: capacitor=-1"
            raise InputError("--corner", Complaint("KEY=Z", repr(part), accepted))
        deviations[name.strip()] = number
    return deviations


def _corners_page(scene: Scene, found: CornerStudy) -> Report:
    from taction.verification.report.html.corners_report import corners_report

    return corners_report(scene, found)
