"""The deck of a scene, and what pruning changes."""

from __future__ import annotations

import math
from dataclasses import dataclass, field, replace
from typing import TYPE_CHECKING

import numpy as np

from taction.netlist_gen.board.circuit import Circuit
from taction.netlist_gen.deck.deck import Deck, write_deck
from taction.netlist_gen.deck.dialects import DIALECTS, NATIVE
from taction.netlist_gen.scene.scene import Scene
from taction.netlist_gen.topologies.frame.topology import pruned
from taction.system.array_types import Floats
from taction.system.errors import InputError, SolverError
from taction.system.quantities import show
from taction.verification.reference.ideal_answer import IdealNetwork
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
    written : tuple of str
        The file that was written, if any.
    """

    DOCUMENT = (
        *("files = written", "deck = printed", "omissions = circuit.omissions", "warnings"),
        "lambda = circuit.facts.lambda.value",
    )

    circuit: Circuit = field(kw_only=True, repr=False)
    warnings: tuple[str, ...] = field(default=(), repr=False)
    written: tuple[str, ...] = field(default=(), repr=False)

    @property
    def printed(self) -> str | None:
        """The text; None where it is in a file."""
        return None if self.written else self.text


def deck_of(scene: Scene, *, dialect: str = NATIVE, measures: bool = False) -> tuple[Circuit, Deck]:
    """Return the board of a scene with a number for lambda, and the deck that `verify` would run.

    With `measures`, or in another `dialect`, the transient has even steps: step control is tuned
    for ngspice alone, and a measure is exact only to the spacing of the points. The errors are
    those of `taction.netlist`.
    """
    if (measures or dialect != NATIVE) and scene.analysis.points_per_period is None:
        even = {"points_per_period": EVEN_POINTS, "error": "auto"}
        scene = scene.model_copy(update={"analysis": scene.analysis.model_copy(update=even)})
    board = build(scene.with_engine("ngspice"))
    circuit, transient = board.circuit, board.transient
    if complaints := list(DIALECTS[dialect].refusals(circuit)):
        raise InputError(scene.file, *complaints)
    ends = _measures(board) if measures else None
    deck = write_deck(circuit, transient, dialect=dialect, measures=ends)
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
