"""The state space of a board: ``x' = A x + B [on, 1]`` and ``z = C x + D [on, 1]``.

The first input is the strain currents (0 or 1), the second the constant sources. The states x are
the voltages of nodes that carry charge and the poles of the op-amps; the other unknowns of the
descriptor equations are eliminated, and recovered with all others in z.
"""

from __future__ import annotations

import contextlib
import functools
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from taction.system.array_types import Floats, Ints
from taction.system.errors import EngineError
from taction.verification.engines.statespace.equations.amplifier_gains import gain_of
from taction.verification.engines.statespace.equations.descriptor import Descriptor
from taction.verification.engines.statespace.equations.mirror_symmetry import (
    DenseMatrix,
    block_diagonal,
    evened,
)
from taction.verification.engines.statespace.equations.pole_count import finite_poles
from taction.verification.engines.statespace.linearised.equilibrium import Equilibrium
from taction.verification.engines.statespace.linearised.modes import Modes
from taction.verification.engines.statespace.linearised.modes import find_modes as modes_of
from taction.verification.engines.statespace.linearised.reduction import (
    Pencil,
    Reduced,
    reduce_pencil,
)

LOST = "rounding leaves nothing of the circuit's poles: parts cancel to the last digit"


@dataclass(frozen=True, eq=False)
class StateSpace:
    """A board as ``x' = A x + B [on, 1]``, ``z = C x + D [on, 1]``.

    Attributes
    ----------
    A, B : ndarray (n, n) and (n, 2)
        1/s, and V/s.
    C, D : ndarray (size, n) and (size, 2)
        Every node voltage and op-amp state, V.
    """

    descriptor: Descriptor
    states: tuple[str, ...]  # names of x
    # Those of the states, which are solved by themselves: one, or two of a board that is its own
    # mirror image, which costs a quarter.
    blocks: tuple[Reduced, ...]
    lost: int = 0  # poles of the board that are so far away that rounding hides them

    @property
    def n(self) -> int:
        """Number of states."""
        return len(self.states)

    @property
    def nodes(self) -> tuple[str, ...]:
        """Names of the rows of C."""
        return self.descriptor.names

    @functools.cached_property
    def modes(self) -> Modes:
        """Eigenvalues of A with their vectors."""
        return modes_of(self.blocks)

    @property
    def has_modes(self) -> bool:
        """Whether the modes have been computed."""
        return "modes" in vars(self)

    @property
    def is_nodal(self) -> bool:
        """Whether the states are unknowns, or sums and differences of two images."""
        return all(block.places is not None for block in self.blocks)

    @functools.cached_property
    def A(self) -> Floats:  # noqa: N802 - as every textbook has it
        """See the class."""
        return block_diagonal([part.A for part in self.blocks])

    @functools.cached_property
    def B(self) -> Floats:  # noqa: N802 - as every textbook has it
        """See the class."""
        return np.concatenate([part.B for part in self.blocks])

    @functools.cached_property
    def C(self) -> Floats:  # noqa: N802 - as every textbook has it
        """See the class."""
        return np.hstack([part.C for part in self.blocks])

    @functools.cached_property
    def D(self) -> Floats:  # noqa: N802 - as every textbook has it
        """See the class."""
        return np.asarray(sum(part.D for part in self.blocks))

    def state_of(self, z: Floats) -> Floats:
        """Return the states, (n,), from the charges of the capacitors at voltages z, (size,).

        z need not be consistent: at z = 0 everything is discharged.
        """
        return np.concatenate([part.charge @ z for part in self.blocks])

    def rows(self, names: Sequence[str]) -> tuple[Floats, Floats]:
        """Return the rows of C and D of nodes, zeros for ground; EngineError for unknown nodes."""
        live = [k for k, name in enumerate(names) if name != "0"]
        places = [self.descriptor.place(names[k]) for k in live]
        rows = self.C[places], self.D[places]
        if len(live) == len(names):
            return rows
        C, D = (np.zeros((len(names), part.shape[1])) for part in rows)
        C[live], D[live] = rows
        return C, D


def linearise(
    descriptor: Descriptor, point: Equilibrium | None, inputs: Floats | None = None
) -> StateSpace:
    """Linearise a board at a point, which only boards with behavioural amplifiers need.

    For other boards the result is exact. The matrices are dense, and x is a vector of voltages, not
    of deviations. With `inputs`, currents (or voltages) into rows, (size, k), these take the place
    of the two inputs. Costs a few dense factorisations of all unknowns.

    EngineError: the equations have no state-space form (a node without any path, or charges that
      are not free, such as a loop of capacitors and voltage sources).
    """
    b, devices = np.stack([descriptor.switched, descriptor.constant], axis=1), descriptor.devices
    board = linear_matrices(descriptor, point)
    if point is not None:
        v = point.values[devices.input]
        value = gain_of(devices.kinds).value(v / devices.v_scale)
        slopes = board.stiffness[devices.output, devices.input]
        b[devices.output, 1] += -devices.u_scale * value - slopes * v
    return _state_space(descriptor, board, b if inputs is None else inputs)


