"""``taction scale``: G0, U0, s and R for given op-amps and supply."""

from __future__ import annotations

import sys
from typing import TYPE_CHECKING, Any

import click

from taction.cli.common import (
    STATUS,
    console,
    output_option,
    print_json,
    scene_command,
    stage_display,
)

if TYPE_CHECKING:
    from taction.netlist_gen.scene.scene import Scene
    from taction.verification.design.scaling import Scaling
    from taction.verification.verdict.verify import Verdict


@scene_command
@click.option(
    "--share",
    type=click.FloatRange(0, 0.9, min_open=True),
    default=0.5,
    help="Highest output voltage of any op-amp, as a share of its swing.",
)
@click.option("--opamp", metavar="NAME", help="Preset in the place of the scene's op-amp.")
@click.option("--supply", metavar="VOLTS", help="Supply in the place of the scene's, as ±12V.")
@output_option("Write the scene with the proposed scalings.")
def scale(
    scene: str,
    share: float,
    opamp: str | None,
    supply: str | None,
    output: str | None,
    as_json: bool,
) -> None:
    """Propose G0, U0, s and R: outputs that use the swing, resistors that can be bought.

    Lambda, and with it the solution, stays. C changes only where the board would be unstable or
    fail its checks. The state-space engine verifies the result, which decides the exit status.
    """
    from taction.verification.design.scaling import scale as run
    from taction.verification.verdict.verify import verify

    with stage_display() as progress:
        progress("scalings")
        scaling = run(_asked(scene, opamp, supply), share)
        verdict = verify(scaling.scene.with_engine("statespace"), progress)
    if output is not None:
        write_scene(scaling.scene, output)
        click.echo(f"wrote {output}", err=True)
    if as_json:
        print_json(scaling_document(scaling, verdict))
    else:
        show_scaling(scaling, verdict)
    sys.exit(STATUS[verdict.outcome.value])


def _asked(scene: str, opamp: str | None, supply: str | None) -> Scene:
    from taction.netlist_gen.scene.axes import with_values
    from taction.verification.reference.ideal_answer import read_scene

    changes = {"design.opamp": opamp, "design.supply": supply}
    return with_values(read_scene(scene), {k: v for k, v in changes.items() if v is not None})


def write_scene(scene: Scene, output: str) -> None:
    """Write a scene file; names of files in it are relative to its folder."""
    from pathlib import Path

    from taction.netlist_gen.scene.writing import scene_text
    from taction.system.atomic_files import write_atomically

    write_atomically(Path(output), scene_text(scene, Path(output).parent))


def scaling_document(scaling: Scaling, verdict: Verdict) -> dict[str, Any]:
    """Return the scalings and the verdict as plain data."""
    from taction.verification.report.verdict.json_document import load_record, verdict_document

    names = ("unit_conductance", "unit_voltage", "gain", "resistance", "capacitance")
    return {
        "outcome": verdict.outcome.value,
        **{name: getattr(scaling, name) for name in names},
        "lambda": scaling.lam,
        "matrix_resistors": list(scaling.matrix_ohms),
        "headroom": [load_record(load) for load in scaling.loads],
        "notes": list(scaling.notes),
        "verification": verdict_document(verdict),
    }


def show_scaling(scaling: Scaling, verdict: Verdict) -> None:
    """Print the scalings, the loads and what the checks say."""
    from taction.system.quantities import show
    from taction.verification.design.scaling import scalings_of
    from taction.verification.verdict.part_limits import describe

    page = console()
    values = scalings_of(scaling).items()
    page.print(", ".join(f"{name} = {show(value, unit)}" for name, (value, unit) in values))
    low, high = (show(ohms, "ohm") for ohms in scaling.matrix_ohms)
    page.print(f"matrix resistors from {low} to {high}; lambda stays {scaling.lam:.4g}")
    for load in scaling.loads:
        page.print(f"{describe(load)} ({load.share:.0%})")
    for note in scaling.notes:
        page.print(f"note: {note}", markup=False)
    failing = [check for check in verdict.checks if check.outcome.value != "pass"]
    for check in failing:
        page.print(f"{check.name}: {check.outcome.value}: {check.reason}", markup=False)
    page.print(f"{verdict.outcome.value.upper()} (state-space engine)")
