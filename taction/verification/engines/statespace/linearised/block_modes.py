"""Modes of reduced equations, found by eigenvectors or Schur vectors, and their residual.

See `modes` for what the residual says. Nothing that is stated depends on how vectors were found.
"""

from __future__ import annotations

import functools
import math
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from taction.system.array_types import EPS, Bools, Complexes, Floats, Ints
from taction.verification.engines.statespace.linearised.reduction import ROUNDED, Reduced

WANTED = 1e-9  # of the largest voltage: error of a response, above which a Newton step is tried
ENOUGH = 1e-7  # ... above which nearly parallel modes are grouped
UNDRIVEN = 1e-6  # of its terms: a smaller response to the sources may be rounding
NEWTON = 6  # largest number of steps
FAR = 0.1  # largest turn of a vector by one step
SEPARABLE = 1e6  # condition number of vectors up to which modes are separated
IMPROVABLE = 4.0  # times what is unknown of it: a coupling that a step reduces
GROUPS = ((1e5, 0.25), (1e2, 0.5), (0.0, 1.0))  # condition of a mode, width of its group in decays
NARROW = 0.4  # of the decay rate: largest distance of a pole from the centre of its group
POWERS = 100  # largest number of powers of the time in a group
SAMPLED = (1e-2, 1e2, 120)  # first and last instant in units of the scale, and number
BALANCING = 20  # steps to units in which couplings are equal in both directions
CERTAIN = 0.2  # row sum of couplings over distances in these units, from which no bound is stated
SPARE = 1.05  # for what lies between the instants


@dataclass(frozen=True, eq=False)
class BlockModes:
    """Vectors and poles, and what their residual says; as they come, not ordered."""

    reduced: Reduced
    T: Complexes  # (n, n): poles, 1/s, and the triangular matrices of groups, along the diagonal
    # `group`, `mates`: (n,): number of the group of each mode, and the place of its conjugate; -1
    # in a group of several.
    group: Ints
    mates: Ints
    # `X`, `V`, `W`: (n, n): vectors of the states; right and left vectors of the pencil.
    X: Complexes
    V: Complexes
    W: Complexes
    # `F`, `E`: (n, n): what corrects T, 1/s, and a bound on the error of that.
    F: Complexes
    E: Floats
    mixed: Floats  # (n, n): bound on ``W M V - 1``
    hidden: Floats  # (k, n): bound on the error of V in unknowns without charge
    other: BlockModes | None = None  # modes found otherwise, whose poles may be better known

    @functools.cached_property
    def poles(self) -> Complexes:
        """The corrected poles, 1/s, (n,)."""
        return np.asarray(np.diag(self.T - self.F))

    @functools.cached_property
    def alone(self) -> Bools:
        """Whether a mode is the only one of its group, (n,)."""
        return np.asarray(np.bincount(self.group, minlength=1)[self.group] == 1)

    @functools.cached_property
    def groups(self) -> list[Group]:
        """The groups of more than one mode."""
        numbers = np.unique(self.group[~self.alone]).tolist()
        return [Group.of(self, np.flatnonzero(self.group == number)) for number in numbers]

    @functools.cached_property
    def coupling(self) -> Floats:
        """Bound on what the board has beside T with the corrected poles, 1/s, (n, n)."""
        return np.abs(self.F - np.diag(np.diag(self.F))) + self.E

    @functools.cached_property
    def left(self) -> Complexes:
        """The dual vectors of the states, (n, n)."""
        return np.asarray(self.W @ (self.reduced.pencil.M @ self.reduced.seen))

    @property
    def is_known(self) -> bool:
        """Whether the vectors are a basis."""
        return bool(np.all(np.isfinite(self.E)))

    @functools.cached_property
    def error(self) -> float:
        """Estimate of the error of the response to the sources, over its largest voltage.

        Without sources it is that of the response to a start with 1 V at every unknown.
        """
        if not self.is_known:
            return math.inf
        s, sizes, pencil = self.poles, np.abs(self.V), self.reduced.pencil
        fastest = float(np.abs(s).max(initial=0.0)) or 1.0
        speed = np.maximum(np.abs(s), 1e-12 * fastest)
        start = (self.W @ pencil.b).sum(axis=1) / speed
        largest = float(np.abs(self.V @ start).max(initial=0.0))
        terms = sizes @ (np.abs(self.W) @ np.abs(pencil.b).sum(axis=1) / speed)
        if not largest > UNDRIVEN * float(terms.max(initial=0.0)):  # 1 V at every unknown
            start, largest = np.abs(self.W @ pencil.M).sum(axis=1), 1.0
        gap = np.maximum(np.abs(s[:, None] - s), np.abs(s.real)[:, None])
        gap = np.maximum(gap, 1e-3 * speed)
        weight = np.abs(start)
        off = sizes @ ((self.coupling / gap) @ weight) + self.hidden @ weight
        return float(off.max(initial=0.0)) / largest


