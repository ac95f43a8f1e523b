"""Reduce ``M z' = K z + b u`` to ``x' = A x + B u``: eliminate unknowns without charge."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from taction.system.array_types import EPS, Bools, Floats, Ints
from taction.system.errors import EngineError

GRADED = 1e6  # condition number of the capacitances from which states are combinations of voltages
ROUNDING = 64 * EPS
DECIDED = 1e9  # condition number below which rounding cannot make a matrix singular, or regular
SPARE = 4.0  # times the rounding of a solution is within the bound of the terms that it adds to
SINGULAR = 1e13  # condition number of an equilibrated matrix above which it counts as singular


class ScaledInverse:
    """Solver of ``A X = B``: an inverse with scaled rows, and one step of refinement."""

    def __init__(self, A: Floats) -> None:
        filled = A != 0.0
        decoupled = filled.diagonal().copy()
        np.fill_diagonal(filled, False)
        decoupled &= ~(filled.any(axis=0) | filled.any(axis=1))
        self.coupled = np.flatnonzero(~decoupled)
        self.diagonal = np.where(decoupled, A.diagonal(), 1.0)[:, None]
        scaled = A.take(self.coupled, axis=0).take(self.coupled, axis=1)
        scale = np.abs(scaled).max(axis=1, initial=0.0)
        scale[scale == 0.0] = 1.0
        self.scale = scale[:, None]
        self.scaled = scaled / self.scale
        try:
            self.inverse = np.linalg.inv(self.scaled)
        except np.linalg.LinAlgError:
            self.inverse = np.full_like(self.scaled, np.inf)
        self.largest = float(np.abs(self.inverse).max(initial=0.0))

    @property
    def condition(self) -> float:
        """Condition number of the scaled matrix in the row-sum norm; inf if singular."""
        norms = [np.abs(X).sum(axis=1).max(initial=1.0) for X in (self.scaled, self.inverse)]
        return float(norms[0] * norms[1])

    def magnitudes(self) -> Floats:
        """Return the sizes of the elements of the inverse."""
        inverse = np.diag(1.0 / np.abs(self.diagonal[:, 0]))
        inverse[self.coupled[:, None], self.coupled] = np.abs(self.inverse) / self.scale.T
        return inverse

    def spread(self, X: Floats) -> Floats:
        """Return ``|A^-1| |A| |X|``: to what the rounding of a solution X is relative."""
        moved = np.abs(self.diagonal) * np.abs(X)
        moved[self.coupled] = np.abs(self.scaled * self.scale) @ np.abs(X[self.coupled])
        return np.asarray(self.magnitudes() @ moved)

    def solve(self, B: Floats, names: Sequence[str], failure: str) -> Floats:
        """Return X; for a singular A raise EngineError with the names of the unknowns."""
        if not self.largest < SINGULAR:
            listed = ", ".join(names[:5]) + (", ..." if len(names) > 5 else "")
            raise EngineError(f"{failure}: {listed}")
        X = B / self.diagonal
        if self.coupled.size:
            right = B.take(self.coupled, axis=0) / self.scale
            Y = self.inverse @ right
            X[self.coupled] = Y + self.inverse @ (right - self.scaled @ Y)
        return X


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


def eliminate(
    M: Floats,
    K: Floats,
    b: Floats,
    determined: Bools,
    names: Sequence[str],
    *,
    has_branches: bool = False,
) -> ReducedEquations:
    """Eliminate voltages that ideal sources determine, then all other unknowns without charge.

    With `has_branches` the rounding of every step counts in the size of the terms; of a board with
    a design that of the last step bounds it.

    `b` (size, inputs) has columns for the strain currents, for constant sources, and for other
    inputs; `determined` marks rows that state a voltage instead of a current balance; `names` are
    for messages.

    Raises
    ------
    EngineError
        The equations have no such form (see `state_space.linearise`).
    """
    f, o = np.flatnonzero(~determined), np.flatnonzero(determined)
    size, inputs = b.shape
    within, decided, found = Terms(np.abs(M), np.abs(K)), True, None
    if o.size:
        sources, *rest, found, decided = _without_sources(M, K, b, f, o, names)
        M, K, b, charge = rest
        within = found or Terms(np.abs(M), np.abs(K))
        names = [names[place] for place in f.tolist()]
    else:
        charge = np.concatenate([M, np.zeros((size, 1))], axis=1)
    split = _separate(M, K, b, charge)
    d, a, basis, mass, K, b, charge = split.parts
    if split.left is not None and basis is not None:
        within = Terms(
            *(np.abs(split.left) @ each @ np.abs(basis) for each in (within.mass, within.pull))
        )
    n = len(d)
    columns = np.concatenate([d, np.arange(len(f), len(f) + inputs), a])
    rows = np.concatenate([d, a])
    K = np.concatenate([K, b], axis=1).take(rows, axis=0).take(columns, axis=1)
    # 0 = K_ad x + K_aa y + b_a
    chargeless = [names[k] for k in a] if basis is None else names
    inner_factor = ScaledInverse(K[n:, n + inputs :])
    passive = inner_factor.solve(
        K[n:, : n + inputs], chargeless, "nodes without capacitance stay undetermined"
    )
    rates = K[:n, : n + inputs] - K[:n, n + inputs :] @ passive
    charged = [names[k] for k in d] if basis is None else [f"charge{k + 1}" for k in range(n)]
    charge = _with_impulses(charge, K[:n, n + inputs :], inner_factor, chargeless, d, a)
    right = np.concatenate([rates, charge], axis=1)
    terms = np.abs(K[:n, :n]) + np.abs(K[:n, n + inputs :]) @ np.abs(passive[:, :n])
    sizes = np.abs(mass.solve(terms, charged, "the capacitances do not determine the states"))
    rates = mass.solve(right, charged, "the capacitances do not determine the states")
    sizes = np.stack([sizes, np.zeros_like(sizes)])
    exact = found is not None or split.left is not None
    if exact or has_branches:
        cancelling = within.sizes(d, a, mass, inner_factor, passive)
        cancelling[0] += mass.spread(rates[:, :n])
        sizes = np.maximum(sizes, cancelling if exact else cancelling / SPARE)
    if has_branches:
        decided = decided and not split.singular and within.decide(d, a, mass, inner_factor)
    inner = np.zeros((len(f), n + inputs))
    inner[d, np.arange(n)] = 1.0
    inner[a] = -passive
    outer = inner if basis is None else basis @ inner
    if o.size:
        inner, outer = outer, np.zeros((size, n + inputs))
        outer[f], outer[o] = inner, sources[:, : len(f)] @ inner
        outer[o, n:] += sources[:, len(f) :]
    return ReducedEquations(
        A=np.ascontiguousarray(rates[:, :n]),
        B=rates[:, n : n + inputs],
        C=outer[:, :n],
        D=outer[:, n:],
        charge=rates[:, n + inputs : -1],
        offset=rates[:, -1],
        places=f[d] if basis is None else None,
        size=sizes,
        decided=decided,
    )


def _with_impulses(
    charge: Floats,
    pull: Floats,
    inner_factor: ScaledInverse,
    names: Sequence[str],
    d: Ints,
    a: Ints,
) -> Floats:
    """Return the charges of the unknowns d, (n, ...), after the impulses of the others.

    Where a step reaches a capacitor whose current is an unknown, this current has an impulse at the
    step, which charges what it flows into.
    """
    own, jumps = charge.take(d, axis=0), charge.take(a, axis=0)
    if not np.abs(jumps).max(initial=0.0) > np.abs(charge).max(initial=0.0) / SINGULAR:
        return own
    return own - pull @ inner_factor.solve(jumps, names, "a step has no bounded current through")


@dataclass(frozen=True, slots=True, eq=False)
class Terms:
    """Sizes of the terms that add up to M and K, (size, size) each."""

    mass: Floats
    pull: Floats

    def sizes(
        self, d: Ints, a: Ints, mass: ScaledInverse, inner: ScaledInverse, passive: Floats
    ) -> Floats:
        """Return the sizes of `Block`, (2, n, n), with all that cancels on the way to A."""
        passive, pull = np.abs(passive[:, : len(d)]), self.pull[d[:, None], a]
        parts = []
        for part, through in ((self.pull, passive), (self.mass, 0.0)):
            own, aside = (
                part[rows[:, None], d] + part[rows[:, None], a] @ passive for rows in (d, a)
            )
            parts.append(own + pull @ (through + inner.magnitudes() @ aside))
        return np.asarray(mass.magnitudes() @ np.stack(parts))

    def decide(self, d: Ints, a: Ints, mass: ScaledInverse, inner: ScaledInverse) -> bool:
        """Whether rounding can make neither M on d nor K on a singular."""
        found = mass.magnitudes() @ self.mass[d[:, None], d]
        passive = inner.magnitudes() @ self.pull[a[:, None], a]
        return all(X.sum(axis=1).max(initial=0.0) < DECIDED for X in (found, passive))


def _without_sources(
    M: Floats, K: Floats, b: Floats, f: Ints, o: Ints, names: Sequence[str]
) -> tuple[Floats, Floats, Floats, Floats, Floats, Terms | None, bool]:
    """Eliminate the voltages z_o that ideal sources determine.

    Returns ``[P, p]`` of ``z_o = P z_f + p u``; M, K and b of the other unknowns z_f; and the
    charges of z_f as a function of all of z, and of 1; the sizes of the terms of M and K; and
    whether every element of M is well above their rounding.
    """
    listed = [names[place] for place in (*o, *f)]
    # 0 = K_oo z_o + K_of z_f + b_o
    right = np.hstack([K[o[:, None], f], b[o]])
    failure = "ideal sources form a loop without a solution"
    inverse = ScaledInverse(-K[o[:, None], o])
    sources = inverse.solve(right, listed, failure)
    P, p = sources[:, : len(f)], sources[:, len(f) :]
    source_charge = M[f[:, None], o] @ p
    if np.any(source_charge[:, 2:]):
        raise EngineError("a capacitor at the output of a behavioural amplifier: not supported")
    charge = np.hstack([M[f], -source_charge[:, :2].sum(axis=1)[:, None]])
    within = _terms(M, K, f, o, inverse, P) if P.any() else None
    b = b[f] + K[f[:, None], o] @ p
    K = K[f[:, None], f] + K[f[:, None], o] @ P
    M = M[f[:, None], f] + M[f[:, None], o] @ P
    decided = inverse.condition < DECIDED
    if within is not None:  # what cancels leaves no capacitance
        decided &= not np.any((np.abs(M) < within.mass / DECIDED) & (within.mass > 0.0))
        M[np.abs(M) < ROUNDING * within.mass] = 0.0
    return sources, M, K, b, charge, within, decided


def _terms(M: Floats, K: Floats, f: Ints, o: Ints, inverse: ScaledInverse, P: Floats) -> Terms:
    """Return the sizes of the terms of M and K without the voltages that sources determine."""
    M, K, size = np.abs(M), np.abs(K), np.abs(P)
    size = np.maximum(size, inverse.magnitudes() @ (K[o[:, None], f] + K[o[:, None], o] @ size))
    return Terms(
        M[f[:, None], f] + M[f[:, None], o] @ size, K[f[:, None], f] + K[f[:, None], o] @ size
    )


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
    sizes. Where capacitors float, or an ideal amplifier joins both ends of a capacitor, they are
    combinations of nodes, found by a singular value decomposition of the equilibrated M.
    """
    filled = M != 0.0
    rows, columns = filled.any(axis=1), filled.any(axis=0)
    d, a = np.flatnonzero(rows), np.flatnonzero(~rows)
    if np.array_equal(rows, columns):
        mass = ScaledInverse(M.take(d, axis=0).take(d, axis=1))
        if mass.condition < GRADED:
            return Split((d, a, None, mass, K, b, charge))
        if mass.condition < SINGULAR:
            return _graded(M, K, b, charge, d, a)
    weight, pull = np.abs(M).max(axis=1), np.abs(K).max(axis=1)
    rate = np.median(pull[rows] / weight[rows]) or 1.0
    scale = np.where(rows, weight, np.where(pull > 0.0, pull, rate) / rate)[:, None]
    U, S, Vt = np.linalg.svd(M / scale)
    rank = int(np.sum(S[0] / SINGULAR < S))
    places = np.arange(len(S))
    turned = U.T @ (K / scale) @ Vt.T
    d, a = places[:rank], places[rank:]
    mass = ScaledInverse(np.diag(S[:rank]))
    parts = (d, a, Vt.T, mass, turned, U.T @ (b / scale), U.T @ (charge / scale))
    return Split(parts, U.T / scale.T, True)


