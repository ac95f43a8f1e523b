"""`Circuit`: the board, components with values and nodes, without SPICE, and how it shows itself.

The synthesis makes it, the deck writer turns it into text, and the state-space engine into
equations.
"""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from taction.netlist_gen.board.components import GROUND as GROUND
from taction.netlist_gen.board.components import Capacitor as Capacitor
from taction.netlist_gen.board.components import CircuitData
from taction.netlist_gen.board.components import CurrentSource as CurrentSource
from taction.netlist_gen.board.components import NoiseCurrent as NoiseCurrent
from taction.netlist_gen.board.components import Omission as Omission
from taction.netlist_gen.board.components import OpAmpCell as OpAmpCell
from taction.netlist_gen.board.components import Output as Output
from taction.netlist_gen.board.components import Resistor as Resistor
from taction.netlist_gen.board.components import ResistorMatrix as ResistorMatrix
from taction.netlist_gen.board.components import Scalings as Scalings
from taction.netlist_gen.board.components import SignalAmplifier as SignalAmplifier
from taction.netlist_gen.board.components import TransistorCell as TransistorCell
from taction.netlist_gen.board.components import VoltageSource as VoltageSource
from taction.netlist_gen.card import Card
from taction.netlist_gen.scene.summary import counted, sizes
from taction.system.quantities import quantity

if TYPE_CHECKING:
    from matplotlib.figure import Figure


class Circuit(CircuitData):
    """A whole board."""

    __slots__ = ()

    def __repr__(self) -> str:
        parts = (sizes(*self._size), self.topology, f"{self.amplifier} amplifiers", self._values())
        return f"Circuit({self.name!r}, {', '.join(parts)}, op-amps {', '.join(self.models)})"

    @property
    def _size(self) -> tuple[int, int]:
        return len(self.outputs), len(self.constraint_nodes)

    def _values(self) -> str:
        s = self.scalings
        return f"C = {quantity(s.capacitance, 'F')}, gain = {quantity(s.gain, 'ohm')}"

    def _repr_html_(self) -> str:
        """Return the board as a card for a notebook."""
        s = self.scalings
        entries = sum(int(np.isfinite(matrix.ohms).sum()) for matrix in self.matrices)
        parts = (
            counted(len(self.opamps), "op-amp"),
            counted(entries, "matrix resistor"),
            counted(len(self.resistors), "other resistor"),
            counted(len(self.capacitors), "capacitor"),
        )
        facts = (
            ("size", sizes(*self._size)),
            ("board", f"{self.topology}, {self.amplifier} amplifiers"),
            ("op-amps", f"{', '.join(self.models)}, supply ±{quantity(self.supply, 'V')}"),
            ("C", quantity(s.capacitance, "F")),
            ("gain s", quantity(s.gain, "ohm")),
            ("R", quantity(s.resistance, "ohm")),
            ("lambda", f"{s.lam:.4g}"),
            ("unit conductance G0", quantity(s.unit_conductance, "S")),
            ("parts", ", ".join(parts)),
            ("left out", counted(len(self.omissions), "kind") + " of parts that it does not need"),
        )
        return Card("Circuit", self.name, facts=facts).html()

    def plot(self, path: str | Path | None = None) -> Figure:
        """Return the schematic of one channel with its values; write it to `path`, if given.

        Raises
        ------
        InputError
            The file does not end in ``.png``, ``.svg`` or ``.pdf`` or cannot be written, or
            matplotlib or schemdraw is missing (``taction[plot,report]``).
        """
        from taction.netlist_gen.board.schematic import plot_schematic

        return plot_schematic(self, path)