@dataclass(frozen=True, eq=False)
class Group:
    """Nearly parallel modes: ``exp(T t)`` is ``exp(centre t) exp(inner t)`` among them."""

    members: Ints  # (m,): their places
    centre: complex
    inner: Complexes
    growth: Floats  # (m, m): G with ``|exp(inner t)| <= G exp(scale t)`` for t >= 0, by element
    scale: float  # 1/s

    @classmethod
    def of(cls, modes: BlockModes, members: Ints) -> Group:
        """Return the group of some places."""
        acting = modes.T[np.ix_(members, members)] - np.diag(modes.F.diagonal()[members])
        centre = complex(acting.diagonal().mean())
        inner, scale = acting - centre * np.eye(len(members)), 0.5 * abs(centre.real)
        growth = np.full(inner.shape, np.inf)
        if np.abs(inner.diagonal()).max() < NARROW * abs(centre.real):
            growth = _growth(np.asarray(inner / scale, dtype=np.complex128))
        return cls(members, centre, inner, growth, scale)


def _growth(inner: Complexes) -> Floats:
    """Return G with ``|exp(inner x)| <= G exp(x)`` for x >= 0; infinite where powers do not end."""
    powers = [np.eye(len(inner), dtype=np.complex128)]
    for k in range(1, POWERS):
        powers.append(powers[-1] @ inner / k)
        if np.abs(powers[-1]).max() * (k / math.e) ** k < EPS:
            break
    else:
        return np.full(inner.shape, np.inf)
    x = np.append(0.0, np.geomspace(*SAMPLED))
    weight = x[:, None] ** np.arange(len(powers)) * np.exp(-x)[:, None]
    return np.asarray(SPARE * np.abs(np.tensordot(weight, np.array(powers), 1)).max(axis=0))


@np.errstate(over="ignore", invalid="ignore", divide="ignore")
def find_block_modes(reduced: Reduced) -> BlockModes:
    """Return the modes, refined by Newton's steps and then by groups of parallel ones.

    LinAlgError: A is not finite.
    """
    first = _refined(eigenmodes(reduced))
    best = first
    if first.error > ENOUGH:
        ill = conditions(first)
        for limit, width in GROUPS:
            chosen = ~(ill < limit)
            if chosen.any():
                grouped = _refined(group_modes(reduced, np.diag(first.T), chosen, width))
                if grouped.error < best.error and all(
                    np.isfinite(each.growth).all() for each in grouped.groups
                ):
                    best = grouped
            if best.error <= ENOUGH:
                break
    return best if best is first else replace(best, other=first)


def _refined(modes: BlockModes) -> BlockModes:
    """Take Newton's steps while there is something to gain; return the best modes."""
    best = modes
    for _ in range(NEWTON):
        if best.error <= WANTED or not np.all(np.isfinite(modes.F)):
            break
        if not np.any(np.abs(modes.F) > IMPROVABLE * modes.E):
            break
        modes = newton_step(modes)
        if modes.error < best.error:
            best = modes
    return best


