"""``taction netlist``: the deck, the omitted parts, and the split into two files."""

from __future__ import annotations

from dataclasses import asdict
from typing import Any

import click

from taction.cli.common import output_option, print_json, scene_command

NAMES = (
    "ngspice",
    "ltspice",
    "hspice",
    "xyce",
    "spectre",
)  # keys of `DIALECTS`, which --help does not load


@scene_command
@output_option("Deck file; by default stdout.")
@click.option(
    "--explain",
    is_flag=True,
    help="List the omitted parts, the reasons, and what pruning changes and saves, on stderr.",
)
@click.option(
    "--split",
    is_flag=True,
    help="Write the amplifiers into FILE and the resistor matrix into a second file; needs -o.",
)
@click.option(
    "--dialect",
    type=click.Choice(NAMES),
    default=NAMES[0],
    show_default=True,
    help="The simulator that reads the deck.",
)
@click.option(
    "--parameters",
    is_flag=True,
    help="Write C, gain and lambda as .param cards, and R as an expression of them.",
)
@click.option(
    "--measure",
    is_flag=True,
    help="Add .meas cards of rise time, settling time, overshoot; `ngspice -b FILE` prints them.",
)
def netlist(
    scene: str, output: str | None, explain: bool, as_json: bool, measure: bool, **kind: Any
) -> None:
    """Write the deck of SCENE; `ngspice -b -r out.raw FILE` runs it."""
    from taction.netlist_gen.board.part_warnings import part_warnings
    from taction.verification.reference.ideal_answer import read_scene
    from taction.verification.verdict.deck import DeckChoice, deck_of, write_files
    from taction.verification.verdict.pruning import pruning_of

    read = read_scene(scene)
    circuit, deck = deck_of(read, output=output, choice=DeckChoice(measures=measure, **kind))
    pruning = None
    if explain:
        click.echo(f"{circuit.name}: left out, not needed by the scene:", err=True)
        for item in circuit.omissions:
            click.echo(f"  {item.what}: {item.why}", err=True)
        pruning = pruning_of(read)
        if pruning is not None:
            click.echo(f"pruning: {pruning.text}", err=True)
    warnings = part_warnings(circuit)
    for warning in warnings:
        click.echo(f"warning: {warning}", err=True)
    written = [] if output is None else [str(file) for file in write_files(deck, output)]
    for name in written:
        click.echo(f"wrote {name}", err=True)
    if as_json:
        print_json(
            {
                "files": written,
                "deck": deck.text if output is None else None,
                "omissions": [asdict(item) for item in circuit.omissions],
                "pruning": pruning and pruning.record,
                "warnings": warnings,
                "lambda": circuit.value("lambda"),
            }
        )
    elif output is None:
        click.echo(deck.text, nl=False)
