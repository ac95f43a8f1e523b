"""Rounding errors of a state space, found by residuals of twice the working precision.

In an accurate product every factor is split into slices of so few bits that the product of two
slices is exact, in any order of summation; the exact products are then added with compensation
(Ozaki, Ogita, Oishi and Rump 2012).
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Sequence
from dataclasses import dataclass

import numpy as np

from taction.system.array_types import Floats
from taction.system.errors import EngineError

DIGITS = 53
SLICES = 4  # of a factor, of at least 20 bits each; products of the smallest are left out


def accurate_sum(terms: Sequence[Floats], products: Iterable[tuple[Floats, Floats]]) -> Floats:
    """Return ``sum terms + sum P Q`` of matrices of one shape, rounded only once or nearly so.

    Examples
    --------
    >>> import numpy as np
    >>> third = np.full((1, 1), 1.0 / 3.0)
    >>> print(f"{accurate_sum([-third * third], [(third, third)])[0, 0]:.14e}")
    -6.16790569236198e-18
    """
    total: Floats | None = None
    rest: Floats | None = None
    for part in (*terms, *(part for P, Q in products for part in _exact_products(P, Q))):
        if total is None or rest is None:
            total, rest = part.copy(), np.zeros_like(part)
            continue
        new = total + part
        back = new - total
        rest += (total - (new - back)) + (part - back)
        total = new
    if total is None or rest is None:
        raise ValueError("nothing to add")
    return total + rest


def _exact_products(P: Floats, Q: Floats) -> Iterable[Floats]:
    """Yield products of slices, the largest first, whose sum is ``P Q``.

    Powers of two make the rows of Q equally large first, so that slices keep its small elements.
    """
    size = np.abs(Q).max(axis=1, initial=0.0)
    exponent = np.where(size > 0.0, np.frexp(size)[1], 0)
    P, Q = np.ldexp(P, exponent), np.ldexp(Q, -exponent[:, None])
    bits = math.ceil((DIGITS + math.log2(max(P.shape[1], 1))) / 2.0)
    left, right = _slices(P, 1, bits), _slices(Q, 0, bits)
    for level in range(SLICES):
        for k in range(level + 1):
            yield left[k] @ right[level - k]


def _slices(X: Floats, axis: int, bits: int) -> list[Floats]:
    """Split X into slices that are multiples of one power of two along `axis`."""
    found, rest = [], X
    for _ in range(SLICES):
        largest = np.abs(rest).max(axis=axis, initial=0.0, keepdims=True)
        shift = np.where(largest > 0.0, np.ldexp(1.0, np.frexp(largest)[1] + bits), 0.0)
        head = (rest + shift) - shift
        found.append(head)
        rest = rest - head
    return found


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
class Exactness:
    """What rounding took from A, and how A depends on the elements from which it was computed.

    Attributes
    ----------
    tail : ndarray (n, n)
        The exact A minus the rounded one, 1/s.
    left, right : ndarray (n, m) and (m, n)
        A change dK of the stiffness of the m unknowns changes A by ``left dK right``.
    stiffness, mass : ndarray (m, m) and (n, n)
        Magnitudes of their elements, which are rounded relative to themselves.
    """

    tail: Floats
    left: Floats
    right: Floats
    stiffness: Floats
    mass: Floats


def find_exactness(
    K: Floats, M: Floats, passive: Floats, A: Floats, mass: ScaledInverse, inner: ScaledInverse
) -> Exactness:
    """Return what rounding took from ``A = M^-1 (K_dd - K_da passive)``.

    K has the charged unknowns first, and `passive` is ``K_aa^-1 K_ad``. The residual of every step,
    computed to twice the precision, is solved for once more.
    """
    n, names, never = len(M), ("states",), "solved before"
    dd, da, ad, aa = K[:n, :n], K[:n, n:], K[n:, :n], K[n:, n:]
    passive_tail = inner.solve(accurate_sum([ad], [(-aa, passive)]), names, never)
    rates = dd - da @ passive
    rates_tail = accurate_sum([dd, -rates], [(-da, passive)]) - da @ passive_tail
    tail = mass.solve(accurate_sum([rates], [(-M, A)]) + rates_tail, names, never)
    coupling = ScaledInverse(aa.T).solve(da.T, names, never).T
    left = mass.solve(np.concatenate([np.eye(n), -coupling], axis=1), names, never)
    right = np.concatenate([np.eye(n), -passive])
    return Exactness(tail, left, right, np.abs(K), np.abs(M))