def certify(
    reduced: Reduced, T: Complexes, group: Ints, mates: Ints, X: Complexes, W: Complexes
) -> BlockModes:
    """Compare vectors with the pencil; W is scaled to ``W M V`` of unit diagonal."""
    pencil, V = reduced.pencil, _product(reduced.seen, X)
    M, K, n = pencil.M, pencil.K, len(T)
    MV, KV = _product(M, V), _product(K, V)
    norm = np.einsum("ij,ji->i", W, MV)
    W = W / np.where(norm != 0.0, norm, 1.0)[:, None]
    sizes, weights = np.abs(V), np.abs(W)
    charge = pencil.mass @ sizes
    mixed = np.abs(W @ MV - np.eye(n)) + ROUNDED * (weights @ charge)
    nu = mixed.sum(axis=1).max(initial=0.0)
    single = n == len(set(group.tolist()))
    R = MV * np.diag(T) - KV if single else MV @ T - KV
    rounding = charge * np.abs(np.diag(T)) if single else charge @ np.abs(T)
    rounding = ROUNDED * (rounding + pencil.pull @ sizes)
    F, E = W @ R, weights @ rounding
    hidden = np.zeros_like(sizes)
    if reduced.first is not None:
        a, p, inverse = reduced.first
        hidden[p] = np.abs(inverse) @ (np.abs(R[a]) + rounding[a])
        size, charged = np.abs(T), bool(pencil.mass[:, p].any())
        coupled = _product(K[:, p].T, W.T).T
        doubt = weights @ pencil.pull[:, p]
        if charged:
            WM = _product(M[:, p].T, W.T).T
            coupled = (np.diag(T)[:, None] * WM if single else T @ WM) - coupled
            doubt += size @ (weights @ pencil.mass[:, p])
        lost = np.abs(coupled) + ROUNDED * doubt
        E = E + lost @ hidden[p]
        if charged:
            moved = np.abs(WM) @ hidden[p]
            far = np.abs(np.diag(T)[:, None] - np.diag(T))
            E = E + (far + np.where(group[:, None] == group, size, 0.0)) * moved
            mixed = mixed + moved
    if nu < 0.5:
        E = E + mixed @ (np.abs(F) + E) / (1.0 - nu)
    if not (nu < 0.5 and np.all(np.isfinite(E))):
        E = np.full_like(E, np.inf)
    np.fill_diagonal(F, _with_conjugates(np.diag(F), mates))
    return BlockModes(reduced, T, group, mates, X, V, W, F, E, mixed, hidden)


def _product(A: Floats, V: Complexes) -> Complexes:
    """Return the product of a real and a complex matrix, at half the cost of a complex one."""
    n = V.shape[1]
    both = A @ np.concatenate([V.real, V.imag], axis=1)
    return np.asarray(both[:, :n] + 1j * both[:, n:])


def _with_conjugates(values: Complexes, mates: Ints) -> Complexes:
    """Return values of modes, or vectors as rows, that are conjugate where the modes are mates."""
    found, known = values.copy(), mates >= 0
    found[known] = 0.5 * (values[known] + values[mates[known]].conj())
    return found


def eigenmodes(reduced: Reduced) -> BlockModes:
    """Return the modes, each by itself; the vectors of pairs are conjugate to the bit."""
    s, vectors = np.linalg.eig(reduced.A)
    upper, lower = np.flatnonzero(s.imag > 0.0), np.flatnonzero(s.imag < 0.0)
    parts = vectors.real.copy()  # a pair's columns: real and imaginary part
    parts[:, lower] = vectors.imag[:, upper]
    scale = np.abs(parts).max(axis=1, initial=1e-300)
    try:
        rows = np.linalg.inv(parts / scale[:, None]) / scale
    except np.linalg.LinAlgError:
        return group_modes(reduced, s, np.ones(len(s), dtype=np.bool_), GROUPS[0][1])
    Y = rows.astype(np.complex128)
    Y[upper] = (rows[upper] - 1j * rows[lower]) / 2.0
    Y[lower] = Y[upper].conj()
    T = np.diag(s.astype(np.complex128))
    numbers, mates = np.arange(len(s)), _places_of_mates(s)
    return certify(reduced, T, numbers, mates, vectors + 0j, reduced.lefts(T, Y))


