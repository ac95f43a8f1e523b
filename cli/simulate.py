"""``taction simulate``: waveforms and measurements."""

from __future__ import annotations

import click

import taction
from cli.common import json_option, print_json, reports_errors, scene_argument, stage_display


@click.command(short_help="Waveforms and measurements of a scene.")
@scene_argument
@click.option("--engine", type=click.Choice(["auto", "ngspice", "statespace"]), default=None)
@click.option("-o", "--output", type=click.Path(dir_okay=False), help="FILE.csv, .parquet or .raw")
@json_option
@reports_errors
def simulate(scene: str, engine: str | None, output: str | None, as_json: bool) -> None:
    """Run the transient of SCENE and measure it; nothing is judged."""
    from verification.report.verdict.json_document import channel_record
    from verification.studies.figures import finite

    with stage_display() as progress:
        result = taction.simulate(scene, engine=engine, output=output, progress=progress)
    if output is not None:
        click.echo(f"wrote {output}", err=True)
    measurements, cost = result.measurements, result.waveforms.cost
    if as_json:
        print_json(
            {
                "scene": result.circuit.name,
                "simulator": result.waveforms.engine,
                "points": cost.points,
                "seconds": cost.seconds,
                "stop": float(result.waveforms.time[-1]),
                "step_amplitude": measurements.amplitude,
                "settling_time": finite(measurements.settling_time),
                "channels": [channel_record(channel) for channel in measurements.channels],
                "output": output,
            }
        )
        return
    from rich.console import Console

    from verification.report.verdict.table import channel_table

    Console(highlight=False).print(channel_table(measurements))
    click.echo(f"{result.waveforms.engine}: {cost.points} points, {cost.seconds:.3g} s")
