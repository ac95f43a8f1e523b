"""Find the modes of reduced equations by eigenvectors or Schur vectors, and compare their residual.

See `modes` for what the residual says. Nothing that is stated depends on how vectors were found.
"""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np

from taction.system.array_types import Bools, Complexes, Floats, Ints
from taction.verification.engines.statespace.linearised.modes import Modes, components
from taction.verification.engines.statespace.linearised.reduction import (
    ROUNDED,
    Reduced,
    extended,
    product,
)

# Of the largest voltage: error of a response, above which Newton's steps are tried, then groups of
# nearly parallel modes.
ENOUGH = 1e-7
FINE = 1e-9  # the same before the last step of `refined_modes`
NEWTON = 6  # largest number of steps
FAR = 0.1  # largest turn of a vector by one step
SEPARABLE = 1e6  # condition number of vectors up to which modes are separated
IMPROVABLE = 4.0  # times what is unknown of it: a coupling that a step reduces
ALIKE = 1e-12  # relative difference of figures, and of couplings, of states that mirror each other
FEW = 60  # states, whose problem costs less than the search for a mirror
COUPLED, TINY = 4, 1e-300  # so many couplings away states count in a figure
GROUPS = ((1e5, 0.25), (1e2, 0.5), (0.0, 1.0))  # condition of a mode, width of its group in decays


@np.errstate(over="ignore", invalid="ignore", divide="ignore")
def find_modes(reduced: Reduced) -> Modes:
    """Return the modes, refined by Newton's steps and then by groups of parallel ones.

    The dense eigenproblem costs 25 n³ flops.

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
    return (best if best is first else replace(best, other=first)).ordered


def refined_modes(modes: Modes) -> Modes:
    """Return modes some Newton steps later: vectors in which A is diagonal but for rounding."""
    basis = modes.alone.all() and np.isfinite(modes.defect)
    return newton_step(_refined(modes, FINE)).ordered if basis else modes


def _refined(modes: Modes, wanted: float = ENOUGH) -> Modes:
    """Take Newton's steps while there is something to gain; return the best modes."""
    best = modes
    for _ in range(NEWTON):
        if best.error <= wanted or not np.all(np.isfinite(modes.F)):
            break
        if not np.any(np.abs(modes.F) > IMPROVABLE * modes.E):
            break
        modes = newton_step(modes)
        if modes.error < best.error:
            best = modes
    return best


def certify(
    reduced: Reduced, T: Complexes, group: Ints, mates: Ints, X: Complexes, W: Complexes
) -> Modes:
    """Compare vectors with the pencil; W is scaled to ``W M V`` of unit diagonal."""
    pencil, V = reduced.pencil, product(reduced.seen, X)
    M, K, n = pencil.M, pencil.K, len(T)
    MV, KV = product(M, V), product(K, V)
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
        coupled = product(K[:, p].T, W.T).T
        doubt = weights @ pencil.pull[:, p]
        if charged:
            WM = product(M[:, p].T, W.T).T
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
    return Modes(reduced, T, group, mates, X, V, W, F, E, mixed, hidden)


def _extended(reduced: Reduced, T: Complexes, Y: Complexes) -> Complexes:
    """Return left vectors of the pencil for those of A, ``Y A = T Y``."""
    return extended([product(Y, L) for L in reduced.powers], T)


def _with_conjugates(values: Complexes, mates: Ints) -> Complexes:
    """Return values of modes, or vectors as rows, that are conjugate where the modes are mates."""
    found, known = values.copy(), mates >= 0
    found[known] = 0.5 * (values[known] + values[mates[known]].conj())
    return found


def eigenvectors(A: Floats) -> tuple[Complexes, Complexes]:
    """Return eigenvalues (n,) of A and vectors (n, n) like LAPACK, which of pairs are conjugate.

    A board with a mirror, as one with equal distances between its channels is, has modes that are
    even and odd: two problems of half the size, which cost a quarter.
    """
    mirror = mirrored(A) if len(A) > FEW else None
    if mirror is None:
        return np.linalg.eig(A)
    one = np.flatnonzero(np.arange(len(A)) < mirror)
    own = np.flatnonzero(np.arange(len(A)) == mirror)
    half, other = np.append(own, one), mirror[one]
    even, odd = A[np.ix_(half, half)], A[np.ix_(one, one)] - A[np.ix_(one, other)]
    even[:, own.size :] += A[np.ix_(half, other)]
    (s, V), (t, W) = np.linalg.eig(even), np.linalg.eig(odd)
    vectors = np.zeros(A.shape, dtype=np.result_type(V, W))
    vectors[half, : len(s)], vectors[other, : len(s)] = V, V[own.size :]
    vectors[one, len(s) :], vectors[other, len(s) :] = W, -W
    return np.append(s, t), vectors