def newton_step(modes: BlockModes) -> BlockModes:
    """Return modes whose poles and vectors have taken one Newton step, compared again.

    Modes whose poles are too close for it are separated by an eigenproblem of their own instead.
    """
    T, mates, X, W = _separated(modes)
    if T is modes.T:
        s, same = np.diag(T), modes.group[:, None] == modes.group
        gap = s[:, None] - s
        far = (np.abs(gap) > 0.0) & ~same
        turn = np.where(far, modes.F / np.where(far, gap, 1.0), 0.0)
        turn[np.abs(turn) > FAR] = 0.0
        X, W = X + X @ turn, W - turn @ W
        T = np.asarray(T - np.where(same, np.triu(modes.F), 0.0))
    pencil = modes.reduced.pencil
    charges = _product(pencil.M, _product(modes.reduced.seen, X))
    W = np.asarray(np.linalg.solve(W @ charges, W))
    X, W = _with_conjugates(X.T, mates).T, _with_conjugates(W, mates)
    return certify(modes.reduced, T, modes.group, mates, X, W)


def _separated(modes: BlockModes) -> tuple[Complexes, Ints, Complexes, Complexes]:
    """Return T, mates, X and W with the modes apart that F mixes more than a step can turn."""
    s, mates, alone = np.diag(modes.T), modes.mates, modes.alone
    size = np.abs(modes.F)
    mixed = (size > FAR * np.abs(s[:, None] - s)) & (size > IMPROVABLE * modes.E)
    mixed &= alone & alone[:, None]
    own = np.where(alone, mates, np.arange(len(s)))
    label = components(mixed | mixed[np.ix_(own, own)])
    numbers, counts = np.unique(label, return_counts=True)
    if not np.any(counts > 1):
        return modes.T, mates, modes.X, modes.W
    T, X, W, mates = modes.T.copy(), modes.X.copy(), modes.W.copy(), mates.copy()
    changed = False
    for number in numbers[counts > 1].tolist():
        own = np.flatnonzero(label == number)
        acting, other = (modes.T - modes.F)[np.ix_(own, own)], modes.mates[own]
        closed = np.isin(other, own)
        if closed.all():  # the vectors' real and imaginary parts keep conjugates apart
            real = _real_basis(np.searchsorted(own, other))
            poles, turn = np.linalg.eig(np.linalg.solve(real, acting @ real).real)
            turn, other = real @ turn, own[_places_of_mates(poles)]
        elif own[0] < other[0]:
            poles, turn = np.linalg.eig(acting)
        else:
            continue  # with its conjugates
        if not np.linalg.cond(turn) < SEPARABLE:
            continue
        T[own, own], X[:, own], W[own] = poles, X[:, own] @ turn, np.linalg.solve(turn, W[own])
        mates[own], changed = other, True
        if not closed.any():
            T[other, other], X[:, other], W[other] = poles.conj(), X[:, own].conj(), W[own].conj()
    return (T, mates, X, W) if changed else (modes.T, modes.mates, modes.X, modes.W)


def _places_of_mates(poles: Complexes) -> Ints:
    """Return the places of the conjugates of poles as LAPACK orders them, (n,)."""
    return np.arange(len(poles)) + np.sign(poles.imag).astype(np.int64)


def _real_basis(mates: Ints) -> Complexes:
    """Return the combinations of modes that are real, as columns, (m, m)."""
    one = np.eye(len(mates), dtype=np.complex128)
    places = np.arange(len(mates))
    found = 0.5 * (one + one[:, mates])
    second = mates < places
    found[:, second] = -0.5j * (one - one[:, mates])[:, second]
    return found


def conditions(modes: BlockModes) -> Floats:
    """Return the condition number of each mode, in volts and in unknowns of equal size, (n,)."""
    V, W = np.abs(modes.V), np.abs(modes.W @ modes.reduced.pencil.M)
    scale = V.max(axis=1, initial=0.0)
    inverse = np.divide(1.0, scale, where=scale > 0.0, out=np.zeros_like(scale))
    found = [
        np.linalg.norm(V * a[:, None], axis=0) * np.linalg.norm(W * b, axis=1)
        for a, b in ((np.ones_like(scale), np.ones_like(scale)), (inverse, scale))
    ]
    return np.asarray(np.maximum(*found))


