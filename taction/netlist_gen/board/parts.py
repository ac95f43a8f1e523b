"""The parts of a board, with their values and nodes; a matrix of resistors is one part.

Node ``"0"`` is ground. Matrices are arrays, never N² objects.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from typing import ClassVar

import numpy as np

from taction.netlist_gen.board.devices import Device
from taction.netlist_gen.board.wires import Wires
from taction.spice_models.branches import label_of
from taction.system.array_types import Bools, Floats


@dataclass(frozen=True, slots=True)
class Part:
    """A part with a name; its card in the deck begins with the letter of its kind."""

    letter: ClassVar[str]
    name: str

    @property
    def card(self) -> str:
        """Its name in the deck."""
        return self.letter + self.name

    @property
    def label(self) -> str:
        """Its name as its designer wrote it: that in the deck, or ``x1.Rin`` in a subcircuit."""
        return label_of(self.letter, self.name)


@dataclass(frozen=True, slots=True)
class OpAmpCell(Part):
    """One op-amp: `model` is a key of `Circuit.models`; the rest are node names."""

    letter: ClassVar[str] = "X"
    model: str
    noninverting: str
    inverting: str
    output: str


@dataclass(frozen=True, slots=True)
class SignalAmplifier(Part):
    """A behavioural amplifier, ideal and inverting: ``V(output) = -u_scale g(V(input) / v_scale)``.

    `kind` is a key of `spice_models.amplifier.AMPLIFIERS` except ``"linear"``, an op-amp inverter.
    """

    letter: ClassVar[str] = "B"
    kind: str
    input: str
    output: str
    u_scale: float
    v_scale: float


@dataclass(frozen=True, slots=True)
class TransistorCell(Part):
    """One transistor: `model` is a key of `Circuit.transistor_models`; the rest are node names."""

    letter: ClassVar[str] = "Q"
    model: str
    collector: str
    base: str
    emitter: str


@dataclass(frozen=True, slots=True)
class Resistor(Part):
    """A resistor between nodes `a` and `b`, ohm."""

    letter: ClassVar[str] = "R"
    a: str
    b: str
    ohms: float


@dataclass(frozen=True, slots=True)
class Capacitor(Part):
    """A capacitor between nodes `a` and `b`, F; at t = 0 discharged or at rest."""

    letter: ClassVar[str] = "C"
    a: str
    b: str
    farads: float


@dataclass(frozen=True, slots=True)
class CurrentSource(Part):
    """A current of `amps` into `node` (out of ground), switched on at t = 0."""

    letter: ClassVar[str] = "I"
    node: str
    amps: float


@dataclass(frozen=True, slots=True)
class NoiseCurrent(Part):
    """A white noise current into `node`, of a `density` in A/rtHz over positive frequencies."""

    letter: ClassVar[str] = "G"
    node: str
    density: float


@dataclass(frozen=True, slots=True)
class VoltageSource(Part):
    """A voltage from ground to `node`: constant, or `switched` on at t = 0."""

    letter: ClassVar[str] = "V"
    node: str
    volts: float
    switched: bool = False


@dataclass(frozen=True, slots=True, eq=False)
class ResistorMatrix:
    """An M-by-N matrix of resistors; element (k, n) has the name ``Rf_k_n``, counted from 1."""

    name: str  # "Rf" (forward) or "Rb" (feedback)
    ohms: Floats  # (M, N); infinite where there is no resistor
    negative: Bools  # (M, N): the entry of T is negative; a node of `minus` drives the resistor
    by_column: bool  # columns drive and rows sum (forward); else rows drive (feedback)
    plus: tuple[str, ...]  # driving nodes of positive entries
    minus: tuple[str, ...]  # driving nodes of negative entries, "" where there is no such entry
    sinks: tuple[str, ...]  # summing nodes, one per index of the other axis
    opposite: bool = False  # the sinks are the other inputs: every entry counts as negative
    wires: Wires | None = None  # between the entries and the nodes; None: ideal
    device: Device | None = None  # what the entries are; None: resistors

    @property
    def is_mesh(self) -> bool:
        """Whether its resistors are between nodes of one kind."""
        return self.plus == self.sinks

    def places(self) -> Iterator[tuple[str, int, int]]:
        """Yield ``("Rf_1_3", 0, 2)``, name and place, of every resistor by rows."""
        for k, n in np.argwhere(np.isfinite(self.ohms)).tolist():
            yield f"{self.name}_{k + 1}_{n + 1}", k, n

    def elements(self) -> Iterator[tuple[int, int, str, str, float]]:
        """Yield ``(k, n, driving node, summing node, ohms)`` of every resistor, from 0."""
        finite = np.isfinite(self.ohms)
        for k, n in zip(*(index.tolist() for index in np.nonzero(finite)), strict=True):
            drive, sink = (n, k) if self.by_column else (k, n)
            source = self.minus[drive] if self.negative[k, n] else self.plus[drive]
            yield k, n, source, self.sinks[sink], float(self.ohms[k, n])

    def resistors(self) -> Iterator[Resistor]:
        """Yield every resistor by rows, from its driving node to its summing node."""
        for k, n, source, sink, ohms in self.elements():
            yield Resistor(f"{self.name[1:]}_{k + 1}_{n + 1}", source, sink, ohms)
