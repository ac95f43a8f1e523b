"""``taction montecarlo`` and ``taction corners``: what component tolerances do."""

from __future__ import annotations

import json
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import asdict
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from cli.output import json_option, print_json, reports_errors, scene_argument, stage_display
from spice_models.errors import Complaint, InputError

if TYPE_CHECKING:
    from netlist_gen.scene import Scene
    from verification.studies.corners import Corner
    from verification.studies.montecarlo import Sample, YieldReport

ENGINES = click.Choice(["auto", "ngspice", "statespace"])


@click.command(short_help="Yield under component tolerances.")
@scene_argument
@click.option("-n", "count", default=1000, show_default=True, type=click.IntRange(1, 10_000_000))
@click.option("--seed", default=1, show_default=True, type=click.IntRange(0))
@click.option("--sample", type=click.IntRange(0), help="Run this one sample alone, in full.")
@click.option("--until", help="Stop when the 95 % interval is ± this narrow: 1% or 0.01.")
@click.option("--min-yield", type=click.FloatRange(0, 1), help="Fail (1) below this yield.")
@click.option("--engine", type=ENGINES, default="statespace", show_default=True)
@click.option("-o", "--output", type=click.Path(dir_okay=False), help="Samples, JSON lines; kept"
              " as they come, and a later run goes on from there.")  # fmt: skip
@click.option("--jobs", type=click.IntRange(1, 4096), help="Processes; one a core by default.")
@click.option("--cluster", metavar="tcp://HOST:PORT", help="Run on this Dask cluster instead.")
@json_option
@reports_errors
def montecarlo(scene: str, count: int, seed: int, as_json: bool, **options: Any) -> None:
    """Verify SCENE with components drawn from its [tolerances], and tell the yield."""
    from cli.scenes import read_scene
    from verification.studies.montecarlo import LEAST_SAMPLES, interval, report

    asked = read_scene(scene, options["engine"])
    if options["sample"] is not None:
        _one(asked, seed, options["sample"], as_json)
        return
    width = _fraction(options["until"])
    kept = _stored(options["output"], asked, seed)

    def enough(sample: Sample) -> bool:
        kept[sample.number] = sample
        if width is None or len(kept) < LEAST_SAMPLES:
            return False
        passed = sum(s.outcome == "pass" for s in kept.values())
        low, high = interval(passed, len(kept))
        return 0.5 * (high - low) <= width

    _draw(asked, range(count), seed, kept, enough, options)
    samples = [s for s in kept.values() if s.number < count]
    found = report(asked, samples)
    if as_json:
        print_json({"scene": asked.name, "seed": seed, **asdict(found)})
    else:
        _show_yield(found, seed)
    wanted = options["min_yield"]
    if wanted is not None and not found.low >= wanted:
        sys.exit(1 if found.high < wanted else 3)


@click.command(short_help="Worst cases within the tolerances, or a list of one's own.")
@scene_argument
@click.option(
    "--corner",
    "own",
    multiple=True,
    metavar="KEY=Z,...",
    help="A corner of your own, in tolerances: capacitor=-1,opamp_gbw=-1,Rf_3_5=1. Repeatable.",
)
@click.option("--engine", type=ENGINES, default=None)
@json_option
@reports_errors
def corners(scene: str, own: tuple[str, ...], engine: str | None, as_json: bool) -> None:
    """Verify SCENE at the corners of its [tolerances]; ends with 1 if one of them fails."""
    from cli.scenes import read_scene
    from verification.studies.corners import named_corner, worst_corners

    asked = read_scene(scene, engine)
    wanted = [(text, _ends(text)) for text in own]
    with stage_display() as progress:
        if wanted:
            found = tuple(named_corner(asked, text, ends) for text, ends in wanted)
        else:
            found = worst_corners(asked, progress)
    if as_json:
        print_json({"scene": asked.name, "corners": [asdict(corner) for corner in found]})
    else:
        _show_corners(found)
    outcomes = {corner.result.outcome for corner in found}
    sys.exit(1 if "fail" in outcomes else 3 if "inconclusive" in outcomes else 0)