def linear_matrices(descriptor: Descriptor, point: Equilibrium | None) -> DenseMatrix:
    """Return M and K, with the slopes of the amplifiers at a point if there is one."""
    if point is None:
        return descriptor.dense
    devices, K = descriptor.devices, descriptor.dense.stiffness.copy()
    K[devices.output, devices.input] += evened(point.slopes, devices.output, descriptor.mirror)
    return descriptor.dense.with_stiffness(K)


def open_loop(descriptor: Descriptor, point: Equilibrium | None) -> StateSpace:
    """Return the state space with the outputs of the m behavioural amplifiers as further inputs.

    B and D then have ``2 + m`` columns: ``z = C x + D [on, 1, v_out]``. The states are those of the
    state space at `point`.

    EngineError: as `linearise`; also for a capacitor at such an output, whose current would need
      the output's time derivative.
    """
    devices = descriptor.devices
    b = np.zeros((descriptor.size, 2 + devices.count))
    b[:, 0], b[:, 1] = descriptor.switched, descriptor.constant
    b[devices.output, 2 + np.arange(devices.count)] = 1.0
    image = linear_matrices(descriptor, point).image
    return _state_space(descriptor, replace(descriptor.dense, image=image), b)


def _state_space(descriptor: Descriptor, board: DenseMatrix, b: Floats) -> StateSpace:
    """Eliminate unknowns without charge, and count the states again where rounding has a say.

    A topology's board is known to have the states that its design gives it.
    """
    found = None
    if board.image is not None:
        with contextlib.suppress(EngineError):  # the message must name unknowns of the whole board
            found = _of_halves(descriptor, board, b)
    found = found or _of_whole(descriptor, board, b)
    if not descriptor.has_branches or all(block.decided for block in found.blocks):
        return found
    if len(found.blocks) > 1:
        found = _of_whole(descriptor, board, b)
    count = finite_poles(descriptor, _slopes(descriptor, board))
    if count > found.n:
        found = replace(found, lost=count - found.n)
    elif count < found.n:
        raise EngineError(
            f"the circuit has {count} poles, but {found.n} within rounding: parts cancel to the"
            " last digit"
        )
    modes = found.modes
    if np.any(modes.pole_errors > np.abs(modes.poles).max(initial=0.0)):
        raise EngineError(LOST)
    return found


def _slopes(descriptor: Descriptor, board: DenseMatrix) -> Floats:
    """Return the slopes of the amplifiers that its matrices have, (m,)."""
    devices = descriptor.devices
    change = board.stiffness - descriptor.dense.stiffness
    return np.asarray(change[devices.output, devices.input])


def _of_halves(descriptor: Descriptor, board: DenseMatrix, b: Floats) -> StateSpace | None:
    """Return the state space by the even and the odd part; None if they are not those of pairs."""
    even, odd = _reduced(descriptor, board, b)
    if even.places is None or odd.places is None or board.image is None:
        return None
    pairs, names = len(odd.A), descriptor.names
    if not (pairs and np.array_equal(even.places[:pairs], odd.places)):
        return None
    first = [names[place] for place in even.places.tolist()]
    second = [names[place] for place in board.image[even.places].tolist()]
    states = [a if a == b else f"{a}+{b}" for a, b in zip(first, second, strict=True)]
    states += [f"{a}-{b}" for a, b in zip(first[:pairs], second, strict=False)]
    return StateSpace(descriptor, tuple(states), (even, odd))


def _of_whole(descriptor: Descriptor, board: DenseMatrix, b: Floats) -> StateSpace:
    """Return the state space by all equations at once."""
    (found,) = _reduced(descriptor, replace(board, image=None), b)
    if found.places is None:
        states = tuple(f"charge{k + 1}" for k in range(len(found.A)))
    else:
        states = tuple(descriptor.names[place] for place in found.places.tolist())
    return StateSpace(descriptor, states, (found,))


def _reduced(descriptor: Descriptor, board: DenseMatrix, b: Floats) -> list[Reduced]:
    """Eliminate in each block of the equations; rounding is relative to the terms of M and K.

    In a circuit of any parts they may cancel.
    """
    found, slopes = list[Reduced](), _slopes(descriptor, board)
    masses, pulls = np.abs(board.mass), np.abs(board.stiffness)
    if descriptor.has_branches:
        masses, pulls = descriptor.summed(np.abs, slopes)
    for part in board.blocks:
        places, basis = part.places, part.basis
        pencil = Pencil(
            M=part.mass,
            K=part.stiffness,
            b=part.left @ b,
            mass=masses[places] @ np.abs(basis),
            pull=pulls[places] @ np.abs(basis),
            basis=basis,
            left=part.left,
        )

        def exact(places: Ints = places, basis: Floats = basis) -> NDArray[np.longdouble]:
            M, _ = descriptor.summed(lambda x: x.astype(np.longdouble), slopes)
            return np.asarray(M[places] @ basis)

        names = [descriptor.names[place] for place in places.tolist()]
        reduced = reduce_pencil(pencil, names, exact)
        states = None if reduced.places is None else places[reduced.places]
        found.append(replace(reduced, places=states))
    return found
