"""From descriptor equations to the state space of a board: nodes without capacitance eliminated.

``x' = A x + B [on, 1]`` with every unknown of the board recovered by ``z = C x + D [on, 1]``; the
first input is the strain currents (0 or 1), the second what is on for all time. The states are
the voltages of nodes that carry charge and the poles of the op-amps.
"""

from __future__ import annotations

import functools
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from spice_models.array_types import Complexes, Floats
from spice_models.errors import EngineError
from verification.engines.statespace.equations.amplifier_gains import gain_of
from verification.engines.statespace.equations.descriptor import Descriptor
from verification.engines.statespace.equations.mirror_symmetry import (
    Dense,
    Halves,
    evened,
)
from verification.engines.statespace.linearised.elimination import Reduced, reduce
from verification.engines.statespace.linearised.equilibrium import Equilibrium
from verification.engines.statespace.linearised.modes import Modes, decompose


@dataclass(frozen=True, eq=False)
class StateSpace:
    """A board as ``x' = A x + B [on, 1]``, ``z = C x + D [on, 1]``.

    Attributes
    ----------
    descriptor : Descriptor
        Where it came from.
    states : tuple of str
        Names of x.
    blocks : tuple of Reduced
        The board, or what it is on even and on odd vectors where it is its own mirror image
        (`mirror`): whoever can do with these is done in a quarter of the time.
    halves : tuple of Halves, or None
        How the two belong together: of the unknowns z, and of the states x.
    A : ndarray (n, n)
        1/s.
    B : ndarray (n, 2)
        V/s: for the switched currents, and for what is constant.
    C, D : ndarray (size, n) and (size, 2)
        Every node voltage and op-amp state, V.
    charge, charge_offset : ndarray (n, size) and (n,)
        ``x = charge z + charge_offset`` from the charges that voltages z put on the capacitors;
        z need not be consistent (all zero: everything discharged).
    """

    descriptor: Descriptor
    states: tuple[str, ...]
    blocks: tuple[Reduced, ...]
    halves: tuple[Halves, Halves] | None

    @property
    def n(self) -> int:
        """Number of states."""
        return len(self.states)

    @property
    def nodes(self) -> tuple[str, ...]:
        """Names of the rows of C."""
        return self.descriptor.names

    @functools.cached_property
    def eigenvalues(self) -> Complexes:
        """Of A, 1/s, (n,), in no order; cheaper than `modes`."""
        found = [np.linalg.eigvals(block.A) for block in self.blocks]
        return np.concatenate(found).astype(np.complex128)

    @functools.cached_property
    def modes(self) -> Modes:
        """Eigenvalues of A with their vectors."""
        return decompose([block.A for block in self.blocks], self.halves and self.halves[1])

    @functools.cached_property
    def A(self) -> Floats:  # noqa: N802 - as every textbook has it
        """See the class."""
        if self.halves is None:
            return self.blocks[0].A
        _, states = self.halves
        return states.join_rows(*states.rows_at(slice(None), *(part.A for part in self.blocks)))

    @functools.cached_property
    def B(self) -> Floats:  # noqa: N802 - as every textbook has it
        """See the class."""
        parts = [part.B for part in self.blocks]
        return parts[0] if self.halves is None else self.halves[1].join_vectors(*parts)

    @functools.cached_property
    def C(self) -> Floats:  # noqa: N802 - as every textbook has it
        """See the class."""
        return self._rows(slice(None))[0]

    @functools.cached_property
    def D(self) -> Floats:  # noqa: N802 - as every textbook has it
        """See the class."""
        return self._rows(slice(None))[1]

    @functools.cached_property
    def charge(self) -> Floats:
        """See the class."""
        if self.halves is None:
            return self.blocks[0].charge
        unknowns, states = self.halves
        parts = states.rows_at(slice(None), *(part.charge for part in self.blocks))
        return unknowns.join_rows(*parts)

    @functools.cached_property
    def charge_offset(self) -> Floats:
        """See the class."""
        parts = [part.offset for part in self.blocks]
        return parts[0] if self.halves is None else self.halves[1].join_vectors(*parts)

    def state_of(self, z: Floats) -> Floats:
        """``charge z + charge_offset``, shape (n,)."""
        parts = (z,) if self.halves is None else self.halves[0].split_vectors(z)
        pairs = zip(self.blocks, parts, strict=True)
        found = [block.charge @ part + block.offset for block, part in pairs]
        return found[0] if self.halves is None else self.halves[1].join_vectors(*found)

    def rows(self, names: Sequence[str]) -> tuple[Floats, Floats]:
        """Rows of C and D of the named nodes; zeros for ground.

        Raises
        ------
        EngineError
            A node that the circuit does not have.
        """
        live = [k for k, name in enumerate(names) if name != "0"]
        found = self._rows([self.descriptor.place(names[k]) for k in live])
        if len(live) == len(names):
            return found
        C, D = (np.zeros((len(names), part.shape[1])) for part in found)
        C[live], D[live] = found
        return C, D

    def _rows(self, places: slice | list[int]) -> tuple[Floats, Floats]:
        """Rows of C and D."""
        if self.halves is None:
            return self.blocks[0].C[places], self.blocks[0].D[places]
        unknowns, states = self.halves
        C = unknowns.rows_at(places, *(part.C for part in self.blocks))
        even, odd = unknowns.rows_at(places, *(part.D for part in self.blocks))
        return states.join_rows(*C), even + odd


