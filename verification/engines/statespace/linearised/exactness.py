"""What rounding takes from a state space, found by residuals of twice the working precision."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from taction.system.array_types import Floats
from taction.verification.engines.statespace.linearised.accurate_products import accurate_sum
from taction.verification.engines.statespace.linearised.scaled_inverse import ScaledInverse


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
