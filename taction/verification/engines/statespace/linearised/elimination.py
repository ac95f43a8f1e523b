"""Reduce ``M z' = K z + b u`` to ``x' = A x + B u``: eliminate unknowns without charge."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from taction.system.array_types import EPS, Bools, Floats, Ints
from taction.system.errors import EngineError
from taction.verification.engines.statespace.equations.alike import agreed, alone
from taction.verification.engines.statespace.equations.mirror_symmetry import DenseBlock
from taction.verification.engines.statespace.linearised.limited_states import limits_of
from taction.verification.engines.statespace.linearised.scaled_inverse import (
    SINGULAR,
    ScaledInverse,
    pivoted,
)

GRADED = 1e6  # condition number of the capacitances from which states are combinations of voltages
ROUNDING = 64 * EPS
DECIDED = 1e9  # condition number below which rounding cannot make a matrix singular, or regular
SPARE = 4.0  # times the rounding of a solution is within the bound of the terms that it adds to


def taken(A: Floats, rows: Ints, columns: Ints) -> Floats:
    """Return rows and columns of each matrix of a stack."""
    return A.take(rows, axis=1).take(columns, axis=2)


@dataclass(frozen=True, slots=True, eq=False)
class ReducedEquations:
    """``x' = A x + B u``, ``z = C x + D u`` and ``x = charge z + offset``.

    The shapes of A, B, C and D are (n, n), (n, inputs), (size, n) and (size, inputs), those of
    `charge` and `offset` (n, size) and (n,). `places` are the states' places among the unknowns;
    None where the states are combinations of unknowns. `size` are the sizes of `Block`, to which
    the rounding of A is relative. `decided` is whether condition numbers leave no doubt about their
    number n; of a board without branches its design leaves none.
    """

    A: Floats
    B: Floats
    C: Floats
    D: Floats
    charge: Floats
    offset: Floats
    places: Ints | None
    size: Floats
    decided: bool

    def of_all(self, block: DenseBlock) -> ReducedEquations:
        """Return the same with the unknowns of all blocks in the place of those of `block`."""
        own = None if self.places is None else block.places[self.places]
        C, D, charge = block.basis @ self.C, block.basis @ self.D, self.charge @ block.left
        return replace(self, C=C, D=D, charge=charge, places=own)


def eliminate(
    M: Floats,
    K: Floats,
    b: Floats,
    determined: Bools,
    names: Sequence[str],
    *,
    has_branches: bool = False,
) -> list[ReducedEquations]:
    """Eliminate voltages that ideal sources determine, then all other unknowns without charge.

    With `has_branches` the rounding of every step counts in the size of the terms; of a board with
    a design that of the last step bounds it.

    Parameters
    ----------
    M, K : ndarray (B, size, size)
        Matrices of B boards that have the same unknowns.
    b : ndarray (B, size, inputs)
        Columns for the strain currents, for constant sources, and for other inputs.
    determined : ndarray of bool (size,)
        Rows that state a voltage instead of a current balance.
    names : sequence of str
        Of the unknowns, for messages.

    Raises
    ------
    EngineError
        The equations have no such form (see `state_space.linearise`), those of any board.
    Unlike
        The boards need different steps.
    """
    f, o = np.flatnonzero(~determined), np.flatnonzero(determined)
    count, size, inputs = b.shape
    within, found, decided = Terms(np.abs(M), np.abs(K)), None, np.ones(count, dtype=np.bool_)
    if o.size:
        sources, *rest, found, decided = _without_sources(M, K, b, f, o, names)
        M, K, b, charge = rest
        within = found or Terms(np.abs(M), np.abs(K))
        names = [names[place] for place in f.tolist()]
    else:
        charge = np.concatenate([M, np.zeros((count, size, 1))], axis=2)
    split = _separate(M, K, b, charge)
    d, a, basis, mass, K, b, charge = split.parts
    if split.left is not None and basis is not None:
        within = Terms(
            *(np.abs(split.left) @ each @ np.abs(basis) for each in (within.mass, within.pull))
        )
    n = len(d)
    columns = np.concatenate([d, np.arange(len(f), len(f) + inputs), a])
    K = taken(np.concatenate([K, b], axis=2), np.concatenate([d, a]), columns)
    # 0 = K_ad x + K_aa y + b_a
    chargeless = [names[k] for k in a] if basis is None else names
    inner_factor, limits = ScaledInverse(K[:, n:, n + inputs :]), None
    if has_branches and count == 1 and not inner_factor.largest[0] < SINGULAR:
        limits = limits_of(K, mass, n, inputs)
    if limits is None:
        passive = fixing = inner_factor.solve(
            K[:, n:, : n + inputs], chargeless, "nodes without capacitance stay undetermined"
        )
    else:
        passive, fixing = limits.passive[None], limits.fixing[None]
    rates = K[:, :n, : n + inputs] - K[:, :n, n + inputs :] @ fixing
    charged = [names[k] for k in d] if basis is None else [f"charge{k + 1}" for k in range(n)]
    if limits is None:
        charge = _with_impulses(charge, K[:, :n, n + inputs :], inner_factor, chargeless, d, a)
    else:  # it is limited below; what has no charge has none here
        charge = charge.take(d, axis=1)
    right = np.concatenate([rates, charge], axis=2)
    terms = np.abs(K[:, :n, :n]) + np.abs(K[:, :n, n + inputs :]) @ np.abs(fixing[:, :, :n])
    sizes = np.abs(mass.solve(terms, charged, "the capacitances do not determine the states"))
    rates = mass.solve(right, charged, "the capacitances do not determine the states")
    sizes = np.stack([sizes, np.zeros_like(sizes)], axis=1)
    exact = found is not None or split.left is not None
    if limits is None and (exact or has_branches):
        cancelling = within.sizes(d, a, mass, inner_factor, passive)
        cancelling[:, 0] += mass.spread(rates[:, :, :n])
        sizes = np.maximum(sizes, cancelling if exact else cancelling / SPARE)
    if has_branches and limits is None:
        decided = decided & (not split.singular) & within.decide(d, a, mass, inner_factor)
    outer = _recovery(passive, basis, d, a)
    if o.size:
        inner, outer = outer, np.zeros((count, size, n + inputs))
        outer[:, f], outer[:, o] = inner, sources[:, :, : len(f)] @ inner
        outer[:, o, n:] += sources[:, :, len(f) :]
    places = f[d] if basis is None else None
    if limits is not None:
        rates, outer, sizes = limits.restricted(rates, outer, sizes)
        decided, places = np.zeros_like(decided), None
    return _boards(rates, outer, sizes, decided, places)


def _recovery(passive: Floats, basis: Floats | None, d: Ints, a: Ints) -> Floats:
    """Return what the unknowns are, (B, unknowns, n + inputs), for states, and for inputs."""
    count, n = len(passive), len(d)
    inner = np.zeros((count, n + len(a), passive.shape[2]))
    inner[:, d, np.arange(n)] = 1.0
    inner[:, a] = -passive
    return inner if basis is None else np.asarray(basis @ inner)


def _boards(
    rates: Floats, outer: Floats, sizes: Floats, decided: Bools, places: Ints | None
) -> list[ReducedEquations]:
    """Return the equations of each board: rows of its states' rates, and of its unknowns."""
    n, columns = rates.shape[1], outer.shape[2]
    A = np.ascontiguousarray(rates[:, :, :n])
    return [
        ReducedEquations(
            A=A[k],
            B=rates[k, :, n:columns],
            C=outer[k, :, :n],
            D=outer[k, :, n:],
            charge=rates[k, :, columns:-1],
            offset=rates[k, :, -1],
            places=places,
            size=sizes[k],
            decided=bool(decided[k]),
        )
        for k in range(len(rates))
    ]


