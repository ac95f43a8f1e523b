"""The arrays of a board with their wires: as a deck has them, and as they look from their ports."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from taction.netlist_gen.board.circuit import Circuit
from taction.netlist_gen.board.parts import ResistorMatrix
from taction.netlist_gen.board.wires import Crossbar, Wires
from taction.system.array_types import Floats


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


def port_matrices(circuit: Circuit) -> tuple[ResistorMatrix, ...]:
    """Return the matrices of a board as they are seen from their ports; see `at_ports`."""
    return tuple(each for matrix in circuit.matrices for each in at_ports(matrix))


def joined_resistors(circuit: Circuit) -> Iterator[tuple[str, str, float]]:
    """Yield both nodes and ohms of every resistor, of wired arrays those between ports."""
    for part in circuit.resistors:
        yield part.a, part.b, part.ohms
    for matrix in port_matrices(circuit):
        for _, _, source, sink, ohms in matrix.elements():
            yield source, sink, ohms


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


def without_wires(circuit: Circuit) -> Circuit:
    """Return `circuit` as it would be with ideal wires: without them and their compensation."""
    if all(each.wires is None for each in circuit.matrices):
        return circuit
    scales = [1.0 if m.wires is None or m.wires.scale is None else m.wires.scale
              for m in circuit.matrices]  # fmt: skip
    pairs = zip(circuit.matrices, scales, strict=True)
    straight = tuple(replace(m, wires=None, ohms=m.ohms / scale) for m, scale in pairs)
    return replace(circuit, matrices=straight)
