"""``taction simulate``: waveforms and measurements."""

from __future__ import annotations

import click

import taction
from taction.cli.common import (
    ENGINE,
    console,
    output_option,
    print_json,
    scene_command,
    stage_display,
)


@scene_command
@ENGINE
@output_option("File for the waveforms: .csv, .parquet or .raw.")
def simulate(scene: str, engine: str | None, output: str | None, as_json: bool) -> None:
    """Run the transient of SCENE and measure the waveforms, without any check."""
    from taction.verification.report.verdict.json_document import channel_record
    from taction.verification.verdict.record import Channel, finite

    with stage_display() as progress:
        result = taction.simulate(scene, engine=engine, output=output, progress=progress)
    if output is not None:
        click.echo(f"wrote {output}", err=True)
    measurements, waveforms = result.measurements, result.waveforms
    if as_json:
        print_json(
            {
                "scene": result.circuit.name,
                "simulator": waveforms.engine,
                "solver": waveforms.solver or None,
                "method": waveforms.method or None,
                "points": waveforms.cost.points,
                "seconds": waveforms.cost.seconds,
                "stop": float(waveforms.time[-1]),
                "step_amplitude": measurements.amplitude,
                "settling_time": finite(measurements.settling_time),
                "channels": [channel_record(Channel.of(c)) for c in measurements.channels],
                "output": output,
            }
        )
        return
    from taction.verification.report.verdict.table import channel_table

    console().print(channel_table(measurements))
    cost = waveforms.cost
    click.echo(f"{waveforms.simulator}: {cost.points} points, {cost.seconds:.3g} s")
