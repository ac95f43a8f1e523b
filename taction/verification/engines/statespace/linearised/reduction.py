"""Reduce ``M z' = K z + b u`` to ``x' = A x + B u``: eliminate unknowns without charge.

An equation without charge determines one unknown; put into the others it may leave further
equations without charge, as a capacitor at a voltage that a source determines does. So the step is
repeated until M is regular: equations of any index are reduced. The states are the charges
``x = L M z`` in the rows L, which are those of the left vectors: ``L K = A L M``. No step of an
input has an impulse in them.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from taction.system.array_types import EPS, Bools, Floats, Ints
from taction.system.errors import EngineError

ROUNDED = 16 * EPS  # error of a sum of products, relative to the sum of their sizes
GRADED = 1e6  # condition number of the capacitances from which states are combinations of voltages
NOTHING = 1e15  # condition number from which rounding leaves nothing of the smallest capacitance
DECIDED = 1e9  # condition number below which rounding cannot make a matrix singular, or regular
SINGULAR = 1e13  # condition number of a scaled matrix above which it counts as singular
CHAINED = 1e9  # condition number of scaled rows from which columns are scaled, too
AT_OUTPUT = "a capacitor whose voltage a source (noise, an amplifier) sets at once: not supported"
STEPS = 2  # inputs before those that change with time


@dataclass(frozen=True, slots=True, eq=False)
class Pencil:
    """Equations ``M y' = K y + b u``, ``z = basis y``, ``y = left z``; y is z without `basis`."""

    M: Floats  # (k, k)
    K: Floats  # (k, k)
    b: Floats  # (k, inputs)
    # `mass`, `pull`: (k, k): sizes of the terms of M and K, to which their rounding is relative.
    mass: Floats
    pull: Floats
    basis: Floats | None = None  # (size, k)
    left: Floats | None = None  # (k, size)

    def voltages(self, y: NDArray[Any], *, sizes: bool = False) -> NDArray[Any]:
        """Return z of y (k, ...), or with `sizes` a bound on |z| from bounds on |y|."""
        return _turned(self.basis, y, sizes)

    def unknowns(self, z: Floats, *, sizes: bool = False) -> Floats:
        """Return y of z (size, ...), or with `sizes` a bound on |y| from bounds on |z|."""
        return _turned(self.left, z, sizes)


def _turned(turn: Floats | None, X: NDArray[Any], sizes: bool) -> NDArray[Any]:
    return X if turn is None else (np.abs(turn) if sizes else turn) @ X


def product(A: NDArray[Any], B: NDArray[Any]) -> NDArray[Any]:
    """Return ``A @ B``, for a real and a complex matrix at half the cost of complex ones."""
    if np.isrealobj(A) == np.isrealobj(B):
        return np.asarray(A @ B)
    if np.isrealobj(B):
        return product(B.T, A.T).T
    return (A @ np.ascontiguousarray(B).view(np.float64)).view(np.complex128)


def graded(pencil: Pencil, exact: NDArray[np.longdouble]) -> Pencil:
    """Return a pencil, whose y is z, in unknowns in which M is diagonal.

    A large capacitor between two nodes with small ones moves both nodes at nearly the same rate. In
    node voltages its own slow rate is the difference of two fast rates, and lost in their rounding.
    Elimination with complete pivoting finds unknowns in which every capacitance has its own
    equation, the fastest first. `exact` (k, k) is M with the digits that its sums have.
    """
    size, d = len(exact), np.flatnonzero(exact.any(axis=1))
    L, D, q, _ = pivoted(exact[np.ix_(d, d)], NOTHING**2)
    U = np.eye(len(d), dtype=D.dtype)[:, q]
    for k in range(len(d)):
        U[:, k + 1 :] -= np.outer(U[:, k], D[k, k + 1 :] / D[k, k])
    turn, basis, M = np.eye(size), np.eye(size), np.zeros((size, size))
    turn[np.ix_(d, d)], basis[np.ix_(d, d)], M[d, d] = L[::-1], U[:, ::-1], np.diag(D)[::-1]
    sizes = [np.abs(turn) @ each @ np.abs(basis) for each in (pencil.mass, pencil.pull)]
    return Pencil(
        M=M,
        K=turn @ pencil.K @ basis,
        b=turn @ pencil.b,
        mass=np.abs(M) + sizes[0] * float(np.finfo(D.dtype).eps / EPS),
        pull=sizes[1],
        basis=basis,
        left=np.asarray(np.linalg.inv(basis)),
    )


