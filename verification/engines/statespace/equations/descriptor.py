"""The descriptor equations of a board, ``M z' = K z + b + f(z)``, as plain data.

Unknowns z: every node voltage (ground left out), then the internal states of every op-amp.
Rows: Kirchhoff's current law at each node (A), except where an ideal source determines the node's
voltage (V); then the poles of the op-amps (V/s). M is the capacitances and is singular. f is the
behavioural amplifiers, each in the row of its own output. The resistor matrices stay arrays
(`Coupling`): nothing here is of size N² but they. `stamps.stamp` makes it from a `Circuit`.
"""

from __future__ import annotations

import functools
from dataclasses import dataclass, field

import numpy as np

from spice_models.array_types import Bools, Floats, Ints
from spice_models.errors import EngineError
from verification.engines.statespace.equations.mirror_symmetry import Dense, Halves

LARGE = 600  # unknowns above which a board is solved through its structure, not densely


@dataclass(frozen=True, slots=True, eq=False)
class Triplets:
    """A sparse matrix as ``(row, column, value)``; equal places add."""

    rows: Ints
    columns: Ints
    values: Floats

    def dense(self, size: int) -> Floats:
        """Return the matrix, shape (size, size)."""
        sums = np.bincount(self.rows * size + self.columns, self.values, minlength=size**2)
        return sums.astype(np.float64, copy=False).reshape(size, size)


@dataclass(frozen=True, slots=True, eq=False)
class Coupling:
    """Conductances between driving nodes and summing nodes, off the diagonal.

    Attributes
    ----------
    sinks, drivers : ndarray of int, (S,) and (D,)
        Places in z.
    conductance : ndarray (S, D)
        S; adds ``G z[drivers]`` to the rows of the sinks and ``G^T z[sinks]`` to the rows of
        those drivers whose voltage no ideal source determines (`loaded`). What the diagonal gets
        is among the local stamps.
    loaded : ndarray of bool (D,)
        Drivers that feel their load.
    """

    sinks: Ints
    drivers: Ints
    conductance: Floats
    loaded: Bools


@dataclass(frozen=True, slots=True, eq=False)
class Devices:
    """Behavioural amplifiers ``z[output] = -u_scale g(z[input] / v_scale)``, shape (m,) each."""

    kind: str
    input: Ints
    output: Ints
    u_scale: Floats
    v_scale: Floats

    @property
    def count(self) -> int:
        """How many there are."""
        return len(self.output)


@dataclass(frozen=True, eq=False)
class Descriptor:
    """The equations of one board, ``M z' = K z + b + f(z)``.

    Attributes
    ----------
    names : tuple of str
        Of the unknowns: nodes, then the poles of the op-amps, ``x<op-amp>.p1`` and ``.p2``
        (the names that the deck's subcircuits have for them).
    node_count : int
        How many of the unknowns are nodes.
    mass, local : Triplets
        M, and K without the couplings.
    couplings : tuple of Coupling
        The rest of K.
    switched, constant : ndarray (size,)
        b = switched (current sources, on from t = 0) + constant (voltage sources).
    determined : ndarray of bool (size,)
        Rows that state a voltage instead of a current balance.
    devices : Devices
        f.
    places : dict
        Where each name stands.
    mirror : Halves or None
        The exchange that the names propose; it holds where the matrices commute with it.
    """

    names: tuple[str, ...]
    node_count: int
    mass: Triplets
    local: Triplets
    couplings: tuple[Coupling, ...]
    switched: Floats
    constant: Floats
    determined: Bools
    devices: Devices
    places: dict[str, int] = field(repr=False)
    mirror: Halves | None = field(repr=False)

    @property
    def size(self) -> int:
        """Number of unknowns."""
        return len(self.names)

    @property
    def is_large(self) -> bool:
        """Whether there are too many unknowns for dense matrices of all of them."""
        return self.size > LARGE

    @functools.cached_property
    def dense(self) -> Dense:
        """M and K written out, without the amplifiers' slopes; shape (size, size) each."""
        M, K = self.mass.dense(self.size), self._dense_stiffness()
        return Dense.of(M, K, self.determined, self.mirror)

    def _dense_stiffness(self) -> Floats:
        flat, values = [self.local.rows * self.size + self.local.columns], [self.local.values]
        for part in self.couplings:
            drivers = part.drivers[part.loaded]
            flat.append((part.sinks[:, None] * self.size + part.drivers).ravel())
            flat.append((part.sinks[:, None] + drivers * self.size).ravel())
            values += [part.conductance.ravel(), part.conductance[:, part.loaded].ravel()]
        sums = np.bincount(np.concatenate(flat), np.concatenate(values), minlength=self.size**2)
        return sums.astype(np.float64, copy=False).reshape(self.size, self.size)

    def stiffness_times(self, z: Floats, *, magnitudes: bool = False) -> Floats:
        """K z, or ``|K| |z|``, without forming K; shape (size,)."""
        f = np.abs if magnitudes else np.asarray
        z, local = f(z), self.local
        found = np.zeros(self.size)
        found += np.bincount(local.rows, f(local.values) * z[local.columns], minlength=self.size)
        for part in self.couplings:
            np.add.at(found, part.sinks, f(part.conductance) @ z[part.drivers])
            np.add.at(found, part.drivers, f(part.conductance.T @ z[part.sinks]) * part.loaded)
        return found

    def drive(self, *, sources_on: bool) -> Floats:
        """B with the current sources on or off, shape (size,)."""
        return self.constant + self.switched if sources_on else self.constant

    def place(self, name: str) -> int:
        """Place of a node or op-amp state in z.

        Raises
        ------
        EngineError
            There is none of that name.
        """
        if name not in self.places:
            message = f"the circuit has no node or op-amp state {name!r}"
            raise EngineError(message)
        return self.places[name]
