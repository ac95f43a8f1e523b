"""The deck of a scene, and the files that it is written to."""

from __future__ import annotations

from pathlib import Path

from netlist_gen.board.circuit import Circuit
from netlist_gen.board.synthesis import synthesise
from netlist_gen.deck.checks import FILE_NAME
from netlist_gen.deck.deck import Deck, write_deck
from netlist_gen.problem.inverse_problem import make_problem
from netlist_gen.scene.scene import Scene
from spice_models.atomic_files import write_together
from spice_models.errors import Complaint, InputError
from verification.engines.statespace.linearised.board import LinearBoard
from verification.pipeline.opamp_level import at_level, has_large_signal
from verification.pipeline.transient_plan import plan_transient
from verification.small_signal.poles import poles_behind
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
    scales = time_scales(board, initial=scene.analysis.initial)
    transient = plan_transient(scene, board, scales).transient
    leveled = board
    if has_large_signal(board):
        stable = poles_behind(board, scales).known_stable
        leveled, _ = at_level(scene, board, transient, stable=stable)
    if leveled is not board:
        scales = time_scales(leveled, initial=scene.analysis.initial)
        transient = plan_transient(scene, leveled, scales).transient
    return leveled.circuit, write_deck(leveled.circuit, transient, matrix_file=matrix_file)


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
    """Write the files of `deck` beside each other, all or none; return their paths, the deck first.

    Raises
    ------
    InputError
        A file cannot be written.
    """
    path = Path(output)
    files = {path: deck.text} | {path.with_name(n): text for n, text in deck.files.items()}
    write_together(files)
    return list(files)