def linearise(descriptor: Descriptor, point: Equilibrium | None) -> StateSpace:
    """Linearise a board, for a board without behavioural amplifiers an exact statement.

    Parameters
    ----------
    descriptor : Descriptor
        The board.
    point : Equilibrium or None
        Where; only a board with behavioural amplifiers needs it.

    Returns
    -------
    StateSpace
        Dense; x is a vector of voltages, not of deviations.

    Raises
    ------
    EngineError
        The equations have no state-space form (a node without any path, or charges that are not
        free, such as a loop of capacitors and voltage sources).

    Notes
    -----
    Costs a few dense factorisations of all unknowns.
    """
    b, devices = np.stack([descriptor.switched, descriptor.constant], axis=1), descriptor.devices
    if point is None:
        return _state_space(descriptor, descriptor.dense, b)
    v = point.values[devices.input]
    slopes = evened(point.slopes, devices.output, descriptor.mirror)
    K = descriptor.dense.stiffness.copy()
    K[devices.output, devices.input] += slopes
    value = gain_of(devices.kind).value(v / devices.v_scale)
    b[devices.output, 1] += -devices.u_scale * value - slopes * v
    return _state_space(descriptor, descriptor.dense.with_stiffness(K), b)


def open_loop(descriptor: Descriptor) -> StateSpace:
    """State space with the outputs of the m behavioural amplifiers as further inputs.

    B and D then have ``2 + m`` columns: ``z = C x + D [on, 1, v_out]``.

    Raises
    ------
    EngineError
        As `linearise`; also for a capacitor at such an output, whose current would need the
        output's time derivative.
    """
    devices = descriptor.devices
    b = np.zeros((descriptor.size, 2 + devices.count))
    b[:, 0], b[:, 1] = descriptor.switched, descriptor.constant
    b[devices.output, 2 + np.arange(devices.count)] = 1.0
    return _state_space(descriptor, descriptor.dense, b)


def _state_space(descriptor: Descriptor, board: Dense, b: Floats) -> StateSpace:
    """Reduce the equations, half by half where the board is its own mirror image."""
    names, determined, halves = descriptor.names, descriptor.determined, board.halves
    if halves is None:
        block = reduce(board.mass, board.stiffness, b, determined, names)
        if block.places is None:
            charged = tuple(f"charge{k + 1}" for k in range(len(block.A)))
        else:
            charged = tuple(names[place] for place in block.places.tolist())
        return StateSpace(descriptor, charged, (block,), None)
    whole = replace(board, halves=None)
    listed = [names[place] for place in halves.own.tolist()]
    parts = zip(board.blocks, halves.split_vectors(b), strict=True)
    try:
        even, odd = (
            reduce(M, K, inputs, determined[halves.own[: len(K)]], listed)
            for (M, K), inputs in parts
        )
    except EngineError:  # whoever reads its message knows the whole board only
        return _state_space(descriptor, whole, b)
    if even.places is None or odd.places is None:
        return _state_space(descriptor, whole, b)
    places, states = halves.within(even.places)
    if not (states.pairs > 0 and np.array_equal(even.places[: states.pairs], odd.places)):
        return _state_space(descriptor, whole, b)
    charged = tuple(names[place] for place in places.tolist())
    return StateSpace(descriptor, charged, (even, odd), (halves, states))