def _graded(M: Floats, K: Floats, b: Floats, charge: Floats, d: Ints, a: Ints) -> Split:
    """Change to unknowns in which M is diagonal, by elimination with complete pivoting.

    A large capacitor between two nodes with small ones moves both nodes at nearly the same rate.
    In node voltages its own slow rate is the difference of two fast rates, and lost in their
    rounding. In the new unknowns every capacitance has its own equation, the fastest first.
    """
    n, size = len(d), len(M)
    left, D, basis = np.eye(n), M[d[:, None], d], np.eye(n)
    for k in range(n):
        i, j = (place + k for place in divmod(int(np.abs(D[k:, k:]).argmax()), n - k))
        for matrix in (D, left):
            matrix[[k, i]] = matrix[[i, k]]
        for matrix in (D, basis):
            matrix[:, [k, j]] = matrix[:, [j, k]]
        down, right = D[k + 1 :, k] / D[k, k], D[k, k + 1 :] / D[k, k]
        D[k + 1 :] -= np.outer(down, D[k])
        left[k + 1 :] -= np.outer(down, left[k])
        basis[:, k + 1 :] -= np.outer(basis[:, k], right)
        D[k, k + 1 :] = 0.0
    order = np.arange(n)[::-1]
    outer, inner = np.eye(size), np.eye(size)
    outer[d[:, None], d], inner[d[:, None], d] = left[order], basis[:, order]
    mass = ScaledInverse(np.diag(D.diagonal()[order]))
    return Split((d, a, inner, mass, outer @ K @ inner, outer @ b, outer @ charge), outer)
