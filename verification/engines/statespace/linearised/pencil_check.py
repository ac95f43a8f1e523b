"""Check poles against the equations that they came from: residuals in ``M z' = K z``.

An elimination bounds its rounding step by step, which misses what cancels between steps. A residual
in the whole equations, with more digits, sees the sum of it all.
"""

from __future__ import annotations

import numpy as np

from taction.system.array_types import EPS, Floats
from taction.verification.engines.statespace.equations.descriptor import Descriptor
from taction.verification.engines.statespace.linearised.modes import Modes

UNITS = 4.0  # times rounding: error of a stamped value
ASIDE = 1e-4  # of a pole: distance of the point at which its left vector is found
WORK = 2e9  # products of the solves; of a larger board the rightmost poles are checked


def pole_residuals(
    descriptor: Descriptor, slopes: Floats, modes: Modes, seen: Floats, charge: Floats
) -> tuple[Floats, Floats | None]:
    """Return bounds on the errors of the poles, (k,), rightmost first; 0 where modes are joined.

    `slopes` (m,) are the amplifiers', ``seen`` (size, n) the unknowns of the states, and `charge`
    (n, size) the states of the unknowns. The error of a pole s with the vectors w and v is, to
    first order, ``w (s M - K) v / w M v``. Where all modes are alone, and all are checked, the
    second is the bound between each two modes i and j, ``w_i (s_j M - K) v_j / w_i M v_i``, (n, n):
    what the equations have beside ``diag(s)`` in the coordinates of the modes.
    """
    size, n = seen.shape
    count = min(n, max(1, int(WORK / size**3)))
    unknown = np.full(count, np.inf)
    if not modes.defect < 1.0:
        return unknown, None
    M, K = descriptor.summed(lambda values: values.astype(np.longdouble), slopes)
    mass, pull = M.astype(np.float64), K.astype(np.float64)
    poles = modes.poles[:count]
    right = seen @ modes.right[:, :count]
    rows = modes.left[:count] @ charge
    largest = np.abs(rows).max(axis=1, keepdims=True)
    rows /= np.where(largest > 0.0, largest, 1.0)  # the size of a left vector says nothing
    aside = ASIDE * np.maximum(np.abs(poles), 1e-6 * np.abs(modes.poles).max(initial=0.0))
    pencils = (poles + aside)[:, None, None] * mass - pull
    scale = np.abs(pencils).max(axis=2, keepdims=True)
    scale[scale == 0.0] = 1.0
    try:
        turned = np.linalg.solve((pencils / scale).swapaxes(1, 2), rows[:, :, None])[:, :, 0]
    except np.linalg.LinAlgError:
        return unknown, None
    left = turned / scale[:, :, 0]
    v, w, s = (part.astype(np.clongdouble) for part in (right, left, poles))
    charged = M @ v
    missing = s * charged - K @ v
    sizes = np.abs(mass) @ np.abs(right) * np.abs(poles) + np.abs(pull) @ np.abs(right)
    norm = np.abs((w * charged.T).sum(axis=1))

    def bounded(residual: Floats, size: Floats) -> Floats:
        with np.errstate(divide="ignore", invalid="ignore"):
            found = (2.0 * residual + UNITS * EPS * size).T / norm
        bound: Floats = np.nan_to_num(np.asarray(found.T, dtype=np.float64), nan=np.inf)
        return bound

    own = bounded(np.abs((w * missing.T).sum(axis=1)), (np.abs(left) * sizes.T).sum(axis=1))
    bounds = np.where(modes.alone[:count], own, 0.0)
    if count < n or not modes.alone.all():
        return bounds, None
    return bounds, bounded(np.abs(w @ missing), np.abs(left) @ sizes)
