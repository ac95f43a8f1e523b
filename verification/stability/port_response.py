"""The frequency response of a board at the terminals of some of its parts."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np

from taction.netlist_gen.board.circuit import GROUND, Capacitor, Resistor
from taction.system.array_types import Complexes, Floats
from taction.verification.engines.statespace.linearised.board import LinearBoard
from taction.verification.engines.statespace.linearised.state_space import driven

WELL_CONDITIONED = 1e-8  # largest defect of the modes that are used for the response


@dataclass(frozen=True, eq=False)
class PortResponse:
    """Admittance of some parts times the impedance at their terminals.

    Attributes
    ----------
    board : LinearBoard
        The board with the parts.
    parts : tuple of Capacitor, or of Resistor
        K parts of one kind.
    """

    board: LinearBoard
    parts: tuple[Capacitor | Resistor, ...]

    @property
    def reactive(self) -> bool:
        """Whether the parts are capacitors."""
        return isinstance(self.parts[0], Capacitor)

    @property
    def poles(self) -> Complexes:
        """Poles of the board; of a large board those of its coarse board; 1/s."""
        board = self.board.coarse if self.board.descriptor.is_large else self.board
        return board.state_space.modes.poles

    def at(self, omega: Floats) -> Complexes:
        """Return the matrices at angular frequencies (P,), 1/s; shape (P, K, K)."""
        large = self.board.descriptor.is_large
        modal = not large and self.board.state_space.modes.defect < WELL_CONDITIONED
        impedance = self._from_modes(omega) if modal else self._from_solves(omega)
        weighted = self._roots[:, None] * impedance * self._roots
        return 1j * omega[:, None, None] * weighted if self.reactive else weighted

    @cached_property
    def _roots(self) -> Floats:
        """Square roots of the capacitances or conductances, (K,)."""
        values = [p.farads if isinstance(p, Capacitor) else 1.0 / p.ohms for p in self.parts]
        return np.sqrt(values)

    @cached_property
    def _columns(self) -> Floats:
        """Voltage of each part as a combination of the unknowns, shape (size, K)."""
        columns = np.zeros((self.board.descriptor.size, len(self.parts)))
        for k, part in enumerate(self.parts):
            for node, sign in ((part.a, 1.0), (part.b, -1.0)):
                if node != GROUND:
                    columns[self.board.descriptor.place(node), k] = sign
        return columns

    @cached_property
    def _rows(self) -> Floats:
        """Currents of each part into the rows: an ideal source takes up the current at its node."""
        return np.where(self.board.descriptor.determined[:, None], 0.0, self._columns)

    @cached_property
    def _modal(self) -> tuple[Complexes, Complexes, Floats]:
        """Voltages of the modes (K, n), currents into the modes (n, K), and the direct part."""
        space = driven(self.board.descriptor, self.board.operating_point, self._rows)
        modes, columns = self.board.state_space.modes, self._columns.T
        return columns @ space.C @ modes.right, modes.left @ space.B, columns @ space.D

    def _from_modes(self, omega: Floats) -> Complexes:
        right, left, direct = self._modal
        gain = 1.0 / (1j * omega[:, None] - self.poles)
        return np.asarray((right * gain[:, None, :]) @ left + direct)

    def _from_solves(self, omega: Floats) -> Complexes:
        structure, rows = self.board.structure, self._rows.astype(np.complex128)
        solved = [structure.factor(1j * each).solve(rows) for each in omega.tolist()]
        return np.asarray(self._columns.T @ np.stack(solved))