def _draw(
    scene: Scene,
    numbers: range,
    seed: int,
    kept: dict[int, Sample],
    enough: Any,
    options: dict[str, Any],
) -> None:
    from verification.studies.executors import cluster, local
    from verification.studies.montecarlo import run_samples

    missing = [number for number in numbers if number not in kept]
    address = options["cluster"]
    place = local(options["jobs"]) if address is None else cluster(address)
    with place as workers, _appending(options["output"]) as write, stage_display() as progress:
        for sample in run_samples(scene, missing, seed, workers, enough):
            write(sample)
            progress(f"{len(kept)} of {numbers.stop} samples")


def _one(scene: Scene, seed: int, number: int, as_json: bool) -> None:
    """Run one sample as a full verification."""
    from cli.output import STATUS
    from netlist_gen.problem import make_problem
    from netlist_gen.synthesis import synthesise
    from netlist_gen.variation import draw, parameters, vary
    from verification.report.document import verdict_document
    from verification.verify import verify

    problem = make_problem(scene)
    nominal = synthesise(scene, problem)
    z = draw(scene.tolerances, len(parameters(nominal, scene.tolerances)), seed, number)
    board = vary(nominal, scene.tolerances, z)
    verdict = verify(scene, problem=problem, circuit=board)
    if as_json:
        print_json({"sample": number, "seed": seed, **verdict_document(verdict)})
    else:
        from rich.console import Console

        from verification.report.table import print_verdict

        print_verdict(verdict, Console(highlight=False))
    sys.exit(STATUS[verdict.outcome.value])


def _stored(path: str | None, scene: Scene, seed: int) -> dict[int, Sample]:
    """Return the samples of an earlier run of the same scene and seed."""
    from verification.studies.content import digest
    from verification.studies.montecarlo import Sample

    if path is None:
        return {}
    head = {"scene": digest(scene.model_dump(mode="json")).hex(), "seed": seed}
    file = Path(path)
    if not file.exists() or not file.stat().st_size:
        try:
            file.write_text(json.dumps(head) + "\n", encoding="utf-8")
        except OSError as error:
            text = f"{error.strerror}; expected a file that can be written"
            raise InputError("-o", Complaint("FILE", repr(path), text)) from None
        return {}
    lines = file.read_text(encoding="utf-8", errors="replace").splitlines()
    try:
        if json.loads(lines[0]) != head:
            text = "holds samples of another scene or seed; another file, or delete it"
            raise InputError("-o", Complaint("FILE", repr(path), text))
        records = [json.loads(line) for line in lines[1:] if line.endswith("}")]
        samples = [Sample(**(record | {"failed": tuple(record["failed"])})) for record in records]
    except (ValueError, TypeError, KeyError):
        text = "holds no samples of taction; another file"
        raise InputError("-o", Complaint("FILE", repr(path), text)) from None
    return {sample.number: sample for sample in samples}


@contextmanager
def _appending(path: str | None) -> Iterator[Any]:
    """Give a function that appends a sample at once; a line cut short by a kill is read over."""
    if path is None:
        yield lambda sample: None
        return
    with Path(path).open("a", encoding="utf-8") as file:

        def write(sample: Sample) -> None:
            file.write(json.dumps(asdict(sample)) + "\n")
            file.flush()

        yield write


def _fraction(text: str | None) -> float | None:
    if text is None:
        return None
    try:
        value = float(text.removesuffix("%")) / (100 if text.endswith("%") else 1)
    except ValueError:
        value = 0.0
    if not 0 < value < 0.5:
        accepted = "expected a half width such as 1% or 0.01"
        raise InputError("--until", Complaint("WIDTH", repr(text), accepted))
    return value


def _ends(text: str) -> dict[str, float]:
    ends = {}
    for part in text.split(","):
        name, _, value = part.partition("=")
        try:
            ends[name.strip()] = float(value)
        except ValueError:
            accepted = "expected KEY=Z with Z in tolerances, such as capacitor=-1"
            raise InputError("--corner", Complaint("KEY=Z", repr(part), accepted)) from None
    return ends


def _show_yield(found: YieldReport, seed: int) -> None:
    from verification.report.yields import print_yield

    print_yield(found, seed)


def _show_corners(found: tuple[Corner, ...]) -> None:
    from verification.report.yields import print_corners

    print_corners(found)
