"""One channel of a board with one sensor row: its stages, found from nodes and roles of parts."""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from taction.netlist_gen.board.circuit import (
    GROUND,
    Capacitor,
    Circuit,
    CurrentSource,
    OpAmpCell,
    Resistor,
    ResistorMatrix,
    Role,
    SignalAmplifier,
    TransistorCell,
)

Part = Resistor | Capacitor


@dataclass(frozen=True)
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
        ohms = circuit.forward.ohms
        present = np.isfinite(ohms)
        if n is None:
            n = 1 + (present.shape[1] - 1) // 2
            if not present[:, n - 1].any():
                n = 1 + int(np.flatnonzero(present.any(axis=0))[0])
        return cls(circuit, n, 1 + int(np.argmin(ohms[:, n - 1])))

    @property
    def connected(self) -> bool:
        """Whether the channel has a matrix resistor."""
        return bool(np.isfinite(self.circuit.forward.ohms[:, self.n - 1]).any())

    @property
    def v(self) -> str:
        """The signal node."""
        return self.circuit.signal_nodes[self.n - 1]

    @property
    def sink(self) -> str:
        """The node into which the feedback resistors go."""
        return self.circuit.feedback.sinks[self.n - 1]

    @property
    def row(self) -> str:
        """The summing node of the row."""
        return self.circuit.forward.sinks[self.k - 1]

    def rungs(self, matrix: ResistorMatrix) -> list[Resistor]:
        """Return the resistors of `matrix` into this channel's or row's node, `a` their driver."""
        place = (self.k if matrix.by_column else self.n) - 1
        chosen = np.zeros_like(matrix.negative)
        chosen[(place,) if matrix.by_column else (slice(None), place)] = True
        return list(replace(matrix, ohms=np.where(chosen, matrix.ohms, np.inf)).resistors())

    @cached_property
    def entry(self) -> float:
        """The matrix resistor between channel and row, ohm."""
        return float(self.circuit.forward.ohms[self.k - 1, self.n - 1])

    @property
    def negative(self) -> bool:
        """Whether the entry of T between channel and row is negative."""
        return bool(self.circuit.forward.negative[self.k - 1, self.n - 1])

    @property
    def farads(self) -> float:
        """C of the channel."""
        parts = self.circuit.capacitors_of(Role.SIGNAL_CAPACITOR)
        return next(part.farads for part in parts if {part.a, part.b} & {self.v, self.sink})

    def between(self, a: str, b: str) -> list[Part]:
        """Return resistors, then capacitors between two nodes, without stray capacitances."""
        parts: list[Part] = [*self.circuit.resistors, *self.circuit.real_capacitors]
        return [part for part in parts if {part.a, part.b} == {a, b}]

    def biases(self) -> list[Resistor]:
        """Return the resistors from constant voltages to the node of the feedback."""
        parts = self.circuit.resistors_of(Role.BIAS_RESISTOR)
        return [part for part in parts if part.b == self.sink]

    def summing(self, node: str) -> OpAmpCell | None:
        """Return the op-amp that holds a node at virtual ground."""
        return next((cell for cell in self.circuit.opamps if cell.inverting == node), None)

    def follower(self, node: str) -> OpAmpCell | None:
        """Return the buffer of a node."""
        return next((cell for cell in self.circuit.opamps if cell.noninverting == node), None)

    def inverter(self, node: str) -> tuple[Resistor, OpAmpCell] | None:
        """Return input resistor and op-amp of the inverter of a node."""
        for part in self.circuit.resistors_of(Role.INVERTER_RESISTOR):
            if part.a == node and (cell := self.summing(part.b)) and cell.output != node:
                return part, cell
        return None

    @property
    def amplifier(self) -> SignalAmplifier | None:
        """The ideal amplifier of the channel."""
        return next((each for each in self.circuit.amplifiers if each.input == self.v), None)

    @property
    def divider(self) -> Resistor | None:
        """The resistor from the signal node to the base of a transistor."""
        parts = self.circuit.resistors_of(Role.STAGE)
        return next((part for part in parts if part.a == self.v), None)

    @property
    def transistors(self) -> tuple[TransistorCell, ...]:
        """The pair of the channel's antilog stage: the reference and the output transistor."""
        base = self.divider.b if self.divider is not None else GROUND
        every = self.circuit.transistors
        emitters = {each.emitter for each in every if each.base == base != GROUND}
        return tuple(each for each in every if each.emitter in emitters)

    @property
    def strain(self) -> CurrentSource | None:
        """The strain current into the row."""
        return next((each for each in self.circuit.currents if each.node == self.row), None)