@dataclass(frozen=True, slots=True, eq=False)
class Reduced:
    """``x' = A x + B u``, ``z = C x + D u``, ``x = charge z`` of one pencil.

    `seen` (k, n) are the unknowns y of the states, `left` (n, k) what multiplies the equations to
    those of the states, `places` the places of the states among the unknowns y (None where the
    states are combinations), and `decided` tells whether condition numbers leave no doubt about the
    number n of the states.
    """

    pencil: Pencil
    # Coefficients L_k (n, k) of ``w (L_0 + s L_1 + ...)``, which extends left vectors w of A to the
    # pencil: an equation without charge that determines an unknown with charge adds a power of s.
    powers: tuple[Floats, ...]
    # The first step: its equations, the unknowns that these determine, and the inverse of K there;
    # None without a step, or where equations were combined before it.
    first: tuple[Ints, Ints, Floats] | None
    A: Floats
    B: Floats
    C: Floats
    D: Floats
    charge: Floats
    seen: Floats
    left: Floats
    places: Ints | None
    decided: bool


def extended(powers: Sequence[NDArray[Any]], s: NDArray[Any]) -> NDArray[Any]:
    """Return ``L_0 + s L_1 + s s L_2 + ...`` for a matrix s (m, m).

    Of ``w L_k``, L_k the `Reduced.powers`, these are left vectors (m, k) of the pencil where
    ``w A = s w``.
    """
    found = powers[-1]
    for L in powers[-2::-1]:
        found = L + s @ found
    return found


