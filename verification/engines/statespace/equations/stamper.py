"""Collect the stamps of a circuit's parts: entries of the matrices, and constant terms."""

from __future__ import annotations

from collections.abc import Iterable

import numpy as np

from taction.netlist_gen.board.circuit import Circuit, ResistorMatrix
from taction.system.array_types import Bools, Floats, Ints
from taction.system.errors import EngineError
from taction.verification.engines.statespace.equations.descriptor import Devices, Triplets

GROUND = -1


class Entries:
    """A growing matrix: arrays of (row, column, value), ground included."""

    def __init__(self) -> None:
        self.parts: list[tuple[Ints, Ints, Floats]] = []

    def add(self, rows: Ints, columns: Ints, values: Floats) -> None:
        """Stamp one entry in each row."""
        self.parts.append((rows, columns, values))

    def branch(self, a: Ints, b: Ints, values: Floats) -> None:
        """Stamp two-terminal elements between places a and b."""
        for p, q in ((a, b), (b, a)):
            self.add(p, p, values)
            self.add(p, q, -values)

    def triplets(self, rows: Bools) -> Triplets:
        """Return the entries of the chosen `rows` (size + 1, the last for ground)."""
        i, j, values = (np.concatenate(part) for part in zip(*self.parts, strict=True))
        live = np.flatnonzero(rows[i] & (j != GROUND) & (values != 0.0))
        return Triplets(i[live], j[live], values[live])


class Stamper:
    """Collector of stamps: currents, which do not apply to rows of ideal sources, and laws.

    `constant_currents` and `constant_laws` are terms of b: places, and values.
    """

    def __init__(self, circuit: Circuit) -> None:
        self.circuit = circuit
        self.places: dict[str, int] = {}
        self.fixed: set[int] = set()
        self.currents, self.laws, self.mass = Entries(), Entries(), Entries()
        self.couplings: list[tuple[Ints, Ints, Floats]] = []
        self.constant_currents: list[tuple[Ints, Floats]] = []
        self.constant_laws: list[tuple[Ints, Floats]] = []

    def nodes(self, names: Iterable[str]) -> Ints:
        """Return the places of nodes, `GROUND` for ground; a new name gets the next place."""
        places = self.places
        indices = [GROUND if n == "0" else places.setdefault(n, len(places)) for n in names]
        return np.array(indices, dtype=np.int64)

    def fix(self, node: str, source: str) -> None:
        """Reserve a node's row for an ideal source."""
        if node == "0" or self.places[node] in self.fixed:
            message = f"{source} drives a node whose voltage another ideal source determines"
            raise EngineError(message)
        self.fixed.add(self.places[node])

    def matrix(self, matrix: ResistorMatrix) -> None:
        """Stamp a resistor matrix: arrays off the diagonal, sums on the diagonal."""
        G = np.divide(1.0, matrix.ohms)
        G, negative = (G, matrix.negative) if matrix.by_column else (G.T, matrix.negative.T)
        live = np.flatnonzero(G.any(axis=1))  # the node of an empty row may not exist
        G, negative = G[live], negative[live]
        sinks = self.nodes(matrix.sinks[k] for k in live.tolist())
        G = np.concatenate([np.where(negative, 0.0, G), np.where(negative, G, 0.0)], axis=1)
        used, names = np.flatnonzero(G.any(axis=0)), (*matrix.plus, *matrix.minus)
        drivers = self.nodes(names[d] for d in used.tolist())
        G = np.ascontiguousarray(G[:, used])
        # Sorted, so that the sums of mirrored rows are equal to the bit.
        for places, axis in ((sinks, 1), (drivers, 0)):
            self.currents.add(places, places, -np.sort(G, axis=axis).sum(axis=axis))
        driven = drivers != GROUND
        self.couplings.append((sinks, drivers[driven], G[:, driven]))

    def sources(self, devices: Devices) -> tuple[Floats, Floats]:
        """Stamp the laws of ideal sources; return b: switched and constant part, (size,)."""
        c, size = self.circuit, len(self.places)
        nodes = self.nodes(v.node for v in c.voltages)
        self.constant_laws.append((nodes, np.array([v.volts for v in c.voltages])))
        for places in (nodes, devices.output):
            self.laws.add(places, places, -np.ones(len(places)))
        into = self.nodes(i.node for i in c.currents)
        amps = np.array([i.amps for i in c.currents], dtype=np.float64)
        b = np.zeros((2, size + 1))  # the last place is ground
        np.add.at(b[0], into, amps)
        for places, values in self.constant_currents:
            np.add.at(b[1], places, values)
        b[:, list(self.fixed)] = 0.0
        for places, values in self.constant_laws:
            np.add.at(b[1], places, values)
        return b[0, :size], b[1, :size]
