"""Radau IIA collocation with any odd number of stages: its coefficients.

With s stages the order is 2s - 1, L-stable and stiffly accurate, so the equations may be of index 1
(Hairer and Wanner, Solving Ordinary Differential Equations II, sections IV.5 and IV.8). Between the
stages the solution is a polynomial of degree s through the start and the stages.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cache

import numpy as np

from taction.system.array_types import Complexes, Floats


@dataclass(frozen=True, slots=True, eq=False)
class Tableau:
    """One method, in the basis that decouples its stages.

    `c` (s,) are the collocation points, the last of which is 1; `shifts` ((s + 1) / 2,) the
    eigenvalues of the inverse of the method's matrix: the real one, then one of each pair. `left`
    and `right` transform: ``W = left Z``, ``Z = Re(right W)``. The product of `legendre`
    (s + 1, s + 1) with values at 0 and c gives the coefficients of the Legendre polynomials of
    ``2 theta - 1``.
    """

    c: Floats
    shifts: Complexes
    left: Complexes
    right: Complexes
    legendre: Floats


@cache
def tableau(stages: int) -> Tableau:
    """Compute the Radau IIA method with `stages` stages (odd)."""
    from numpy.polynomial.legendre import Legendre, legvander

    first, second = Legendre.basis(stages), Legendre.basis(stages - 1)
    c = 0.5 * (np.sort((first - second).roots().real) + 1.0)
    c[-1] = 1.0
    k = np.arange(1, stages + 1)
    powers = c[:, None] ** k  # of the collocation polynomial's terms
    inverse = (k * c[:, None] ** (k - 1)) @ np.linalg.inv(powers)  # of the method's matrix
    values, vectors = np.linalg.eig(inverse)
    kept = np.flatnonzero(values.imag >= 0.0)
    kept = kept[np.argsort(values[kept].imag)]
    weight = np.where(values[kept].imag > 0.0, 2.0, 1.0)
    return Tableau(
        c=c,
        shifts=values[kept].astype(np.complex128),
        left=np.linalg.inv(vectors)[kept].astype(np.complex128),
        right=(vectors[:, kept] * weight).astype(np.complex128),
        legendre=np.linalg.inv(legvander(2.0 * np.append(0.0, c) - 1.0, stages)).astype(np.float64),
    )


STAGES = 9
TABLE = tableau(STAGES)
NODES = np.append(0.0, TABLE.c)
SIGMA = TABLE.left.sum(axis=1)