def _with_impulses(
    charge: Floats,
    pull: Floats,
    inner_factor: ScaledInverse,
    names: Sequence[str],
    d: Ints,
    a: Ints,
) -> Floats:
    """Return the charges of the unknowns d, (B, n, ...), after the impulses of the others.

    Where a step reaches a capacitor whose current is an unknown, this current has an impulse at the
    step, which charges what it flows into.
    """
    own, jumps = charge.take(d, axis=1), charge.take(a, axis=1)
    jump, largest = (np.abs(x).max(axis=(1, 2), initial=0.0) for x in (jumps, charge))
    if not agreed(jump > largest / SINGULAR):
        return own
    return own - pull @ inner_factor.solve(jumps, names, "a step has no bounded current through")


@dataclass(frozen=True, slots=True, eq=False)
class Terms:
    """Sizes of the terms that add up to M and K, (B, size, size) each."""

    mass: Floats
    pull: Floats

    def sizes(
        self, d: Ints, a: Ints, mass: ScaledInverse, inner: ScaledInverse, passive: Floats
    ) -> Floats:
        """Return the sizes of `Block`, (B, 2, n, n), with all that cancels on the way to A."""
        passive, pull = np.abs(passive[:, :, : len(d)]), taken(self.pull, d, a)
        parts = []
        for part, through in ((self.pull, passive), (self.mass, 0.0)):
            own, aside = (taken(part, rows, d) + taken(part, rows, a) @ passive for rows in (d, a))
            parts.append(own + pull @ (through + inner.magnitudes() @ aside))
        return np.asarray(mass.magnitudes()[:, None] @ np.stack(parts, axis=1))

    def decide(self, d: Ints, a: Ints, mass: ScaledInverse, inner: ScaledInverse) -> Bools:
        """Whether rounding can make neither M on d nor K on a singular, (B,)."""
        found = mass.magnitudes() @ taken(self.mass, d, d)
        passive = inner.magnitudes() @ taken(self.pull, a, a)
        sums = [X.sum(axis=2).max(axis=1, initial=0.0) for X in (found, passive)]
        return np.asarray((sums[0] < DECIDED) & (sums[1] < DECIDED))


