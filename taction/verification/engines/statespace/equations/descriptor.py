"""The descriptor equations of a board, ``M z' = K z + b + f(z)``, as plain data.

The unknowns z are the node voltages (without ground), then the internal states of the op-amps.
The rows are Kirchhoff's current law at each node (A), except where an ideal source determines the
node's voltage (V), then the poles of the op-amps (V/s). M holds the capacitances and is singular. f
is the behavioural amplifiers, each in the row of its output. Only the resistor matrices
(`Coupling`) are arrays of size N². `stamps.stamp` makes the equations of a `Circuit`.
"""

from __future__ import annotations

import functools
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field, replace
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from taction.netlist_gen.board.circuit import Circuit
from taction.netlist_gen.board.parts import ResistorMatrix
from taction.system.array_types import Bools, Floats, Ints
from taction.system.errors import EngineError
from taction.verification.engines.statespace.equations.amplifier_gains import (
    GAINS,
    OPAMP_KINDS,
    Gain,
    gain_of,
)

LARGE = 600  # unknowns above which structured solves replace dense ones


class Triplets(NamedTuple):
    """A sparse matrix as ``(row, column, value)``; values at one place add up."""

    rows: Ints
    columns: Ints
    values: Floats

    def joined(self, other: Triplets) -> Triplets:
        """Return the sum with another matrix."""
        parts: Any = [np.concatenate(both) for both in zip(self, other, strict=True)]
        return Triplets(*parts)


@dataclass(frozen=True, slots=True, eq=False)
class Coupling:
    """Conductances between driving nodes and summing nodes, off the diagonal.

    `conductance` (S, D), in S, adds ``G z[drivers]`` to the rows of the sinks, and
    ``G^T z[sinks]`` to the rows of the `loaded` drivers, whose voltage no ideal source determines.
    The local stamps contain the diagonal. Conductances among nodes of one kind, as wires make them,
    have these nodes as sinks and as drivers; G then has both triangles, and no driver is `loaded`.
    """

    sinks: Ints
    drivers: Ints
    conductance: Floats
    loaded: Bools


class DenseMatrix(NamedTuple):
    """M and K of a board, (size, size) each."""

    mass: Floats
    stiffness: Floats


Device = tuple[str, int, int, float, float]


@dataclass(frozen=True, eq=False)
class Devices:
    """Behavioural amplifiers ``z[output] = -u_scale g(z[input] / v_scale)``, m each.

    Input stages and clamps of op-amps at the large-signal level are such amplifiers, too.
    """

    kinds: tuple[str, ...]
    input: Ints
    output: Ints
    u_scale: Floats
    v_scale: Floats

    @property
    def count(self) -> int:
        """Number of amplifiers."""
        return len(self.output)

    @property
    def limits(self) -> Bools:
        """Which of them are limits of op-amps, (m,)."""
        return np.array([kind in OPAMP_KINDS for kind in self.kinds], dtype=np.bool_)

    @functools.cached_property
    def gain(self) -> Gain:
        """Their functions g, for arrays of m rows."""
        return gain_of(self.kinds)

    @functools.cached_property
    def steepest(self) -> Floats:
        """The largest slopes of those of straight pieces, V/V, and 0 of all others, (m,)."""
        return self.u_scale / self.v_scale * [GAINS[kind].steepest for kind in self.kinds]

    def outputs(self, inputs: Floats) -> Floats:
        """Return the outputs at inputs (m, s), V; not finite beyond the range of floats."""
        values = self.gain.outputs(inputs / self.v_scale[:, None])
        return np.asarray(-self.u_scale[:, None] * values)

    def slopes(self, inputs: Floats) -> Floats:
        """Return the slopes at inputs (m, s), V/V; not finite beyond the range of floats."""
        with np.errstate(over="ignore"):
            slope = self.gain.slope(inputs / self.v_scale[:, None])
            return np.asarray(-(self.u_scale / self.v_scale)[:, None] * slope)

    @classmethod
    def of(cls, parts: Sequence[Device]) -> Devices:
        """Return amplifiers from their kinds, inputs, outputs and both scales."""
        kinds, inputs, outputs, u_scale, v_scale = zip(*parts, strict=True) if parts else [()] * 5
        places = np.array(inputs, dtype=np.int64), np.array(outputs, dtype=np.int64)
        return cls(tuple(kinds), *places, np.array(u_scale, float), np.array(v_scale, float))

    def part(self, chosen: Bools) -> Devices:
        """Return some of the amplifiers."""
        kinds = tuple(k for k, keep in zip(self.kinds, chosen.tolist(), strict=True) if keep)
        places = (self.input[chosen], self.output[chosen])
        return Devices(kinds, *places, self.u_scale[chosen], self.v_scale[chosen])