def group_modes(reduced: Reduced, s: Complexes, ill: Bools, width: float) -> BlockModes:
    """Return modes in groups: those of `ill` with all that are nearer than `width` decay rates."""
    import scipy.linalg as sl

    lapack: Any = sl.lapack
    balanced: Any = sl.matrix_balance(reduced.A, permute=False, separate=True)
    A, (scale, _) = balanced
    form: Any = sl.schur(A, output="complex")
    T, Q = form
    t = np.diag(T)
    nearest = np.abs(t[:, None] - s).argmin(axis=1)
    decay = np.abs(t.real)
    near = np.abs(t[:, None] - t) < width * np.minimum(decay[:, None], decay)
    near &= ill[nearest][:, None] | ill[nearest]
    mates = np.abs(t[:, None] - t.conj()).argmin(axis=1)
    label = components(near | near[np.ix_(mates, mates)])
    reals, uppers = _single(label, t, mates)
    singles = [*reals, *(place for upper in uppers for place in (upper, mates[upper]))]
    others = np.setdiff1d(label, label[singles])
    n, X, Y = len(t), np.empty_like(Q), np.empty_like(Q)
    found, group, at = np.zeros_like(T), np.empty(n, dtype=np.int64), 0
    for number in (*label[singles].tolist(), *others.tolist()):
        chosen = label == number
        m = int(chosen.sum())
        U, Z, *_ = lapack.ztrsen(chosen.astype(np.int32), T, Q, wantq=1, job="N")
        coupled = np.zeros((m, 0))
        if m < n:
            coupled, factor, _ = lapack.ztrsyl(U[:m, :m], U[m:, m:], U[:m, m:], isgn=-1)
            coupled = coupled / factor
        own = slice(at, at := at + m)
        X[:, own], found[own, own], group[own] = Z[:, :m], U[:m, :m], number
        Y[own] = Z[:, :m].conj().T + coupled @ Z[:, m:].conj().T
    for k in range(len(reals)):
        phase = X[np.abs(X[:, k]).argmax(), k]
        X[:, k], Y[k] = (X[:, k] / phase).real, (Y[k] * phase).real
        found[k, k] = found[k, k].real
    for k in range(len(reals), len(singles), 2):
        X[:, k + 1], Y[k + 1], found[k + 1, k + 1] = X[:, k].conj(), Y[k].conj(), found[k, k].conj()
    mates, count = np.full(n, -1), len(reals)
    mates[:count] = np.arange(count)
    mates[count : len(singles)] = np.arange(count, len(singles)).reshape(-1, 2)[:, ::-1].ravel()
    X, Y = scale[:, None] * X, Y / scale
    return certify(reduced, found, group, mates, X, reduced.lefts(found, Y))


def _single(label: Ints, t: Complexes, mates: Ints) -> tuple[list[int], list[int]]:
    """Return the places of single real poles, and of the upper ones of single pairs."""
    single = np.flatnonzero(np.bincount(label)[label] == 1).tolist()
    paired = [k for k in single if mates[k] != k and mates[mates[k]] == k]
    return [k for k in single if k not in paired], [k for k in paired if t[k].imag > 0.0]


def balanced_sums(H: Floats, s: Complexes) -> Floats:
    """Return the row sums of H >= 0 for modes s in units in which they are about the column sums.

    The largest bounds the spectral radius in any units. They start from the square roots of the
    poles' inverses (E. E. Osborne, J. ACM 7, 1960, all rows at once).
    """
    unit = 1.0 / np.sqrt(np.maximum(np.abs(s), 1e-30))
    for _ in range(BALANCING):
        rows, columns = (H @ unit) / unit, (1.0 / unit @ H) * unit
        if rows.max(initial=0.0) < CERTAIN:
            break
        unit = unit * (np.maximum(rows, 1e-30) / np.maximum(columns, 1e-30)) ** 0.25
    return np.asarray(rows)


def components(linked: Bools) -> Ints:
    """Return a number for each connected component of a graph, the least of its places, (n,)."""
    linked = linked | linked.T
    np.fill_diagonal(linked, val=True)
    label = np.arange(len(linked))
    while True:
        least = np.where(linked, label, len(label)).min(axis=1, initial=len(label))
        if np.array_equal(least, label):
            return label
        label = least
