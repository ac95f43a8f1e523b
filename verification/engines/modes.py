"""Modes of ``x' = A x + b``: eigenvalues with left and right vectors, and how far to trust them."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from verification.engines.equations import Ints
from verification.engines.mirror import Halves

Floats = NDArray[np.float64]
Complexes = NDArray[np.complex128]


@dataclass(frozen=True, slots=True, eq=False)
class Modes:
    """``A = right diag(poles) left`` with ``left right = 1``.

    Attributes
    ----------
    poles : ndarray (n,)
        Eigenvalues, 1/s, rightmost first.
    right, left : ndarray (n, n)
        Columns are modes; rows are their dual vectors.
    condition : ndarray (n,)
        ``|left_i| |right_i|`` after scaling of the states, at least 1: how much a perturbation
        of A moves the pole.
    spread : ndarray (n,)
        First-order bound on the error of each pole that rounding in A's elements causes, 1/s:
        ``eps sum_jk |left_ij| |A_jk| |right_ki|``, and what couples it to poles too close to it.
    defect : float
        Largest element of ``left right - 1``; infinite where the modes are defective.
    """

    poles: Complexes
    right: Complexes
    left: Complexes
    condition: Floats
    spread: Floats
    defect: float

    def amplitudes(self, C: Floats, deviation: Floats) -> Complexes:
        """Share of each mode in each row of ``C x``, shape (len(C), n).

        ``C x(t) = sum_i amplitudes[:, i] exp(poles[i] t)`` for ``x(0) = deviation``.
        """
        return np.asarray((C @ self.right) * (self.left @ deviation))


def eigenvalues(A: Floats, mirror: Ints | None = None) -> Complexes:
    """Return the eigenvalues of A, (n,), in no order; `mirror` as `decompose` has it."""
    if mirror is None:
        return np.asarray(np.linalg.eigvals(A), dtype=np.complex128)
    parts = [np.linalg.eigvals(half) for half in Halves.of(mirror).split(A)]
    return np.concatenate(parts).astype(np.complex128)


def decompose(A: Floats, mirror: Ints | None = None) -> Modes:
    """Decompose A, shape (n, n), at the cost of one dense eigenproblem (about 25 n³ flops).

    Never raises for finite A: a defective matrix shows in `Modes.defect` and `Modes.condition`.

    Parameters
    ----------
    mirror : ndarray of int (n,), optional
        Place of the mirror image of each state, if the exchange commutes with A: two
        eigenproblems of half the size then do, at a quarter of the cost.
    """
    if mirror is None:
        modes = _decompose(A, np.abs(A))
    else:
        halves = Halves.of(mirror)
        even, odd = map(_decompose, halves.split(A), halves.split_sizes(A))
        modes = _joined(even, odd, halves)
    order = np.lexsort((-modes.poles.imag, -modes.poles.real))
    return Modes(
        modes.poles[order],
        modes.right[:, order],
        modes.left[order],
        modes.condition[order],
        modes.spread[order],
        modes.defect,
    )


def _joined(even: Modes, odd: Modes, halves: Halves) -> Modes:
    """Write the modes of the two halves out on all states."""
    share = np.where(np.arange(len(halves.own)) < halves.pairs, 0.5, 1.0)
    return Modes(
        np.concatenate([even.poles, odd.poles]),
        halves.join(even.right, odd.right),
        halves.join(even.left.T * share[:, None], 0.5 * odd.left.T).T,
        np.concatenate([even.condition, odd.condition]),
        np.concatenate([even.spread, odd.spread]),
        max(even.defect, odd.defect),
    )


def _decompose(A: Floats, size: Floats) -> Modes:
    """Decompose A, in no order; `size` is what the rounding of its elements is relative to."""
    poles, vectors = np.linalg.eig(A)
    poles, vectors = poles.astype(np.complex128), vectors.astype(np.complex128)
    pairs = _Pairs(poles)
    R = pairs.real_columns(vectors)
    # Row scaling: states of small amplitude must not decide the pivots.
    scale = _scale(R)
    try:
        inverse = np.linalg.inv(R / scale[:, None])
    except np.linalg.LinAlgError:
        inverse = np.full_like(R, np.inf)
    if not np.all(np.isfinite(inverse)):
        nothing = np.full(len(poles), np.inf)
        return Modes(poles, vectors, np.full_like(vectors, np.inf), nothing, nothing, np.inf)
    return _refine(A, size, pairs, R, inverse / scale)


def _refine(A: Floats, size: Floats, pairs: _Pairs, R: Floats, L: Floats) -> Modes:
    """Take one Newton step on all modes at once.

    The eigensolver's error is ``eps |A|``, set by the fastest mode; that of ``left A right`` is
    set mode by mode, some orders of magnitude smaller for the slow ones. Modes that are too close
    to separate keep their vectors, and what couples them counts as error (`Modes.spread`).
    """
    one = np.eye(len(A))
    rest = one - L @ R
    reduced = pairs.modal(L @ (A @ R) + pairs.times_poles(rest))
    diagonal = np.arange(len(pairs.kept)), pairs.kept
    exact = reduced[diagonal]
    exact.imag[pairs.real] = 0.0
    poles = pairs.both(exact)
    reduced[diagonal] = 0.0
    gap = poles - exact[:, None]
    coupling = reduced.real**2 + reduced.imag**2
    separable = coupling < 1e-4 * (gap.real**2 + gap.imag**2)
    turn = pairs.unmodal(np.divide(reduced, gap, out=np.zeros_like(gap), where=separable))
    R, L = R + R @ turn, L + (rest - turn) @ L
    L = L + (one - L @ R) @ L
    defect = float(np.abs(L @ R - one).max(initial=0.0))
    coupling[separable] = 0.0
    right, left = pairs.sizes(R), pairs.weight[:, None] * pairs.sizes(L.T).T
    scale = _scale(right)
    condition = np.linalg.norm(left * scale, axis=1) * np.linalg.norm(right.T / scale, axis=1)
    spread = np.finfo(float).eps * (left * (size @ right).T).sum(axis=1)
    spread += pairs.both(np.sqrt(coupling).sum(axis=1)).real
    return Modes(poles, pairs.columns(R), pairs.both(pairs.rows(L)), condition, spread, defect)


def _scale(X: Floats) -> Floats:
    """Largest element of each row, 1 where there is none."""
    scale = np.abs(X).max(axis=1, initial=0.0)
    return np.where(scale > 0.0, scale, 1.0)


class _Pairs:
    """Modes in real arithmetic, where products of matrices cost a quarter.

    Of a conjugate pair, real columns ``a, b`` stand for the vectors ``a - ib, a + ib``, and real
    rows ``p, q`` for their duals ``(p + iq) / 2, (p - iq) / 2``.

    Parameters
    ----------
    poles : ndarray (n,)
        Each pair in succession, as LAPACK has them.
    """

    def __init__(self, poles: Complexes) -> None:
        self.poles = poles
        self.first, self.second = np.flatnonzero(poles.imag > 0.0), np.flatnonzero(poles.imag < 0.0)
        self.kept = np.flatnonzero(poles.imag >= 0.0)  # of a pair one row tells both
        paired = poles.imag[self.kept] > 0.0
        self.pair, self.real = np.flatnonzero(paired), np.flatnonzero(~paired)
        self.weight = np.where(poles.imag == 0.0, 1.0, 0.5)

    def real_columns(self, V: Complexes) -> Floats:
        """Real columns that stand for complex ones."""
        X = V.real.copy()
        X[:, self.second] = V.imag[:, self.second]
        return X

    def columns(self, X: NDArray[Any]) -> Complexes:
        """Complex columns for real ones."""
        V = X.astype(np.complex128)
        turned = 1j * X[:, self.second]
        V[:, self.first] -= turned
        V[:, self.second] = X[:, self.first] + turned
        return V

    def rows(self, X: Floats) -> Complexes:
        """Complex rows for real ones, without the conjugate ones."""
        V = X[self.kept].astype(np.complex128)
        V.imag[self.pair] = X[self.second]
        V[self.pair] *= 0.5
        return V

    def both(self, kept: NDArray[Any]) -> Complexes:
        """Add the conjugates along the first axis."""
        whole = np.empty((len(self.poles), *kept.shape[1:]), dtype=np.complex128)
        whole[self.kept], whole[self.second] = kept, kept[self.pair].conj()
        return whole

    def modal(self, X: Floats) -> Complexes:
        """Real rows by real columns as modes by modes, without the conjugate rows."""
        return self.columns(self.rows(X))

    def unmodal(self, V: Complexes) -> Floats:
        """Undo `modal`."""
        Z = V.copy()
        Z[:, self.first] = 0.5 * (V[:, self.first] + V[:, self.second])
        Z[:, self.second] = 0.5j * (V[:, self.first] - V[:, self.second])
        X = np.empty((len(self.poles), len(self.poles)))
        X[self.kept] = Z.real
        X[self.first] *= 2.0
        X[self.second] = 2.0 * Z.imag[self.pair]
        return X

    def times_poles(self, X: Floats) -> Floats:
        """Multiply real columns by the poles of their modes."""
        Y = X * self.poles.real
        Y[:, self.first] += X[:, self.second] * self.poles.imag[self.first]
        Y[:, self.second] += X[:, self.first] * self.poles.imag[self.second]
        return Y

    def sizes(self, X: Floats) -> Floats:
        """Magnitudes of the complex columns for real ones."""
        squares = X**2
        both = squares[:, self.first] + squares[:, self.second]
        squares[:, self.first] = squares[:, self.second] = both
        return np.sqrt(squares)