@dataclass(frozen=True, eq=False)
class Descriptor:
    """The equations of one board, ``M z' = K z + b + f(z)``."""

    # Of the unknowns: `node_count` nodes, then the poles of the op-amps, ``x<op-amp>.p1`` and
    # ``.p2``, named as in the deck's subcircuits.
    names: tuple[str, ...]
    node_count: int
    # `mass`, `local`: M, and K without the couplings.
    mass: Triplets
    local: Triplets
    couplings: tuple[Coupling, ...]  # the rest of K
    # `switched`, `constant`: b = switched (sources of the strain, on from t = 0) + constant (other
    # voltage sources).
    switched: Floats
    constant: Floats
    determined: Bools  # rows that state a voltage instead of a current balance
    devices: Devices  # f
    places: dict[str, int] = field(repr=False)  # index of each name
    # Whether the circuit has parts of a deck, between any two nodes: such a circuit has no design
    # that keeps its numbers apart, so rounding counts at every step, and the poles are counted.
    has_branches: bool = False
    # The rows that take the currents into nodes whose voltage a source between two nodes
    # determines; `GROUND` where the source's other node is ground.
    moved: dict[int, int] = field(default_factory=dict, repr=False)

    @functools.cached_property
    def balance_rows(self) -> Ints:
        """Row that takes the current into each unknown, (size + 1,); `size` is ground's.

        An ideal source to ground takes up the current into its node.
        """
        rows = np.arange(self.size + 1)
        for place, row in self.moved.items():
            rows[place] = row
        determined = np.append(self.determined, True)
        return np.where(determined[rows], self.size, rows)

    @property
    def size(self) -> int:
        """Number of unknowns."""
        return len(self.names)

    @property
    def is_large(self) -> bool:
        """Whether the board has too many unknowns for dense matrices."""
        return self.size > LARGE

    @functools.cached_property
    def dense(self) -> DenseMatrix:
        """M and K as full matrices, without the amplifiers' slopes; shape (size, size) each."""
        M, K = self.summed(np.asarray, np.zeros(self.devices.count))
        M.flags.writeable = K.flags.writeable = False
        return DenseMatrix(M, K)

    def summed(
        self, number: Callable[[Floats], NDArray[Any]], slopes: Floats
    ) -> tuple[NDArray[Any], NDArray[Any]]:
        """Return M and K of another type of number, (size, size) each: sums without rounding.

        `number` makes such numbers of doubles; `slopes` (m,) are the amplifiers'.
        """
        found = []
        for entries in (self.mass, self.local):
            values = number(entries.values)
            matrix = np.zeros((self.size, self.size), dtype=values.dtype)
            np.add.at(matrix, (entries.rows, entries.columns), values)
            found.append(matrix)
        mass, K = found
        for part in self.couplings:
            G = number(part.conductance)
            K[np.ix_(part.sinks, part.drivers)] += G
            K[np.ix_(part.drivers[part.loaded], part.sinks)] += G[:, part.loaded].T
        K[self.devices.output, self.devices.input] += number(slopes)
        return mass, K

    @functools.cached_property
    def without_limits(self) -> Descriptor:
        """The equations with op-amps that are linear: the limits' slopes at zero in their place."""
        limits = self.devices.limits
        removed, kept = self.devices.part(limits), self.devices.part(~limits)
        slopes = gain_of(removed.kinds).slope(np.zeros(removed.count))
        slopes *= -removed.u_scale / removed.v_scale
        added = Triplets(removed.output, removed.input, slopes)
        return replace(self, local=self.local.joined(added), devices=kept)

    def stiffness_times(self, z: Floats, *, magnitudes: bool = False) -> Floats:
        """Return K z, or ``|K| |z|``, without forming K; shape (size,)."""
        f = np.abs if magnitudes else np.asarray
        z, local = f(z), self.local
        product = np.zeros(self.size)
        product += np.bincount(local.rows, f(local.values) * z[local.columns], minlength=self.size)
        for part in self.couplings:
            np.add.at(product, part.sinks, f(part.conductance) @ z[part.drivers])
            np.add.at(product, part.drivers, f(part.conductance.T @ z[part.sinks]) * part.loaded)
        return product

    def drive(self, *, sources_on: bool) -> Floats:
        """Return b with the sources of the strain on or off, shape (size,)."""
        return self.constant + self.switched if sources_on else self.constant

    def place(self, name: str) -> int:
        """Return the index of a node or op-amp state in z; EngineError for an unknown name."""
        if name not in self.places:
            raise EngineError(f"the circuit has no node or op-amp state {name!r}")
        return self.places[name]


