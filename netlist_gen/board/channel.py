"""One channel of a board with one sensor row: which parts a schematic of a channel shows."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from taction.netlist_gen.board.circuit import (
    Capacitor,
    Circuit,
    CurrentSource,
    OpAmpCell,
    Resistor,
    ResistorMatrix,
    SignalAmplifier,
    TransistorCell,
)


@dataclass(frozen=True, slots=True)
class Channel:
    """Channel `n` and sensor row `k` of a board, both counted from 1."""

    circuit: Circuit
    n: int
    k: int

    @classmethod
    def of(cls, circuit: Circuit, n: int | None = None) -> Channel:
        """Return channel `n` with the row that it drives most.

        Without `n` it is the middle channel, or the first one that has a matrix resistor.
        """
        present = np.isfinite(circuit.forward.ohms)
        if n is None:
            n = 1 + (present.shape[1] - 1) // 2
            if not present[:, n - 1].any():
                n = 1 + int(np.flatnonzero(present.any(axis=0))[0])
        return cls(circuit, n, 1 + int(np.argmin(circuit.forward.ohms[:, n - 1])))

    @property
    def forward(self) -> ResistorMatrix:
        """The matrix whose row `k` sums into the constraint node."""
        return self.circuit.forward

    @property
    def feedback(self) -> ResistorMatrix:
        """The matrix whose column `n` sums into the signal node."""
        return self.circuit.feedback

    @property
    def connected(self) -> bool:
        """Whether the channel has a matrix resistor."""
        return bool(np.isfinite(self.forward.ohms[:, self.n - 1]).any())

    def rungs(self, matrix: ResistorMatrix) -> list[Resistor]:
        """Return the resistors of `matrix` into this channel's or row's node, `a` their driver."""
        place = (self.k if matrix.by_column else self.n) - 1
        chosen = np.zeros_like(matrix.negative)
        chosen[(place,) if matrix.by_column else (slice(None), place)] = True
        return list(replace(matrix, ohms=np.where(chosen, matrix.ohms, np.inf)).resistors())

    def resistor(self, name: str) -> Resistor | None:
        """Return a resistor of the board, None without one of this name."""
        return next((each for each in self.circuit.resistors if each.name == name), None)

    def ohms(self, name: str) -> float | None:
        """Return the value of a resistor; None if the board has no such resistor."""
        found = self.resistor(name)
        return None if found is None else found.ohms

    def capacitor(self, name: str) -> Capacitor | None:
        """Return a capacitor of the board, None without one of this name."""
        return next((each for each in self.circuit.capacitors if each.name == name), None)

    @property
    def farads(self) -> float:
        """C of the channel."""
        return next(c.farads for c in self.circuit.capacitors if c.name == f"c_{self.n}")

    def opamp(self, output: str) -> OpAmpCell | None:
        """Return the op-amp that drives a node."""
        return next((each for each in self.circuit.opamps if each.output == output), None)

    @property
    def amplifier(self) -> SignalAmplifier | None:
        """The ideal amplifier of the channel."""
        return next((a for a in self.circuit.amplifiers if a.name == f"a_{self.n}"), None)

    @property
    def transistors(self) -> tuple[TransistorCell, ...]:
        """The pair of the channel's antilog stage: the reference and the output transistor."""
        names = (f"ref_{self.n}", f"out_{self.n}")
        return tuple(each for each in self.circuit.transistors if each.name in names)

    @property
    def strain(self) -> CurrentSource | None:
        """The strain current into the row."""
        name = f"eps_{self.k}"
        return next((each for each in self.circuit.currents if each.name == name), None)

    @property
    def entry(self) -> float:
        """The matrix resistor between channel and row, ohm."""
        return float(self.forward.ohms[self.k - 1, self.n - 1])

    @property
    def negative(self) -> bool:
        """Whether the entry of T between channel and row is negative."""
        return bool(self.forward.negative[self.k - 1, self.n - 1])
