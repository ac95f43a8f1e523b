"""``taction netlist``: the deck, what was left out, and the split into two files."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

import click

from cli.common import json_option, print_json, reports_errors, scene_argument
from spice_models.errors import Complaint, InputError

if TYPE_CHECKING:
    from netlist_gen.deck.deck import Deck


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
    if split and output is None:
        text = "give -o FILE; the matrix then stands in FILE with the ending _matrix.inc"
        raise InputError("--split", Complaint("-o", "", text))
    from netlist_gen.board.synthesis import synthesise
    from netlist_gen.deck.deck import write_deck
    from netlist_gen.problem.inverse_problem import make_problem
    from verification.ideal.lambda_rule import read_scene
    from verification.pipeline.transient_plan import plan_transient
    from verification.small_signal.time_scales import time_scales

    asked = read_scene(scene)
    circuit = synthesise(asked, make_problem(asked))
    transient = plan_transient(asked, time_scales(circuit, initial=asked.analysis.initial))
    matrix = _matrix_file(output) if split and output is not None else None
    deck = write_deck(circuit, transient, matrix_file=matrix)
    if explain:
        click.echo(f"{asked.name}: left out, because the scene does not need it:", err=True)
        for item in circuit.omissions:
            click.echo(f"  {item.what}: {item.why}", err=True)
    written = _write(deck, output)
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


def _matrix_file(output: str) -> str:
    from netlist_gen.deck.checks import FILE_NAME

    name = f"{Path(output).stem}_matrix.inc"
    if not FILE_NAME.fullmatch(name):
        text = "with --split the name is part of the deck: letters, digits, '-', '_' and '.' only"
        raise InputError("-o", Complaint("FILE", repr(output), text))
    return name


def _write(deck: Deck, output: str | None) -> list[str]:
    """Write the deck's files beside each other and return their names."""
    if output is None:
        return []
    path = Path(output)
    files = {path: deck.text} | {path.with_name(n): text for n, text in deck.files.items()}
    for file, text in files.items():
        try:
            file.write_text(text, encoding="utf-8")
        except OSError as error:
            reason = f"{error.strerror}; expected a file that can be written"
            raise InputError(file, Complaint("-o", "", reason)) from None
        click.echo(f"wrote {file}", err=True)
    return [str(file) for file in files]
