"""The energy balance of a transient: what the network lost against what it dissipated."""

from __future__ import annotations

from collections.abc import Callable
from typing import Protocol

import numpy as np

from spice_models.array_types import Floats
from verification.reference.regularisers import Regulariser

_GAUSS_NODES, _GAUSS_WEIGHTS = np.polynomial.legendre.leggauss(6)


class Descending(Protocol):
    """What the balance needs to know of a network (`verification.reference.dynamics`)."""

    g: Regulariser

    def slope(self, _: float, x: Floats, /) -> Floats:
        """Return dx/dt for x (N, K)."""
        ...

    def energy(self, x: Floats, /) -> float:
        """Return the energy of x (N,)."""
        ...


def energy_residual(scaled: Descending, steps: Floats, dense: Callable[[Floats], Floats]) -> float:
    """Compare the energy lost with the energy dissipated, by Gauss quadrature in each step.

    Parameters
    ----------
    steps : ndarray (P,)
        Instants over R C, close enough for six Gauss points between two.
    dense : callable
        ``t (K,) -> x (N, K)``.

    Returns
    -------
    float
        ``|P(t) - P(0) + integral of sum C g' v'^2|`` over ``|P(0) - P(t)|``: zero for a trajectory
        of the ideal network (the descent proof of theorem 3.1, in u as it must be).
    """
    half = 0.5 * np.diff(steps)
    t = (steps[:-1, None] + half[:, None] * (1.0 + _GAUSS_NODES)).ravel()
    x = dense(t)
    power = np.sum(scaled.g.slope(x) * scaled.slope(0.0, x) ** 2, axis=0)
    dissipated = float(np.sum(power * np.outer(half, _GAUSS_WEIGHTS).ravel()))
    lost = scaled.energy(dense(steps[:1])[:, 0]) - scaled.energy(dense(steps[-1:])[:, 0])
    return abs(dissipated - lost) / abs(lost) if lost != 0.0 else abs(dissipated)