def mirrored(A: Floats) -> Ints | None:
    """Return the places (n,) of states that change nothing in A by an exchange, or None.

    States are paired by figures that do not depend on their order: sums of functions of what they
    are coupled with, over some couplings. The exchange is compared with A in the end.
    """
    sizes, n = np.abs(A), len(A)
    rows, columns = (np.maximum(sizes.max(axis=k, initial=0.0), TINY) for k in (1, 0))
    by_row, by_column = sizes / rows[:, None], sizes.T / columns[:, None]
    figure = np.log(rows) + 0.3 * np.log(columns)
    for _ in range(COUPLED):
        figure = by_row @ np.cos(figure) + 0.7 * (by_column @ np.sin(figure)) + 0.1 * figure
    order, mirror = np.argsort(figure), np.arange(n)
    pairs = np.flatnonzero(np.diff(figure[order]) < ALIKE * np.abs(figure).max(initial=0.0))
    if not pairs.size or np.any(np.diff(pairs) == 1):
        return None
    a, b = order[pairs], order[pairs + 1]
    mirror[a], mirror[b] = b, a
    exchanged = A[np.ix_(mirror, mirror)]
    same = np.abs(exchanged - A) <= ALIKE * sizes
    return mirror if same.all() else None


def eigenmodes(reduced: Reduced) -> Modes:
    """Return the modes, each by itself; the vectors of pairs are conjugate to the bit."""
    s, vectors = eigenvectors(reduced.A)
    order = np.argsort(-s.real, kind="stable")  # pairs, of equal real parts, stay together
    s, vectors = s[order], vectors[:, order]
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
    return certify(reduced, T, numbers, mates, vectors + 0j, _extended(reduced, T, Y))


def newton_step(modes: Modes) -> Modes:
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
    charges = product(pencil.M, product(modes.reduced.seen, X))
    W = np.asarray(np.linalg.solve(W @ charges, W))
    X, W = _with_conjugates(X.T, mates).T, _with_conjugates(W, mates)
    return certify(modes.reduced, T, modes.group, mates, X, W)


def _separated(modes: Modes) -> tuple[Complexes, Ints, Complexes, Complexes]:
    """Return T, mates, X and W with the modes apart that F mixes more than a step can turn."""
    s, mates, alone = np.diag(modes.T), modes.mates, modes.alone
    size = np.abs(modes.F)
    mixed = (size > FAR * np.abs(s[:, None] - s)) & (size > IMPROVABLE * modes.E)
    mixed &= alone & alone[:, None]
    own = np.where(alone, mates, np.arange(len(s)))
    label = components(mixed | mixed[np.ix_(own, own)])
    numbers, counts = np.unique(label, return_counts=True)
    if not np.any(counts > 1):
        return modes.T, mates, modes.right, modes.W
    T, X, W, mates = modes.T.copy(), modes.right.copy(), modes.W.copy(), mates.copy()
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
    return (T, mates, X, W) if changed else (modes.T, modes.mates, modes.right, modes.W)


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


def conditions(modes: Modes) -> Floats:
    """Return the condition number of each mode, in volts and in unknowns of equal size, (n,)."""
    V, W = np.abs(modes.V), np.abs(modes.W @ modes.reduced.pencil.M)
    scale = V.max(axis=1, initial=0.0)
    inverse = np.divide(1.0, scale, where=scale > 0.0, out=np.zeros_like(scale))
    found = [
        np.linalg.norm(V * a[:, None], axis=0) * np.linalg.norm(W * b, axis=1)
        for a, b in ((np.ones_like(scale), np.ones_like(scale)), (inverse, scale))
    ]
    return np.asarray(np.maximum(*found))


def group_modes(reduced: Reduced, s: Complexes, ill: Bools, width: float) -> Modes:
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
    return certify(reduced, found, group, mates, X, _extended(reduced, found, Y))


def _single(label: Ints, t: Complexes, mates: Ints) -> tuple[list[int], list[int]]:
    """Return the places of single real poles, and of the upper ones of single pairs."""
    single = np.flatnonzero(np.bincount(label)[label] == 1).tolist()
    paired = [k for k in single if mates[k] != k and mates[mates[k]] == k]
    return [k for k in single if k not in paired], [k for k in paired if t[k].imag > 0.0]