GROUND = -1


class Entries:
    """A growing matrix: rows, columns and values, ground included.

    A part between two nodes adds the opposite value in the same column to another row, of which
    its entry knows: `back` is that row, or ground.
    """

    def __init__(self) -> None:
        self.parts: list[tuple[int, int, float, int]] = []

    def add(self, row: int, column: int, value: float, back: int = GROUND) -> None:
        """Stamp one entry."""
        if value != 0.0:
            self.parts.append((row, column, value, back))

    def branch(self, a: int, b: int, value: float) -> None:
        """Stamp a two-terminal element between places a and b."""
        if value != 0.0:
            self.parts += [(a, a, value, b), (a, b, -value, b), (b, b, value, a), (b, a, -value, a)]

    def triplets(self, rows: Bools, moved: Ints | None = None) -> Triplets:
        """Return the entries of the chosen `rows` (size + 1, the last for ground).

        With `moved` (size + 1,), these rows take the place of all.
        """
        i, j, values, back = map(np.array, zip(*self.parts, strict=True) if self.parts else NOTHING)
        if moved is not None:
            i, back = moved[i], moved[back]
        # A part between two nodes that have one row adds exactly nothing to it.
        live = np.flatnonzero(rows[i] & (j != GROUND) & (i != back))
        return Triplets(i[live], j[live], values[live])


NOTHING: Any = [np.zeros(0, np.int64), np.zeros(0, np.int64), np.zeros(0), np.zeros(0, np.int64)]
Terms = list[tuple[int, float]]


