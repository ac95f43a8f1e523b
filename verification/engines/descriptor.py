"""From descriptor equations to the state space of a board: nodes without capacitance eliminated.

``x' = A x + B [on, 1]`` with every unknown of the board recovered by ``z = C x + D [on, 1]``; the
first input is the strain currents (0 or 1), the second what is on for all time. The states are
the voltages of nodes that carry charge and the poles of the op-amps.
"""

from __future__ import annotations

import functools
from dataclasses import dataclass

import numpy as np

from netlist_gen.circuit import Circuit
from spice_models.errors import EngineError
from verification.engines.equations import Bools, Descriptor, Floats, Ints
from verification.engines.equilibrium import Equilibrium, equilibrium
from verification.engines.gains import gain_of
from verification.engines.mirror import Halves, evened, image_within, is_mirrored, proposed_image
from verification.engines.modes import Modes, decompose
from verification.engines.stamps import stamp

SINGULAR = 1e13  # condition number of an equilibrated matrix above which it counts as singular


@dataclass(frozen=True, slots=True, eq=False)
class StateSpace:
    """A board as ``x' = A x + B [on, 1]``, ``z = C x + D [on, 1]``.

    Attributes
    ----------
    descriptor : Descriptor
        Where it came from.
    A : ndarray (n, n)
        1/s.
    B : ndarray (n, 2)
        V/s: for the switched currents, and for what is constant.
    C, D : ndarray (size, n) and (size, 2)
        Every node voltage and op-amp state, V.
    states : tuple of str
        Names of x.
    mirror : ndarray of int (n,), or None
        Place of each state's mirror image, where the board is its own (`mirror`).
    charge, charge_offset : ndarray (n, size) and (n,)
        ``x = charge z + charge_offset`` from the charges that voltages z put on the capacitors;
        z need not be consistent (all zero: everything discharged).
    """

    descriptor: Descriptor
    A: Floats
    B: Floats
    C: Floats
    D: Floats
    states: tuple[str, ...]
    mirror: Ints | None
    charge: Floats
    charge_offset: Floats

    @property
    def n(self) -> int:
        """Number of states."""
        return len(self.states)

    @property
    def nodes(self) -> tuple[str, ...]:
        """Names of the rows of C."""
        return self.descriptor.names

    def rows(self, names: tuple[str, ...]) -> tuple[Floats, Floats]:
        """Rows of C and D of the named nodes; zeros for ground.

        Raises
        ------
        EngineError
            A node that the circuit does not have.
        """
        C, D = np.zeros((len(names), self.n)), np.zeros((len(names), self.D.shape[1]))
        for k, name in enumerate(names):
            if name != "0":
                place = self.descriptor.place(name)
                C[k], D[k] = self.C[place], self.D[place]
        return C, D


def linearise(circuit: Circuit | Descriptor, at: Equilibrium | None = None) -> StateSpace:
    """Linearise a board, for a board without behavioural amplifiers an exact statement.

    Parameters
    ----------
    circuit : Circuit or Descriptor
        The board.
    at : Equilibrium, optional
        Where; by default its equilibrium with the strain applied (not needed if linear).

    Returns
    -------
    StateSpace
        Dense; x is a vector of voltages, not of deviations.

    Raises
    ------
    EngineError
        The equations have no state-space form (a node without any path, or charges that are not
        free, such as a loop of capacitors and voltage sources), or no equilibrium was found.

    Notes
    -----
    Costs a few dense factorisations of all unknowns.
    """
    descriptor = stamp(circuit) if isinstance(circuit, Circuit) else circuit
    if not descriptor.devices.count:
        return _linear(descriptor)
    M, K = descriptor.dense_mass(), descriptor.dense_stiffness()
    b = np.stack([descriptor.switched, descriptor.constant], axis=1)
    devices = descriptor.devices
    point = at or equilibrium(descriptor)
    v = point.values[devices.input]
    slopes = evened(point.slopes, devices.output, proposed_image(descriptor.names))
    K[devices.output, devices.input] += slopes
    value = gain_of(devices.kind).value(v / devices.v_scale)
    b[devices.output, 1] += -devices.u_scale * value - slopes * v
    return _reduce(descriptor, M, K, b)