class _Reduction:
    """The equations that are left of a pencil, the unknowns y of those left, and the steps.

    Where equations have charge in another unknown than their own, the unknowns that stay are those
    that determine the charges best (`by_charge`), or those that are left when the equations without
    charge have determined those that they determine best. Each loses digits that the other keeps.
    """

    def __init__(self, pencil: Pencil, names: Sequence[str], by_charge: bool) -> None:
        self.by_charge = by_charge
        self.M, self.K, self.b, self.names = pencil.M, pencil.K, pencil.b, names
        size = len(self.M)
        self.C, self.D = np.eye(size), np.zeros_like(self.b)
        self.jump = np.zeros((2, *self.b.shape))  # charges by each input's rate, with sizes
        self.powers = [np.eye(size)]
        self.first: tuple[Ints, Ints, Floats] | None = None
        self.left = np.arange(size)  # unknowns that stay
        self.charges_jump = False  # whether a step determined unknowns with charge
        self.worst = 1.0  # condition number of what was inverted
        self.turned = self.graded = False

    def run(self, *, grade: bool) -> Floats:
        """Eliminate until M is regular, or until `graded` would keep more; return its inverse."""
        while True:
            turn, charged = None, self.M.any(axis=1)
            free = np.flatnonzero(~charged)
            if charged.all():
                inverse, condition = scaled_inverse(self.M)
                self.graded = grade and not self.turned and GRADED <= condition < NOTHING
                if self.graded or condition < SINGULAR:
                    self.worst = max(self.worst, condition)
                    return inverse
                turn, charged, free = self._separate()
            self._eliminate(turn, np.flatnonzero(~charged), np.flatnonzero(charged), free)

    def _separate(self) -> tuple[Floats, Bools, Ints]:
        """Combine equations so that each has charge, or none, by complete pivoting.

        The last are the unknowns without which the others determine all charges.
        """
        size = len(self.M)
        scale = np.abs(self.M).max(axis=1)
        scale[scale == 0.0] = 1.0
        turn, U, q, rank = pivoted(self.M / scale[:, None])
        turn = turn / scale
        self.M = np.zeros((size, size))
        self.M[:rank, q] = U[:rank]
        self.K, self.b = turn @ self.K, turn @ self.b
        self.powers = [turn @ L for L in self.powers]
        self.jump = np.stack([turn @ self.jump[0], np.abs(turn) @ self.jump[1]])
        self.worst, self.turned = math.inf, True
        return turn, np.arange(size) < rank, np.sort(q[rank:])

    def _eliminate(self, turn: Floats | None, a: Ints, d: Ints, p: Ints) -> None:
        M, K, b, known = self.M, self.K, self.b, False
        if turn is None or self.by_charge:
            inverse, condition = scaled_inverse(K[np.ix_(a, p)])
            known = condition < SINGULAR
        if turn is not None and known:  # not where p is next to nothing of its equations
            known = bool(np.all(np.abs(inverse) * np.abs(K[a]).max(axis=1) < DECIDED))
        if turn is None and self.by_charge and not known:
            turn, charged, free = self._separate()
            return self._eliminate(turn, np.flatnonzero(~charged), np.flatnonzero(charged), free)
        if not known:
            p = _pivots(K[a])
            inverse, condition = scaled_inverse(K[np.ix_(a, p)])
            self.turned = True
        if not condition < SINGULAR:
            listed = [self.names[self.left[k]] for k in p[:5]]
            more = ", ..." if len(p) > 5 else ""
            raise EngineError(
                f"nodes without capacitance stay undetermined: {', '.join(listed)}{more}"
            )
        self.worst = max(self.worst, condition)
        q = np.setdiff1d(np.arange(len(M)), p)
        own, right = K[np.ix_(a, p)], np.concatenate([K[np.ix_(a, q)], b[a]], axis=1)
        X = -inverse @ right
        X -= inverse @ (right + own @ X)
        P, given = X[:, : len(q)], X[:, len(q) :]
        mass, pull, charge = M[np.ix_(d, p)], K[np.ix_(d, p)], M[np.ix_(d, q)]
        self.M, self.K = charge + mass @ P, K[np.ix_(d, q)] + pull @ P
        self.b = b[d] + pull @ given
        moved = np.stack([mass @ given, np.abs(mass) @ np.abs(given)])
        for jump, terms in (self.jump[:, a], moved if turn is None else 0.0 * moved):
            if (np.abs(jump) > 4.0 * ROUNDED * terms)[:, STEPS:].any():
                raise EngineError(AT_OUTPUT)
        self.jump = self.jump[:, d] + moved
        if mass.any():
            sizes = np.abs(charge) + np.abs(mass) @ np.abs(P)
            # P has the rounding of all that cancels in it
            terms = np.abs(inverse) @ (np.abs(K[np.ix_(a, q)]) + np.abs(own) @ np.abs(P))
            least = (np.abs(charge) + np.abs(mass) @ terms) / DECIDED
            if np.any((np.abs(self.M) < least) & (sizes > 0.0)):
                self.worst = math.inf
            self.M[np.abs(self.M) < 4.0 * ROUNDED * sizes] = 0.0
            self.turned = True
        if self.left.size == len(self.C) and turn is None:
            self.first = a, p, inverse
        self._extend(a, d, pull @ inverse, mass @ inverse)
        own = self.C[:, p]
        self.D = self.D + own @ given
        self.C = self.C[:, q] + own @ P
        self.left = self.left[q]

    def _extend(self, a: Ints, d: Ints, pull: Floats, mass: Floats) -> None:
        """Put the equations `a` into the others; those with `mass` as rates."""
        powers = [L[d] - pull @ L[a] for L in self.powers]
        if mass.any():
            self.charges_jump = True
            powers.append(np.zeros_like(powers[0]))
            for k, L in enumerate(self.powers):
                powers[k + 1] += mass @ L[a]
        self.powers = powers