class Stamper:
    """Collector of stamps: currents, which do not apply to rows of ideal sources, and laws.

    `constant_currents` and `constant_laws` are terms of b: places, and values; `switched` are
    terms of any row that begin at t = 0.
    """

    def __init__(self, circuit: Circuit) -> None:
        self.circuit = circuit
        self.places: dict[str, int] = {}
        self.fixed: set[int] = set()
        self.moved: dict[int, int] = {}
        self.currents, self.laws, self.mass = Entries(), Entries(), Entries()
        # Sinks, drivers, conductances, and whether they are among nodes of one kind.
        self.couplings: list[tuple[Ints, Ints, Floats, bool]] = []
        self.constant_currents, self.constant_laws, self.switched = Terms(), Terms(), Terms()
        self.devices: list[Device] = []

    def node(self, name: str) -> int:
        """Return the place of a node, `GROUND` for ground; a new name gets the next place."""
        return GROUND if name == "0" else self.places.setdefault(name, len(self.places))

    def unknown(self, name: str) -> int:
        """Return the place of a new unknown, whose row states a law."""
        place = self.node(name)
        self.fixed.add(place)
        return place

    def fix(self, node: str, source: str) -> None:
        """Reserve a node's row for an ideal source."""
        if node == "0" or self.places[node] in self.fixed:
            message = f"{source} drives a node whose voltage another ideal source determines"
            raise EngineError(message)
        self.fixed.add(self.places[node])

    def device(self, kind: str, place: int, output: str, size: float, width: float) -> int:
        """Add an amplifier whose output is a new unknown; return its place."""
        self.devices.append((kind, place, self.unknown(output), size, width))
        return self.devices[-1][2]

    def matrix(self, matrix: ResistorMatrix) -> None:
        """Stamp a resistor matrix: arrays off the diagonal, sums on the diagonal."""
        if matrix.is_mesh:
            self._mesh(matrix)
            return
        G, negative = np.divide(1.0, matrix.ohms), matrix.negative
        if not matrix.by_column:
            G, negative = G.T, negative.T
        live = np.flatnonzero(G.any(axis=1))  # the node of an empty row may not exist
        G, negative = G[live], negative[live]
        sinks = np.array([self.node(matrix.sinks[k]) for k in live.tolist()], dtype=np.int64)
        G = np.concatenate([np.where(negative, 0.0, G), np.where(negative, G, 0.0)], axis=1)
        used, names = np.flatnonzero(G.any(axis=0)), (*matrix.plus, *matrix.minus)
        drivers = np.array([self.node(names[d]) for d in used.tolist()], dtype=np.int64)
        G = G[:, used]
        for places, axis in ((sinks, 1), (drivers, 0)):
            self._diagonal(places, -G.sum(axis=axis))
        driven = drivers != GROUND
        self.couplings.append((sinks, drivers[driven], G[:, driven], False))

    def _mesh(self, matrix: ResistorMatrix) -> None:
        """Stamp resistors among the nodes of one kind, whose voltages sources may determine."""
        upper = np.divide(1.0, matrix.ohms)
        G = upper + upper.T
        live = np.flatnonzero(G.any(axis=1))
        nodes = np.array([self.node(matrix.sinks[k]) for k in live.tolist()], dtype=np.int64)
        G = G[np.ix_(live, live)]
        self._diagonal(nodes, -G.sum(axis=1))
        free = np.array([place not in self.fixed for place in nodes.tolist()], dtype=np.bool_)
        driven = nodes != GROUND
        if free.any():
            self.couplings.append((nodes[free], nodes[driven], G[np.ix_(free, driven)], True))

    def _diagonal(self, places: Ints, values: Floats) -> None:
        for place, value in zip(places.tolist(), values.tolist(), strict=True):
            self.currents.add(place, place, value)

    def sources(self) -> tuple[Floats, Floats]:
        """Stamp the laws of ideal sources; return b: switched and constant part, (size,)."""
        c = self.circuit
        strains = [(self.node(i.node), i.amps) for i in c.currents]
        for source in c.voltages:
            place = self.node(source.node)
            self.laws.add(place, place, -1.0)
            terms = self.switched if source.switched else self.constant_laws
            terms.append((place, source.volts))
        for device in self.devices:
            self.laws.add(device[2], device[2], -1.0)
        parts = (strains, self.switched), (self.constant_currents, self.constant_laws)
        switched, constant = (self._sums(*terms) for terms in parts)
        return switched, constant

    def _sums(self, *parts: Terms) -> Floats:
        """Return the sums of currents, of which fixed rows have none, and of laws, (size,)."""
        sums = np.zeros((2, len(self.places) + 1))  # the last place is ground
        for found, terms in zip(sums, parts, strict=True):
            for place, value in terms:
                found[place] += value
        sums[0, list(self.fixed)] = 0.0
        return np.asarray(sums.sum(axis=0)[:-1])