@functools.lru_cache(maxsize=1)
def _linear(descriptor: Descriptor) -> StateSpace:
    """Return the state space of a linear board; its time scales and its transient both need it."""
    b = np.stack([descriptor.switched, descriptor.constant], axis=1)
    return _reduce(descriptor, descriptor.dense_mass(), descriptor.dense_stiffness(), b)


@functools.lru_cache(maxsize=1)
def modes_of(space: StateSpace) -> Modes:
    """Decompose A of a state space, once for those who ask one after the other."""
    if space.mirror is None:
        return decompose([space.A])
    halves = Halves.of(space.mirror)
    return decompose(halves.split(space.A), halves)


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
    return _reduce(descriptor, descriptor.dense_mass(), descriptor.dense_stiffness(), b)


def _reduce(descriptor: Descriptor, M: Floats, K: Floats, b: Floats) -> StateSpace:
    """Eliminate voltages that ideal sources determine, then whatever carries no charge."""
    image = proposed_image(descriptor.names)
    mirrored = is_mirrored(M, image) and is_mirrored(K, image)
    f, sources, M, K, b, whole = _without_sources(descriptor, M, K, b)
    names = [descriptor.names[place] for place in f.tolist()]
    d, a, basis, M, K, b, whole = _separate(M, K, b, whole)
    n = len(d)
    # 0 = K_ad x + K_aa y + b_a
    right = np.hstack([K[np.ix_(a, d)], b[a]])
    loose = [names[k] for k in a] if basis is None else names
    passive = _solve(K[np.ix_(a, a)], right, loose, "nodes without capacitance stay undetermined")
    rates = np.hstack([K[np.ix_(d, d)], b[d]]) - K[np.ix_(d, a)] @ passive
    charged = [names[k] for k in d] if basis is None else [f"charge{k + 1}" for k in range(n)]
    inputs, right = rates.shape[1], np.hstack([rates, whole[d]])
    rates = _solve(M[np.ix_(d, d)], right, charged, "the capacitances do not determine the states")
    inner = np.zeros((len(f), inputs))
    inner[d, np.arange(n)] = 1.0
    inner[a] = -passive
    inner = inner if basis is None else basis @ inner
    outer = np.zeros((descriptor.size, inputs))
    outer[f] = inner
    outer[descriptor.determined] = sources[:, : len(f)] @ inner
    outer[descriptor.determined, n:] += sources[:, len(f) :]
    return StateSpace(
        descriptor=descriptor,
        A=np.ascontiguousarray(rates[:, :n]),
        B=rates[:, n:inputs],
        C=outer[:, :n],
        D=outer[:, n:],
        states=tuple(charged),
        mirror=image_within(f[d], image) if mirrored and basis is None else None,
        charge=rates[:, inputs:-1],
        charge_offset=rates[:, -1],
    )


def _without_sources(
    descriptor: Descriptor, M: Floats, K: Floats, b: Floats
) -> tuple[Ints, Floats, Floats, Floats, Floats, Floats]:
    """Eliminate the voltages z_o that ideal sources determine.

    Returns
    -------
    tuple
        Places f of the others; ``[P, p]`` of ``z_o = P z_f + p [on, 1, ...]``; M, K and b of the
        others; and the charges of the others by all of z, and by 1.
    """
    o, f = np.flatnonzero(descriptor.determined), np.flatnonzero(~descriptor.determined)
    if not o.size:
        none = np.zeros((0, len(f) + b.shape[1]))
        return f, none, M, K, b, np.hstack([M, np.zeros((len(f), 1))])
    names = [descriptor.names[place] for place in (*o, *f)]
    # 0 = K_oo z_o + K_of z_f + b_o
    right = np.hstack([K[np.ix_(o, f)], b[o]])
    known = _solve(-K[np.ix_(o, o)], right, names, "ideal sources form a loop without an answer")
    P, p = known[:, : len(f)], known[:, len(f) :]
    held = M[np.ix_(f, o)] @ p
    if np.any(held[:, 2:]):
        raise EngineError("a capacitor at the output of a behavioural amplifier: not supported")
    whole = np.hstack([M[f], -held[:, :2].sum(axis=1)[:, None]])
    b = b[f] + K[np.ix_(f, o)] @ p
    K = K[np.ix_(f, f)] + K[np.ix_(f, o)] @ P
    M = M[np.ix_(f, f)] + M[np.ix_(f, o)] @ P
    return f, known, M, K, b, whole


