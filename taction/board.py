"""`taction.Circuit`: a board with its card and its picture, and the job that makes it.

Card and picture are reports, and the board itself must not import reports.
"""

from __future__ import annotations

from dataclasses import fields
from pathlib import Path
from typing import TYPE_CHECKING

from taction.netlist_gen.board import circuit, synthesis
from taction.system.picture import plot

if TYPE_CHECKING:
    from matplotlib.figure import Figure

    from taction.netlist_gen.scene.inverse_problem import InverseProblem
    from taction.netlist_gen.scene.scene import Scene


class Circuit(circuit.Circuit):
    """A whole board, as `taction.synthesise` returns it."""

    __slots__ = ()

    @classmethod
    def of(cls, board: circuit.Circuit) -> Circuit:
        """Return `board` with its card and its picture."""
        return cls(*(getattr(board, field.name) for field in fields(board)))

    def _repr_html_(self) -> str:
        """Return the board as a card for a notebook."""
        from taction.netlist_gen.card import facts_card
        from taction.verification.report.views.board import circuit_facts

        return facts_card("Circuit", self.name, circuit_facts(self))

    def plot(self, path: str | Path | None = None) -> Figure:
        """Return the schematic of one channel with its values; write it to `path`, if given.

        Raises
        ------
        InputError
            The file does not end in ``.png``, ``.svg`` or ``.pdf`` or cannot be written, or
            matplotlib is missing (``taction[plot]``).
        """
        return plot("board:schematic_sheet", path, self)


def synthesise(scene: Scene, problem: InverseProblem | None = None) -> Circuit:
    """Design the board of `scene` for `problem`, by default the scene's own problem.

    Raises
    ------
    InputError
        A number of the design is out of range, or the topology cannot be built for the scene.

    Examples
    --------
    >>> import taction
    >>> circuit = taction.synthesise(taction.load_scene("scenes/paper-breadboard.toml"))
    >>> len(circuit.outputs), circuit.topology
    (7, 'integrator')
    """
    return Circuit.of(synthesis.synthesise(scene, problem))
