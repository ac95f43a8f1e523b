"""The deck of a scene, and the files that it is written to."""

from __future__ import annotations

from pathlib import Path

from netlist_gen.board.circuit import Circuit
from netlist_gen.board.synthesis import synthesise
from netlist_gen.deck.checks import FILE_NAME
from netlist_gen.deck.deck import Deck, write_deck
from netlist_gen.problem.inverse_problem import make_problem
from netlist_gen.scene.scene import Scene
from spice_models.errors import Complaint, InputError
from verification.engines.statespace.linearised.board import LinearBoard
from verification.pipeline.transient_plan import plan_transient
from verification.small_signal.time_scales import time_scales


def deck_of(
    scene: Scene, *, output: str | Path | None = None, split: bool = False
) -> tuple[Circuit, Deck]:
    """Return the board of `scene` and the deck of its transient.

    Parameters
    ----------
    scene : Scene
        Scene with a number for lambda.
    output : path, optional
        File of the deck; the name of the matrix file follows from this name.
    split : bool
        Whether the resistor matrices go into a second file.

    Raises
    ------
    InputError
        The scene cannot be built, or `split` has no `output` whose name a deck can contain.
    """
    matrix_file = _matrix_file(output) if split else None
    circuit = synthesise(scene, make_problem(scene))
    board = LinearBoard(circuit)
    plan = plan_transient(scene, board, time_scales(board, initial=scene.analysis.initial))
    return circuit, write_deck(circuit, plan.transient, matrix_file=matrix_file)


def _matrix_file(output: str | Path | None) -> str:
    if output is None:
        text = "give -o FILE; the matrix is then written to FILE with the ending _matrix.inc"
        raise InputError("--split", Complaint("-o", "", text))
    name = f"{Path(output).stem}_matrix.inc"
    if not FILE_NAME.fullmatch(name):
        text = "with --split the name is part of the deck: letters, digits, '-', '_' and '.' only"
        raise InputError("-o", Complaint("FILE", repr(str(output)), text))
    return name


def write_files(deck: Deck, output: str | Path) -> list[Path]:
    """Write the files of `deck` beside each other and return their paths, the deck first.

    Raises
    ------
    InputError
        A file cannot be written.
    """
    path = Path(output)
    files = {path: deck.text} | {path.with_name(n): text for n, text in deck.files.items()}
    for file, text in files.items():
        try:
            file.write_text(text, encoding="utf-8")
        except OSError as error:
            reason = f"{error.strerror}; expected a file that can be written"
            raise InputError(file, Complaint("-o", "", reason)) from None
    return list(files)
