"""``taction bom``: the parts that a person buys for a board."""

from __future__ import annotations

import click

from taction.cli.common import console, output_option, print_json, scene_command


@scene_command
@output_option("CSV file with KiCad's columns.")
def bom(scene: str, output: str | None, as_json: bool) -> None:
    """List the parts of the board of SCENE: values, counts, references, packages, power."""
    from taction.netlist_gen.board.bill_of_materials import bill_of_materials
    from taction.netlist_gen.board.synthesis import synthesise
    from taction.system.atomic_files import write_atomically
    from taction.verification.engines.statespace.linearised.board import LinearBoard
    from taction.verification.reference.ideal_answer import read_scene
    from taction.verification.report.parts_list import parts_csv, parts_document, print_parts
    from taction.verification.verdict.board_power import board_power

    read = read_scene(scene)
    circuit = synthesise(read)
    parts, power = bill_of_materials(circuit, read), board_power(LinearBoard(circuit))
    if output is not None:
        write_atomically(output, parts_csv(parts))
        click.echo(f"wrote {output}", err=True)
    if as_json:
        print_json({"scene": read.name, **parts_document(parts, power)})
    else:
        print_parts(parts, power, console())
