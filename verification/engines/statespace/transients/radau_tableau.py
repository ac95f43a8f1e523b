"""Compute the coefficients of the Radau IIA methods, in the basis that decouples their stages.

Hairer and Wanner, Solving Ordinary Differential Equations II, sections IV.5 and IV.8.
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
    and `right` transform: ``W = left Z``, ``Z = Re(right W)``. The error estimate is
    ``(shift0 M / h - F')^-1 (F(z0) + M estimate Z / h)``, and ``Q = Z^T polynomial`` are the
    coefficients of theta, theta², ...
    """

    c: Floats
    shifts: Complexes
    left: Complexes
    right: Complexes
    estimate: Floats
    polynomial: Floats


@cache
def tableau(stages: int) -> Tableau:
    """Compute the Radau IIA method with `stages` stages (odd)."""
    from numpy.polynomial.legendre import Legendre

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
    unit = np.zeros(stages)
    unit[0] = -1.0
    embedded = np.linalg.solve(c ** (k - 1)[:, None], unit)  # (b_hat - b) / gamma
    return Tableau(
        c=c,
        shifts=values[kept].astype(np.complex128),
        left=np.linalg.inv(vectors)[kept].astype(np.complex128),
        right=(vectors[:, kept] * weight).astype(np.complex128),
        estimate=np.asarray(embedded @ inverse),
        polynomial=np.linalg.inv(powers).T.astype(np.float64),
    )