def _without_sources(
    M: Floats, K: Floats, b: Floats, f: Ints, o: Ints, names: Sequence[str]
) -> tuple[Floats, Floats, Floats, Floats, Floats, Terms | None, Bools]:
    """Eliminate the voltages z_o that ideal sources determine.

    Returns ``[P, p]`` of ``z_o = P z_f + p u``; M, K and b of the other unknowns z_f; and the
    charges of z_f as a function of all of z, and of 1; the sizes of the terms of M and K; and
    whether every element of M is well above their rounding.
    """
    listed = [names[place] for place in (*o, *f)]
    # 0 = K_oo z_o + K_of z_f + b_o
    K_of = taken(K, o, f)
    failure = "ideal sources form a loop without a solution"
    inverse = ScaledInverse(-taken(K, o, o))
    right = np.concatenate([K_of, b.take(o, axis=1)], axis=2)
    sources = inverse.solve(right, listed, failure)
    P, p = sources[:, :, : len(f)], sources[:, :, len(f) :]
    source_charge = taken(M, f, o) @ p
    if agreed(source_charge[:, :, 2:].any(axis=(1, 2))):
        raise EngineError("a capacitor at the output of a behavioural amplifier: not supported")
    charge = np.concatenate(
        [M.take(f, axis=1), -source_charge[:, :, :2].sum(axis=2)[:, :, None]], axis=2
    )
    within = _terms(M, K, f, o, inverse, P) if agreed(P.any(axis=(1, 2))) else None
    b = b.take(f, axis=1) + taken(K, f, o) @ p
    K = taken(K, f, f) + taken(K, f, o) @ P
    M = taken(M, f, f) + taken(M, f, o) @ P
    decided = inverse.condition < DECIDED
    if within is not None:  # what cancels leaves no capacitance
        lost = (np.abs(M) < within.mass / DECIDED) & (within.mass > 0.0)
        decided &= ~lost.any(axis=(1, 2))
        M[np.abs(M) < ROUNDING * within.mass] = 0.0
    return sources, M, K, b, charge, within, decided