def reduce_pencil(
    pencil: Pencil,
    names: Sequence[str],
    exact: Callable[[], NDArray[np.longdouble]] | None = None,
    *,
    by_charge: bool = False,
) -> Reduced:
    """Eliminate all unknowns without charge from a pencil, whose unknowns have `names`.

    `exact` makes its M for `graded`; `by_charge` chooses the unknowns that stay: see `_Reduction`.

    EngineError: the equations have no such form (see `state_space.linearise`).
    """
    work = _Reduction(pencil, names, by_charge)
    inverse_mass = work.run(grade=exact is not None)
    if exact is not None and work.graded:
        found = reduce_pencil(graded(pencil, exact()), names, by_charge=by_charge)
        return replace(found, places=None, decided=False)
    right = np.concatenate([work.K, work.b], axis=1)
    rates = inverse_mass @ right
    rates += inverse_mass @ (right - work.M @ rates)
    n = len(work.M)
    A, B, C, D = rates[:, :n], rates[:, n:], work.C, work.D
    powers = tuple(inverse_mass @ L for L in work.powers)
    L = extended(powers, A)
    if work.charges_jump:  # the step itself charges what it reaches
        D = D - C @ (L @ (pencil.M @ D))
        B = L @ pencil.b
    return Reduced(
        pencil=pencil,
        powers=powers,
        first=work.first,
        A=A,
        B=B,
        C=pencil.voltages(C),
        D=pencil.voltages(D),
        charge=L @ pencil.M if pencil.left is None else L @ pencil.M @ pencil.left,
        seen=C,
        left=L,
        places=None if work.turned else work.left,
        decided=work.worst < DECIDED,
    )


def _pivots(rows: Floats) -> Ints:
    """Return as many unknowns as there are equations, which these determine best."""
    from scipy.linalg import qr

    scale = np.abs(rows).max(axis=1, keepdims=True)
    scale[scale == 0.0] = 1.0
    pivots: Ints = qr(rows / scale, mode="r", pivoting=True)[1]
    return np.sort(pivots[: len(rows)])


def scaled_inverse(A: Floats) -> tuple[Floats, float]:
    """Return the inverse of A (k, k), and the condition number of the scaled matrix.

    Rows are scaled. Where this leaves a large condition number (of the row-sum norm; infinite of a
    singular matrix), as of a chain of gains, it is that of the best scales of rows and columns: the
    spectral radius of ``|1/A| |A|`` (F. L. Bauer, Numer. Math. 5, 1963).
    """
    rows = np.abs(A).max(axis=1, initial=0.0)
    rows[rows == 0.0] = 1.0
    scaled = A / rows[:, None]
    coupled, own = scaled != 0.0, np.diag(scaled)
    np.fill_diagonal(coupled, own == 0.0)
    c = np.flatnonzero(coupled.any(axis=0) | coupled.any(axis=1))
    inverse = np.diag(own)  # 1 or -1 where nothing is coupled
    try:
        inverse[np.ix_(c, c)] = np.linalg.inv(scaled[np.ix_(c, c)])
    except np.linalg.LinAlgError:
        return np.full_like(A, np.inf), np.inf
    sizes = np.abs(inverse), np.abs(scaled)
    condition = math.prod(float(size.sum(axis=1).max(initial=1.0)) for size in sizes)
    if CHAINED <= condition < np.inf:
        condition = float(np.abs(np.linalg.eigvals(sizes[0] @ sizes[1])).max())
    return inverse / rows, condition


def pivoted(
    A: NDArray[Any], limit: float = SINGULAR
) -> tuple[NDArray[Any], NDArray[Any], Ints, int]:
    """Return X, U, q and the rank r of A: ``(X A)[:, q] = U``, upper, by complete pivoting.

    The rank ends where a pivot is below the first one over `limit`. What is zero stays zero, where
    singular vectors have rounding, times the largest elements.
    """
    X, U, size, q = np.eye(len(A), dtype=A.dtype), A.copy(), len(A), np.arange(len(A))
    for r in range(size):
        i, j = (r + place for place in divmod(int(np.abs(U[r:, r:]).argmax()), size - r))
        if abs(U[i, j]) * limit <= abs(U[0, 0]):
            return X, U, q, r
        for rows in (U, X):
            rows[[r, i]] = rows[[i, r]]
        U[:, [r, j]], q[[r, j]] = U[:, [j, r]], q[[j, r]]
        down = U[r + 1 :, r] / U[r, r]
        for rows in (U, X):
            rows[r + 1 :] -= np.outer(down, rows[r])
    return X, U, q, size
