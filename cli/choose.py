"""``taction choose``: op-amp, C and gain for given limits, over all presets."""

from __future__ import annotations

import math
import sys
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from taction.cli.common import (
    CLUSTER,
    JOBS,
    STATUS,
    check_plot,
    check_report,
    console,
    plot_option,
    print_json,
    report_option,
    save_report,
    say,
    scene_command,
)
from taction.system.errors import Complaint, InputError

if TYPE_CHECKING:
    from taction.netlist_gen.scene.scene import Scene
    from taction.verification.design.choose_ranking import Confirmation, Design
    from taction.verification.design.choose_request import Request
    from taction.verification.report.html.blocks import Report


@scene_command
@click.option("--settling", metavar="TIME", help="Largest settling time: 10us.")
@click.option("--rise", metavar="TIME", help="Largest rise time.")
@click.option("--overshoot", metavar="SHARE", help="Largest overshoot: 5% or 0.05.")
@click.option("--noise", metavar="VOLTS", help="Largest output noise of a channel: 1mV.")
@click.option("--margin", metavar="FACTOR", help="Factor by which C must be able to shrink.")
@click.option("--supply", metavar="VOLTS", help="Supply of the op-amps: 15V.")
@click.option("--opamps", metavar="A,B,C", help="Presets; by default all of them.")
@click.option("--c-range", metavar="LOW:HIGH", help="By default the scene's C /10 to *10.")
@click.option("--gain-range", metavar="LOW:HIGH", help="By default the scene's gain /10 to *10.")
@click.option("--points", type=click.IntRange(1, 101), default=9, help="Values of C and of gain.")
@click.option(
    "-o", "output", metavar="FOLDER", type=click.Path(file_okay=False),
    help="Write the best three designs as scene files into FOLDER.",
)  # fmt: skip
@click.option(
    "--store", metavar="FILE", type=click.Path(dir_okay=False),
    help="Database of the results; by default the scene's name with -choose.sqlite.",
)  # fmt: skip
@plot_option("maps of C and gain for every op-amp")
@report_option()
@JOBS
@CLUSTER
def choose(scene: str, as_json: bool, **options: Any) -> None:
    """Choose op-amp, C and gain of SCENE: all designs of a grid, ranked by checks and headroom.

    Lambda, and with it the solution, stays; C and gain take values that can be bought. The
    state-space engine verifies every design, and ngspice the best three. The same command continues
    an interrupted one. Exit status: 0 if a design passes on both engines, 1 if none passes.
    """
    from taction.cli.sweep import run_plan
    from taction.verification.design.choose_ranking import (
        best_designs,
        confirmed,
        design_scene,
        designs,
    )
    from taction.verification.design.choose_request import choice_plan
    from taction.verification.reference.ideal_answer import read_scene
    from taction.verification.studies.store import Store

    check_plot(options["plot"])
    check_report(options["report"])
    _check_folder(options["output"])
    original = read_scene(scene)
    plan = choice_plan(original, _request(options))
    _ask_limits(original, plan.scene, options)
    with Store(options["store"] or f"{plan.scene.name}-choose.sqlite") as store:
        run_plan(plan, store, options | {"retry": None})
        ranked = designs(plan, store)
    best = best_designs(ranked)
    scenes = [design_scene(plan, original, design, k) for k, design in enumerate(best, 1)]
    said = [confirmed(one) for one in scenes]
    files = _write(options["output"], best, scenes)
    if options["plot"] is not None:  # before the text: its reader may go
        from taction.verification.report.choose.picture import plot_choice

        title = f"{original.name}: worst value over its limit, for {len(ranked)} designs"
        plot_choice(ranked, best, title, options["plot"])
        click.echo(f"drew {options['plot']}", err=True)
    save_report(options["report"], lambda: _page(original, ranked, best, said, scenes))
    _show(ranked, best, said, files, as_json=as_json)
    sys.exit(_status(said))


