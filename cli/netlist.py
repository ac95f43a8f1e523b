"""``taction netlist``: the deck, what was left out, and the split into two files."""

from __future__ import annotations

import click

from cli.common import json_option, print_json, reports_errors, scene_argument


@click.command(short_help="Write the ngspice deck of a scene.")
@scene_argument
@click.option("-o", "--output", type=click.Path(dir_okay=False), help="Deck file; else stdout.")
@click.option("--explain", is_flag=True, help="Say what was left out and why, on stderr.")
@click.option(
    "--split", is_flag=True, help="Amplifiers in one file, the resistor matrix in another (-o)."
)
@json_option
@reports_errors
def netlist(scene: str, output: str | None, explain: bool, split: bool, as_json: bool) -> None:
    """Write the deck of SCENE; `ngspice -b -r out.raw FILE` runs it."""
    from verification.ideal.lambda_rule import read_scene
    from verification.pipeline.deck import deck_of, write_files

    asked = read_scene(scene)
    circuit, deck = deck_of(asked, output=output, split=split)
    if explain:
        click.echo(f"{asked.name}: left out, because the scene does not need it:", err=True)
        for item in circuit.omissions:
            click.echo(f"  {item.what}: {item.why}", err=True)
    written = [] if output is None else [str(file) for file in write_files(deck, output)]
    for name in written:
        click.echo(f"wrote {name}", err=True)
    if as_json:
        document = {
            "files": written,
            "deck": deck.text if output is None else None,
            "omissions": [{"what": item.what, "why": item.why} for item in circuit.omissions],
            "lambda": circuit.scalings.lam,
        }
        print_json(document)
    elif output is None:
        click.echo(deck.text, nl=False)