def _terms(M: Floats, K: Floats, f: Ints, o: Ints, inverse: ScaledInverse, P: Floats) -> Terms:
    """Return the sizes of the terms of M and K without the voltages that sources determine."""
    M, K, size = np.abs(M), np.abs(K), np.abs(P)
    size = np.maximum(size, inverse.magnitudes() @ (taken(K, o, f) + taken(K, o, o) @ size))
    return Terms(*(taken(each, f, f) + taken(each, f, o) @ size for each in (M, K)))


@dataclass(frozen=True, slots=True, eq=False)
class Split:
    """The unknowns that carry charge, and the equations in the basis that shows them.

    Attributes
    ----------
    parts : tuple
        The places d of the charged unknowns and a of the others, the basis if it changed, the
        solver of M on d, and K, b and `charge` in that basis.
    left : ndarray or None
        What the rows were multiplied with.
    singular : bool
        Whether M on d is singular in node voltages.
    """

    parts: tuple[Ints, Ints, Floats | None, ScaledInverse, Floats, Floats, Floats]
    left: Floats | None = None
    singular: bool = False


def _separate(M: Floats, K: Floats, b: Floats, charge: Floats) -> Split:
    """Find the unknowns that carry charge.

    Usually they are the nodes with a capacitor. See `_graded` for capacitances of very different
    sizes, and where capacitors float, or an ideal amplifier joins both ends of a capacitor.
    """
    filled, singular = M != 0.0, True
    rows, columns = (agreed(filled.any(axis=axis)) for axis in (2, 1))
    if np.array_equal(rows, columns):
        d, a = np.flatnonzero(rows), np.flatnonzero(~rows)
        mass = ScaledInverse(taken(M, d, d))
        if agreed(mass.condition < GRADED):
            return Split((d, a, None, mass, K, b, charge))
        singular = not bool(mass.condition[0] < SINGULAR)
    alone(len(M))
    return _graded(M, K, b, charge, rows, singular)


def _graded(M: Floats, K: Floats, b: Floats, charge: Floats, rows: Bools, singular: bool) -> Split:
    """Change to unknowns in which M is diagonal, by elimination with complete pivoting.

    Its rows are zero without `rows`. Where M is `singular` on them, small pivots beside the scales
    of their rows are rounding; elsewhere every pivot is a capacitance.

    A large capacitor between two nodes with small ones moves both nodes at nearly the same rate. In
    node voltages its own slow rate is the difference of two fast rates, and lost in their rounding.
    In the new unknowns every capacitance has its own equation, the fastest first. Singular vectors
    would mix unknowns of all sizes within their rounding.
    """
    from scipy.linalg import solve_triangular

    size = M.shape[1]
    scale = np.where(rows, np.abs(M[0]).max(axis=1), 1.0) if singular else np.ones(size)
    L, U, p, q, n = pivoted(M[0] / scale[:, None], 1.0 / SINGULAR if singular else 0.0)
    left, basis, D = np.zeros((size, size)), np.zeros((size, size)), U.diagonal()[:n]
    left[:, p] = solve_triangular(L, np.eye(size), lower=True, unit_diagonal=True)
    left /= scale
    basis[q[:n, None], np.arange(n)] = solve_triangular(U[:n, :n], np.diag(D))
    basis[q[:n, None], np.arange(n, size)] = -solve_triangular(U[:n, :n], U[:n, n:])
    basis[q[n:], np.arange(n, size)] = 1.0
    order = np.r_[np.arange(n)[::-1], n:size]
    left, basis = left[order], basis[:, order]
    mass = ScaledInverse(np.diag(D[::-1])[None])
    parts = (np.arange(n), np.arange(n, size), basis, mass, left @ K @ basis)
    return Split((*parts, left @ b, left @ charge), left, bool(n < np.count_nonzero(rows)))
