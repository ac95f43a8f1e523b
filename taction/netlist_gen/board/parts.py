"""The parts of a board, with their values and nodes; a matrix of resistors is one part.

Node ``"0"`` is ground. Matrices are arrays, never N² objects. An array with wires is one
thing in a deck, which has every wire (`wire_branches`), and another from its ports (`at_ports`).
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import ClassVar

import numpy as np

from taction.netlist_gen.board.arrays import Crossbar, Device, Wires
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
        negative, ohms = self.negative.tolist(), self.ohms.tolist()
        for k, n in np.argwhere(np.isfinite(self.ohms)).tolist():
            drive, sink = (n, k) if self.by_column else (k, n)
            source = self.minus[drive] if negative[k][n] else self.plus[drive]
            yield k, n, source, self.sinks[sink], ohms[k][n]

    def resistors(self) -> Iterator[Resistor]:
        """Yield every resistor by rows, from its driving node to its summing node."""
        for k, n, source, sink, ohms in self.elements():
            yield Resistor(f"{self.name[1:]}_{k + 1}_{n + 1}", source, sink, ohms)


PLACES: Mapping[type, str] = {
    OpAmpCell: "opamps",
    SignalAmplifier: "amplifiers",
    TransistorCell: "transistors",
    Resistor: "resistors",
    ResistorMatrix: "matrices",
    Capacitor: "capacitors",
    CurrentSource: "currents",
    NoiseCurrent: "noises",
    VoltageSource: "voltages",
}
"""Where a `Circuit` has the parts of a class."""


@dataclass(frozen=True, slots=True, eq=False)
class SignedArray:
    """The array that a matrix of resistors has for its entries of one sign."""

    negative: bool  # whether it is that of the negative entries
    siemens: Floats  # (M, N): its entries; zero where there is none
    words: Sequence[str]  # the nodes at which its lines end
    bits: Sequence[str]


def signed_arrays(matrix: ResistorMatrix) -> Iterator[SignedArray]:
    """Yield the arrays of a matrix, that of the positive entries first; only those with entries."""
    siemens = 1.0 / matrix.ohms
    for negative, drives in ((False, matrix.plus), (True, matrix.minus)):
        here = np.where(matrix.negative == negative, siemens, 0.0)
        if here.any():
            ends = (matrix.sinks, drives) if matrix.by_column else (drives, matrix.sinks)
            yield SignedArray(negative, here, *ends)


def at_ports(matrix: ResistorMatrix) -> tuple[ResistorMatrix, ...]:
    """Return the matrices of resistors between the ports of an array, without wires."""
    if matrix.wires is None:
        return (matrix,)
    found = []
    for array in signed_arrays(matrix):
        ports = matrix.wires.at_ports(array.siemens, by_column=matrix.by_column)
        signs = np.full(matrix.ohms.shape, array.negative)
        found.append(replace(matrix, ohms=as_ohms(ports.across), negative=signs, wires=None))
        for nodes, mesh in ((array.words, ports.words), (array.bits, ports.bits)):
            if mesh.any():
                ends, none = tuple(nodes), np.zeros(mesh.shape, dtype=np.bool_)
                between = replace(matrix, ohms=as_ohms(np.triu(mesh)), negative=none, wires=None)
                empty = ("",) * len(ends)
                between = replace(between, by_column=True, plus=ends, minus=empty, sinks=ends)
                found.append(between)
    return tuple(found)


def as_ohms(siemens: Floats) -> Floats:
    """Return the resistances of conductances, infinite for zero."""
    with np.errstate(divide="ignore"):
        return np.asarray(1.0 / siemens)


def wire_branches(matrix: ResistorMatrix) -> Iterator[tuple[str, str, str, float]]:
    """Yield name, both nodes and ohms of every entry of a wired matrix, then of its wires.

    ``Rfw_3_5`` and ``Rfb_3_5`` lead from the crossing of word line 3 and bit line 5, where the
    nodes are ``fw_3_5`` and ``fb_3_5``, towards the ports of both. A wire of 0 ohm is one node.
    """
    wires = matrix.wires or Wires()
    along, down = wires.distances(matrix.ohms.shape)
    word, bit = wires.terminals(matrix.by_column)
    entries, segments = [], []
    for array in signed_arrays(matrix):
        rows, nodes = array.siemens > 0.0, dict[tuple[str, int, int], str]()
        lines = (
            ("w", array.words, rows, along, wires.word_line, word),
            ("b", array.bits, rows.T, down, wires.bit_line, bit),
        )
        for letter, ports, present, distance, pitch, terminal in lines:
            for number, port in enumerate(ports):
                node, before, more = port, 0.0, terminal
                places = np.flatnonzero(present[number])
                for place in places[np.argsort(distance[places])].tolist():
                    k, n = (number, place) if letter == "w" else (place, number)
                    name = f"{letter}_{k + 1}_{n + 1}"
                    ohms = more + pitch * float(distance[place] - before)
                    if ohms:
                        there = f"{matrix.name[1:]}{name}"
                        segments.append((f"{matrix.name}{name}", node, there, ohms))
                        node = there
                    nodes[letter, k, n], before, more = node, float(distance[place]), 0.0
        for k, n in np.argwhere(rows).tolist():
            ends = nodes["w", k, n], nodes["b", k, n]
            drive, sink = reversed(ends) if matrix.by_column else ends
            entries.append(
                (f"{matrix.name}_{k + 1}_{n + 1}", drive, sink, float(matrix.ohms[k, n]))
            )
    yield from entries
    yield from segments


def entry_voltages(matrix: ResistorMatrix, volts: Mapping[str, Floats]) -> Floats:
    """Return the voltages of all entries, driving to summing line, (M, N, k)."""
    width = next(iter(volts.values())).shape
    found, wires = np.zeros((*matrix.ohms.shape, *width)), matrix.wires or Wires()
    terminals = wires.terminals(matrix.by_column)
    for array in signed_arrays(matrix):
        ends, nothing = [], np.zeros(width)
        for nodes in (array.words, array.bits):
            ends.append(np.array([volts.get(node, nothing) for node in nodes]))
        Y = wires.at_ports(array.siemens, by_column=matrix.by_column).admittance()
        amps = np.split(Y @ np.concatenate(ends), [len(ends[0])])
        pairs = zip(ends, terminals, amps, strict=True)
        at_lines = (end - ohms * current for end, ohms, current in pairs)
        across = Crossbar(array.siemens, wires).entry_voltages(*at_lines)
        across *= (array.siemens > 0.0).reshape(*matrix.ohms.shape, *(1 for _ in width))
        found += -across if matrix.by_column else across
    return found