def _ask_limits(scene: Scene, limited: Scene, options: dict[str, Any]) -> None:
    """Ask on stderr what may be a slip in the limits of the options."""
    from taction.netlist_gen.scene.checks import unitless_times
    from taction.netlist_gen.scene.questions import value_questions

    times = {"settling_time": options["settling"], "rise_time": options["rise"]}
    bare = {name: {"max": float(text)} for name, text in times.items() if _is_plain(text)}
    known = set(value_questions(scene))
    for question in (*unitless_times({"checks": bare}), *value_questions(limited)):
        if question not in known:
            say(f"question: {question}")


def _is_plain(text: str | None) -> bool:
    """Whether a text is a number without a unit."""
    try:
        return text is not None and math.isfinite(float(text))
    except ValueError:
        return False


def _status(said: list[Confirmation]) -> int:
    """Return the exit status: pass if ngspice contradicts not every one of the best."""
    outcomes = {"pass" if c.outcome is None else c.outcome.value for c in said}
    best = next((name for name in ("pass", "inconclusive") if name in outcomes), "fail")
    return STATUS[best]


def _request(options: dict[str, Any]) -> Request:
    from taction.verification.design.choose_request import Request

    limits = {
        "checks.settling_time.max": options["settling"],
        "checks.rise_time.max": options["rise"],
        "checks.overshoot.max": _share(options["overshoot"]),
        "checks.noise.max": options["noise"],
        "checks.stability.margin": _number("--margin", options["margin"]),
        "design.supply": options["supply"],
    }
    return Request(
        opamps=[name.strip() for name in (options["opamps"] or "").split(",") if name.strip()],
        capacitances=options["c_range"] or "",
        gains=options["gain_range"] or "",
        points=options["points"],
        limits={path: value for path, value in limits.items() if value is not None},
    )


def _share(text: str | None) -> float | None:
    """Read a fraction, ``0.05`` or ``5%``."""
    if text is not None and text.strip().endswith("%"):
        value = _number("--overshoot", text.strip().removesuffix("%"))
        return None if value is None else value / 100.0
    return _number("--overshoot", text)


def _number(option: str, text: str | None) -> float | None:
    try:
        return None if text is None else float(text)
    except ValueError:
        complaint = Complaint("value", repr(text), "expected a number, such as 0.05 or 5%")
        raise InputError(option, complaint) from None


def _check_folder(folder: str | None) -> None:
    if folder is not None and Path(folder).exists() and any(Path(folder).iterdir()):
        text = "the folder is not empty; give another name"
        raise InputError("-o", Complaint("FOLDER", repr(folder), text))


def _write(folder: str | None, best: list[Design], scenes: list[Scene]) -> dict[int, str]:
    """Write the scenes of the best designs; return their files by place of the grid."""
    if folder is None:
        return {}
    from taction.cli.scale import write_scene

    Path(folder).mkdir(parents=True, exist_ok=True)
    files = {}
    for design, scene in zip(best, scenes, strict=True):
        files[design.place] = str(Path(folder) / f"{scene.name}.toml")
        write_scene(scene, files[design.place])
        click.echo(f"wrote {files[design.place]}", err=True)
    return files


def _show(
    ranked: list[Design],
    best: list[Design],
    said: list[Confirmation],
    files: dict[int, str],
    *,
    as_json: bool,
) -> None:
    from taction.verification.report.choose.tables import choice_document, print_choice

    if as_json:
        print_json(choice_document(ranked, best, said, files))
    else:
        print_choice(ranked, best, said, console())


def _page(
    scene: Scene,
    ranked: list[Design],
    best: list[Design],
    said: list[Confirmation],
    scenes: list[Scene],
) -> Report:
    """Return the report; the design that it proposes is verified anew where ngspice is missing."""
    from taction.verification.report.choose.tables import proposed
    from taction.verification.report.html.choice_report import choice_report
    from taction.verification.verdict.verify import verify

    verdict = None
    if best:
        place = proposed(said)
        verdict = said[place].verdict or verify(scenes[place].with_engine("statespace"))
    return choice_report(scene, ranked, best, said, verdict)