Split = tuple[Ints, Ints, Floats | None, Floats, Floats, Floats, Floats]


def _separate(M: Floats, K: Floats, b: Floats, whole: Floats) -> Split:
    """Find which unknowns carry charge: places d, places a, and the basis if it had to turn.

    As a rule they are the nodes with a capacitor. Where capacitors float, or an ideal amplifier
    ties both ends of one together, they are combinations of nodes, found by a singular value
    decomposition of the equilibrated M.
    """
    rows, columns = M.any(axis=1), M.any(axis=0)
    d, a = np.flatnonzero(rows), np.flatnonzero(~rows)
    if np.array_equal(rows, columns) and _condition(M[np.ix_(d, d)]) < SINGULAR:
        return d, a, None, M, K, b, whole
    weight, pull = np.abs(M).max(axis=1), np.abs(K).max(axis=1)
    rate = np.median(pull[rows] / weight[rows])
    scale = np.where(rows, weight, np.maximum(pull, 1e-300) / rate)[:, None]
    U, S, Vt = np.linalg.svd(M / scale)
    rank = int(np.sum(S[0] / SINGULAR < S))
    places = np.arange(len(S))
    turned = U.T @ (K / scale) @ Vt.T
    d, a = places[:rank], places[rank:]
    return d, a, Vt.T, np.diag(S), turned, U.T @ (b / scale), U.T @ (whole / scale)


def _equilibrated(A: Floats) -> tuple[Floats, Floats]:
    scale = np.abs(A).max(axis=1, initial=0.0)
    scale = np.where(scale > 0.0, scale, 1.0)[:, None]
    return A / scale, scale


def _alone(A: Floats) -> Bools:
    """Which unknowns stand alone, in their row and in their column."""
    filled = A != 0.0
    lonely = (filled.sum(axis=1) == 1) & (filled.sum(axis=0) == 1)
    return np.asarray(lonely & filled.diagonal())


def _condition(A: Floats) -> float:
    """Condition number in the largest-row-sum norm after scaling of the rows; inf if singular."""
    tied = np.flatnonzero(~_alone(A))
    scaled, _ = _equilibrated(A[np.ix_(tied, tied)])
    try:
        inverse = np.linalg.inv(scaled)
    except np.linalg.LinAlgError:
        return np.inf
    norms = [np.abs(X).sum(axis=1).max(initial=1.0) for X in (scaled, inverse)]
    return float(norms[0] * norms[1])


def _solve(A: Floats, B: Floats, names: list[str], what: str) -> Floats:
    """Solve ``A X = B`` with scaled rows and one step of refinement, or name the culprits."""
    alone = _alone(A)
    X = B / np.where(alone, np.diag(A), 1.0)[:, None]
    tied = np.flatnonzero(~alone)
    if not tied.size:
        return X
    scaled, scale = _equilibrated(A[np.ix_(tied, tied)])
    try:
        inverse = np.linalg.inv(scaled)
    except np.linalg.LinAlgError:
        inverse = np.full_like(scaled, np.inf)
    if not np.abs(inverse).max() < SINGULAR:
        listed = ", ".join(names[:5]) + (", ..." if len(names) > 5 else "")
        message = f"{what}: {listed}"
        raise EngineError(message)
    right = B[tied] / scale
    Y = inverse @ right
    X[tied] = Y + inverse @ (right - scaled @ Y)
    return X
