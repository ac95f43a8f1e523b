"""The state space of a board: ``x' = A x + B [on, 1]`` and ``z = C x + D [on, 1]``.

The first input is the strain currents (0 or 1), the second the constant sources. The states x are
the voltages of nodes that carry charge and the poles of the op-amps; the other unknowns of the
descriptor equations are eliminated, and recovered with all others in z.
"""

from __future__ import annotations

import functools
from collections.abc import Sequence
from contextlib import suppress
from dataclasses import dataclass, fields, replace

import numpy as np
from numpy.typing import NDArray

from taction.system.array_types import Floats, Ints
from taction.system.errors import EngineError
from taction.verification.engines.statespace.equations.descriptor import Descriptor
from taction.verification.engines.statespace.linearised.equilibrium import Equilibrium
from taction.verification.engines.statespace.linearised.find_modes import find_modes
from taction.verification.engines.statespace.linearised.modes import Modes
from taction.verification.engines.statespace.linearised.reduction import (
    Pencil,
    Reduced,
    reduce_pencil,
)

LOST = "rounding leaves nothing of the circuit's poles: parts cancel to the last digit"


@dataclass(frozen=True, eq=False)
class StateSpace(Reduced):
    """A board as ``x' = A x + B [on, 1]``, ``z = C x + D [on, 1]``: A in 1/s, B in V/s."""

    descriptor: Descriptor
    lost: int = 0  # poles of the board that are so far away that rounding hides them

    @property
    def n(self) -> int:
        """Number of states."""
        return len(self.A)

    @property
    def states(self) -> tuple[str, ...]:
        """Names of the unknowns that x are; none of combinations."""
        return () if self.places is None else tuple(self.nodes[k] for k in self.places.tolist())

    @property
    def nodes(self) -> tuple[str, ...]:
        """Names of the rows of C."""
        return self.descriptor.names

    @functools.cached_property
    def modes(self) -> Modes:
        """Eigenvalues of A with their vectors."""
        return find_modes(self)

    def state_of(self, z: Floats) -> Floats:
        """Return the states, (n,), from the charges of the capacitors at voltages z, (size,).

        z need not be consistent: at z = 0 everything is discharged.
        """
        return np.asarray(self.charge @ z)

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

    x is a vector of voltages, not of deviations. With `inputs`, currents (or voltages) into rows,
    (size, k), these take the place of the two inputs. The states are counted again where rounding
    has a say: a topology's board is known to have the states that its design gives it.

    EngineError: the equations have no state-space form (a node without any path, or charges that
      are not free, such as a loop of capacitors and voltage sources, or a capacitor at an input).
    """
    b, devices = np.stack([descriptor.switched, descriptor.constant], axis=1), descriptor.devices
    slopes = np.zeros(devices.count)
    if point is not None:
        v, slopes = point.values[devices.input], point.slopes
        value = devices.gain.value(v / devices.v_scale)
        b[devices.output, 1] += -devices.u_scale * value - slopes * v
    b = b if inputs is None else inputs
    found = _reduced(descriptor, slopes, b)
    if not descriptor.has_branches or found.decided:
        return found
    count = finite_poles(descriptor, slopes)
    if found.n != count or _doubt(found) >= 1.0:
        with suppress(EngineError, np.linalg.LinAlgError):
            found = min(
                (found, _reduced(descriptor, slopes, b, by_charge=True)),
                key=lambda each: (abs(each.n - count), _doubt(each)),
            )
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


def _doubt(space: StateSpace) -> float:
    """Return the largest rounding error of a pole, relative to the pole."""
    errors, sizes = space.modes.pole_errors, np.abs(space.modes.poles)
    with np.errstate(over="ignore"):
        return float(np.max(errors / np.maximum(sizes, np.finfo(float).tiny), initial=0.0))


def _reduced(
    descriptor: Descriptor, slopes: Floats, b: Floats, *, by_charge: bool = False
) -> StateSpace:
    """Eliminate; rounding is relative to the terms of M and K, which may cancel in any circuit."""
    M, K = descriptor.summed(np.asarray, slopes)
    masses, pulls = np.abs(M), np.abs(K)
    if descriptor.has_branches:
        masses, pulls = descriptor.summed(np.abs, slopes)

    def exact() -> NDArray[np.longdouble]:
        return descriptor.summed(lambda x: x.astype(np.longdouble), slopes)[0]

    pencil = Pencil(M, K, b, masses, pulls)
    reduced = reduce_pencil(pencil, descriptor.names, exact, by_charge=by_charge)
    parts = {each.name: getattr(reduced, each.name) for each in fields(reduced)}
    return StateSpace(**parts, descriptor=descriptor)


# Poles are counted in integers: no rounding decides. Every stamped value is a double, so M and K
# are rational numbers, and so are the coefficients of ``det(s M - K)``. The number of finite poles
# is the degree of this determinant. Reduced modulo a prime of 26 bits, its degree is the true one
# unless the leading coefficient, not zero, is a multiple of the prime: by chance one in 7e7.
PRIME = 2**26 - 5  # sums of 2000 products are below 2**63
SHIFT = 34_567_891  # any value of s that is no pole modulo the prime
DIGITS = 53  # of a double


def finite_poles(descriptor: Descriptor, slopes: Floats) -> int:
    """Return the number of finite poles, with multiplicity; `slopes` (m,) are the amplifiers'.

    EngineError: ``det(s M - K)`` is zero for every s: voltages or currents that nothing determines.

    ``N = (s0 M - K)^-1 M`` has the eigenvalue ``1 / (s0 - s)`` for every pole s, and zero for the
    others: the poles are as many as the rank of a high power of N.
    """
    size = descriptor.size
    M, K = descriptor.summed(residues, slopes)
    whole = np.concatenate([(SHIFT * (M % PRIME) - K) % PRIME, M % PRIME], axis=1)
    if _eliminate(whole, size) < size:
        raise EngineError("voltages or currents that no part determines: det(s M - K) = 0")
    N = image = whole[:, size:]
    rank = size
    while True:
        basis = image.T.copy()  # its rows span the columns
        found = _eliminate(basis, size)
        if found == rank:
            return found
        rank, image = found, N @ basis[:found].T % PRIME


def residues(values: Floats) -> Ints:
    """Return finite doubles modulo the prime: of 0.5 what gives 1 times 2."""
    mantissa, exponent = np.frexp(values)
    whole = np.ldexp(mantissa, DIGITS).astype(np.int64) % PRIME
    kinds, place = np.unique(exponent, return_inverse=True)
    powers = np.array([pow(2, int(e) - DIGITS, PRIME) for e in kinds], dtype=np.int64)
    return np.asarray(whole * powers[place.reshape(exponent.shape)] % PRIME)


def _eliminate(X: Ints, columns: int) -> int:
    """Bring the first columns of X to reduced echelon form, in place; return their rank."""
    rank = 0
    for column in range(columns):
        below = np.flatnonzero(X[rank:, column])
        if not below.size:
            continue
        first = rank + int(below[0])
        if first != rank:
            X[[rank, first]] = X[[first, rank]]
        X[rank] = X[rank] * pow(int(X[rank, column]), -1, PRIME) % PRIME
        others = np.flatnonzero(X[:, column])
        others = others[others != rank]
        X[others] = (X[others] - X[others, column, None] * X[rank]) % PRIME
        rank += 1
        if rank == len(X):
            break
    return rank
