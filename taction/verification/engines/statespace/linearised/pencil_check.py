"""Check poles against the equations that they came from: residuals in ``M z' = K z``.

An elimination bounds its rounding step by step, which misses what cancels between steps. A residual
in the whole equations, with more digits, sees the sum of it all.
"""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from taction.system.array_types import EPS, Complexes, Floats
from taction.verification.engines.statespace.equations.descriptor import Descriptor
from taction.verification.engines.statespace.linearised.block import spectral_radius
from taction.verification.engines.statespace.linearised.modes import Modes

UNITS = 4.0  # times rounding: error of a stamped value
ASIDE = 1e-4  # of a pole: distance of the point at which its left vector is found
MIXED = 0.5  # spectral radius of what modes share in M: with a larger one nothing is said of pairs
WORK = 2e9  # products of all pairs; of a larger board the rightmost poles are checked


class PoleResiduals(NamedTuple):
    """What the equations say of poles, rightmost first.

    Attributes
    ----------
    bounds : ndarray (k,)
        On the errors of the poles as they are, 1/s; 0 where modes are joined.
    corrected : tuple of two ndarrays, or None
        Where all modes are alone, and all are checked: what corrects each pole, 1/s, (n,), and the
        bound on what the equations then have beside the poles in the coordinates of the modes, 1/s,
        (n, n).
    """

    bounds: Floats
    corrected: tuple[Complexes, Floats] | None = None


def pole_residuals(
    descriptor: Descriptor, slopes: Floats, modes: Modes, seen: Floats, charge: Floats
) -> PoleResiduals:
    """Return bounds on the errors of poles, and what corrects them.

    `slopes` (m,) are the amplifiers', ``seen`` (size, n) the unknowns of the states, and `charge`
    (n, size) the states of the unknowns. With the poles S, the residuals R of all pairs of modes,
    ``w_i (s_j M - K) v_j / w_i M v_i``, and ``1 + F``, ``w_i M v_j / w_i M v_i``, the poles of the
    equations are the eigenvalues of ``S - (1 + F)^-1 R``: to first order those of ``S - R``.
    """
    size, n = seen.shape
    count = min(n, max(1, int(WORK / size**2)))
    unknown = PoleResiduals(np.full(count, np.inf))
    if not modes.defect < 1.0:
        return unknown
    M, K = descriptor.summed(lambda values: values.astype(np.longdouble), slopes)
    mass, pull = M.astype(np.float64), K.astype(np.float64)
    sizes_of_M, sizes_of_K = descriptor.summed(np.abs, slopes)  # of the terms, which may cancel
    poles = modes.poles[:count]
    right = seen @ modes.right[:, :count]
    rows = modes.left[:count] @ charge
    largest = np.abs(rows).max(axis=1, keepdims=True)
    rows /= np.where(largest > 0.0, largest, 1.0)  # the size of a left vector says nothing
    aside = ASIDE * np.maximum(np.abs(poles), 1e-6 * np.abs(modes.poles).max(initial=0.0))
    try:
        left = _turned(mass, pull, poles + aside, rows)
    except RuntimeError:  # singular
        return unknown
    v, w, s = (part.astype(np.clongdouble) for part in (right, left, poles))
    charged = M @ v
    missing = s * charged - K @ v
    seen_sizes = np.abs(right)
    sizes = sizes_of_M @ seen_sizes * np.abs(poles) + sizes_of_K @ seen_sizes
    norm = (w * charged.T).sum(axis=1)

    def relative(terms: NDArray[Any]) -> Complexes:
        """Return what belongs to each mode, (k, ...), over its norm, in double precision."""
        with np.errstate(divide="ignore", invalid="ignore"):
            return np.asarray((terms.T / norm).T, dtype=np.complex128)

    own = relative((w * missing.T).sum(axis=1))
    rounding = UNITS * EPS * np.abs(relative((np.abs(left) * sizes.T).sum(axis=1)))
    bounds = np.where(modes.alone[:count], _known(2.0 * np.abs(own) + rounding), 0.0)
    if count < n or not modes.alone.all():
        return PoleResiduals(bounds)
    unsure = UNITS * EPS * np.abs(relative(np.abs(left) @ sizes))
    mixed = np.abs(relative(w @ charged) - np.eye(n))
    mixed += UNITS * EPS * np.abs(relative(np.abs(left) @ (sizes_of_M @ seen_sizes)))
    if not (np.isfinite(mixed).all() and spectral_radius(mixed) < MIXED):
        return PoleResiduals(bounds)
    residuals = np.abs(relative(w @ missing)) + unsure
    between = mixed @ np.linalg.solve(np.eye(n) - mixed, residuals)
    np.fill_diagonal(residuals, np.diag(unsure))
    return PoleResiduals(bounds, (-own, _known(residuals + between)))


def _turned(mass: Floats, pull: Floats, near: Complexes, rows: Complexes) -> Complexes:
    """Solve ``left (s M - K) = row`` for each place s near a pole, (k,); equations are scaled."""
    from scipy.sparse import coo_array
    from scipy.sparse.linalg import splu

    i, j = np.nonzero((mass != 0.0) | (pull != 0.0))
    M, K, found = mass[i, j], pull[i, j], np.empty(rows.shape, complex)
    for k, s in enumerate(near):
        values, scale = s * M - K, np.zeros(len(mass))
        np.maximum.at(scale, i, np.abs(values))
        scale[scale == 0.0] = 1.0
        pencil = coo_array((values / scale[i], (j, i)), mass.shape).tocsc()
        found[k] = splu(pencil).solve(rows[k]) / scale
    return found


def _known(bound: Floats) -> Floats:
    return np.nan_to_num(bound, nan=np.inf)
