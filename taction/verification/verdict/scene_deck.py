"""The deck of a scene, the files that it is written to, and what pruning changes."""

from __future__ import annotations

import math
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from taction.netlist_gen.board.circuit import Circuit
from taction.netlist_gen.deck.deck import FILE_NAME, Deck, write_deck
from taction.netlist_gen.deck.dialects import DIALECTS, NATIVE
from taction.netlist_gen.scene.inverse_problem import make_problem
from taction.netlist_gen.scene.scene import Scene
from taction.netlist_gen.topologies.frame.topology import pruned
from taction.system.array_types import Floats
from taction.system.errors import Complaint, InputError, SolverError
from taction.system.output_files import write_together
from taction.system.quantities import show
from taction.verification.reference.ideal_answer import IdealNetwork, ideal_network
from taction.verification.reference.problem import Solution, solution_difference
from taction.verification.verdict.board import Board
from taction.verification.verdict.simulation import build

if TYPE_CHECKING:
    from taction.netlist_gen.deck.dialects import Measures


@dataclass(frozen=True, slots=True, eq=False)
class Pruning:
    """The steady state without the small entries of T."""

    DOCUMENT = ("entries", "change [V]", "bound [V]")

    entries: int  # number of entries of T that the board leaves out
    target: Floats  # (N,): the optimum with the pruned T, V
    change: float  # largest deviation of `target` from the optimum with the whole T, V
    bound: float  # on that deviation, V; infinite if a solution is not trusted

    @classmethod
    def of(cls, network: IdealNetwork, fraction: float, solution: Solution) -> Pruning | None:
        """Compare the solutions of the pruned and of the whole T; None if no entry is left out."""
        kept = pruned(network.T, fraction)
        entries = int(np.count_nonzero(kept != network.T))
        if not entries:
            return None
        after = replace(network, T=kept).rest
        change, bound = solution_difference(solution, after)
        return cls(entries, after.u * network.U0, change * network.U0, bound * network.U0)

    @property
    def text(self) -> str:
        """The numbers in words."""
        text = f"moves the steady state by {show(self.change, 'V', 3)}"
        unbounded = math.isinf(self.bound)
        return text + ", without a bound: a solution is not trusted" * unbounded


def pruning_of(scene: Scene) -> Pruning | None:
    """Compare the solution of `scene` with that of the whole T; None if nothing is pruned."""
    network = ideal_network(make_problem(scene), scene)
    return Pruning.of(network, scene.design.prune, network.rest)


EVEN_POINTS = 125.0  # on a period of ringing: an error of about 1e-4 of the step in ngspice


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
        What pruning changes; None unless asked for, or without pruning.
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
    dialect: str = NATIVE,
    split: bool = False,
    measures: bool = False,
) -> tuple[Circuit, Deck]:
    """Return the board of a scene with a number for lambda, and the deck that `verify` would run.

    With `measures`, or in another `dialect`, the transient has even steps: step control is tuned
    for ngspice alone, and a measure is exact only to the spacing of the points. With `split` the
    resistor matrices go into a second file. The errors are those of `taction.netlist`.
    """
    matrix_file = _matrix_file(output) if split else None
    if (measures or dialect != NATIVE) and scene.analysis.points_per_period is None:
        even = {"points_per_period": EVEN_POINTS, "error": "auto"}
        scene = scene.model_copy(update={"analysis": scene.analysis.model_copy(update=even)})
    board = build(scene.with_engine("ngspice"))
    circuit, transient = board.circuit, board.transient
    if complaints := list(DIALECTS[dialect].refusals(circuit)):
        raise InputError(scene.file, *complaints)
    ends = _measures(board) if measures else None
    deck = write_deck(circuit, transient, matrix_file=matrix_file, dialect=dialect, measures=ends)
    return circuit, deck


def _measures(board: Board) -> Measures:
    """Return what the measures compare with: the reference solution, at the output nodes."""
    from taction.netlist_gen.deck.dialects import Measures

    ideal = board.ideal
    if ideal.problem:
        raise SolverError(f"--measure needs a reference solution: {ideal.problem}")
    signs = np.array([output.sign for output in board.circuit.outputs])
    targets, starts = (tuple((signs * u).tolist()) for u in (ideal.target, ideal.start))
    return Measures(targets, starts, board.scene.checks.settling_time.band)


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
    """Write the files of `deck` beside each other, all or none; return their paths."""
    path = Path(output)
    files = {path: deck.text} | {path.with_name(n): text for n, text in deck.files.items()}
    write_together(files)
    return list(files)
