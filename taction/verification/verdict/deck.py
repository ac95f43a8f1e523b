"""The deck of a scene, and the files that it is written to."""

from __future__ import annotations

from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING

from taction.netlist_gen.board.circuit import Circuit
from taction.netlist_gen.deck.checks import FILE_NAME
from taction.netlist_gen.deck.deck import Deck, write_deck
from taction.netlist_gen.deck.dialects import DIALECTS, NATIVE
from taction.netlist_gen.scene.scene import Scene
from taction.system.atomic_files import write_together
from taction.system.errors import Complaint, InputError, SolverError
from taction.system.progress import Clock
from taction.verification.reference.ideal_answer import ideal_answer
from taction.verification.verdict.design import design_board
from taction.verification.verdict.planned_board import PlannedBoard
from taction.verification.verdict.pruning import Pruning

if TYPE_CHECKING:
    from taction.netlist_gen.deck.measures import Measures

EVEN_POINTS = 125.0  # on a period of ringing: an error of about 1e-4 of the step in ngspice


@dataclass(frozen=True, slots=True)
class DeckChoice:
    """What a deck is to be beside the board itself.

    Attributes
    ----------
    dialect : str
        Key of `DIALECTS`.
    split : bool
        Whether the resistor matrices go into a second file.
    measures : bool
        Whether the deck measures rise time, settling time and overshoot.
    """

    dialect: str = NATIVE
    split: bool = False
    measures: bool = False

    @property
    def has_even_steps(self) -> bool:
        """Whether the transient has even steps.

        Step control is tuned for ngspice alone, and a measure is exact only to the spacing of the
        points, which it joins by straight lines.
        """
        return self.measures or self.dialect != NATIVE


@dataclass(frozen=True, slots=True)
class Netlist(Deck):
    """The deck of a scene, with its board.

    Attributes
    ----------
    circuit : Circuit
        The board; `omissions` are the parts that the scene does not need.
    warnings : tuple of str
        Values that cannot be bought, or that the layout undoes.
    pruning : Pruning or None
        What pruning changes and saves; None unless asked for, or without pruning.
    written : tuple of str
        The files that were written.
    """

    DOCUMENT = (
        *("files = written", "deck = printed", "omissions = circuit.omissions", "pruning"),
        *("warnings", "lambda = circuit.facts.lambda.value"),
    )

    circuit: Circuit = field(kw_only=True, repr=False)
    warnings: tuple[str, ...] = field(default=(), repr=False)
    pruning: Pruning | None = field(default=None, repr=False)
    written: tuple[str, ...] = field(default=(), repr=False)

    @property
    def printed(self) -> str | None:
        """The text; None where it is in files."""
        return None if self.written else self.text


def deck_of(
    scene: Scene,
    *,
    output: str | Path | None = None,
    choice: DeckChoice = DeckChoice(),
) -> tuple[Circuit, Deck]:
    """Return the board of a scene with a number for lambda, and the deck that `verify` would run.

    The name of the matrix file follows from `output`. The errors are those of `taction.netlist`,
    and `SolverError` where a deck is to measure and the problem has no solution.
    """
    matrix_file = _matrix_file(output) if choice.split else None
    if choice.has_even_steps:
        scene = _with_even_steps(scene)
    design = design_board(scene.with_engine("ngspice"), Clock(lambda stage: None))
    circuit = design.circuit
    if complaints := list(DIALECTS[choice.dialect].refusals(circuit)):
        raise InputError(scene.file, *complaints)
    return circuit, write_deck(
        circuit,
        design.transient,
        matrix_file=matrix_file,
        dialect=choice.dialect,
        measures=_measures(design) if choice.measures else None,
    )


def _with_even_steps(scene: Scene) -> Scene:
    """Return `scene` with even steps; its own number of points, if it has one."""
    if scene.analysis.points_per_period is not None:
        return scene
    even = {"points_per_period": EVEN_POINTS, "error": "auto"}
    return scene.model_copy(update={"analysis": scene.analysis.model_copy(update=even)})


def _measures(design: PlannedBoard) -> Measures:
    """Return what the measures compare with: the reference solution, at the output nodes."""
    from taction.netlist_gen.deck.measures import Measures

    ideal = ideal_answer(design.network, design.scene)
    if ideal.problem:
        raise SolverError(f"--measure needs a reference solution: {ideal.problem}")
    signs = [output.sign for output in design.circuit.outputs]
    targets, starts = (
        tuple(float(sign * u) for sign, u in zip(signs, values, strict=True))
        for values in (ideal.target, ideal.start)
    )
    return Measures(targets, starts, ideal.band)


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
