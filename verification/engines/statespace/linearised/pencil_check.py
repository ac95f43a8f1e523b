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
) -> Floats:
    """Return bounds on the errors of the poles, (k,), rightmost first; 0 where modes are joined.

    `slopes` (m,) are the amplifiers', ``seen`` (size, n) the unknowns of the states, and `charge`
    (n, size) the states of the unknowns. The error of a pole s with the vectors w and v is, to
    first order, ``w (s M - K) v / w M v``.
    """
    size, n = seen.shape
    count = min(n, max(1, int(WORK / size**3)))
    if not modes.defect < 1.0:
        return np.full(count, np.inf)
    M, K = descriptor.summed(lambda values: values.astype(np.longdouble), slopes)
    mass, pull = M.astype(np.float64), K.astype(np.float64)
    poles = modes.poles[:count]
    right = seen @ modes.right[:, :count]
    rows = modes.left[:count] @ charge
    aside = ASIDE * np.maximum(np.abs(poles), 1e-6 * np.abs(modes.poles).max(initial=0.0))
    pencils = (poles + aside)[:, None, None] * mass - pull
    scale = np.abs(pencils).max(axis=2, keepdims=True)
    scale[scale == 0.0] = 1.0
    try:
        turned = np.linalg.solve((pencils / scale).swapaxes(1, 2), rows[:, :, None])[:, :, 0]
    except np.linalg.LinAlgError:
        return np.full(count, np.inf)
    left = turned / scale[:, :, 0]
    v, w, s = (part.astype(np.clongdouble) for part in (right, left, poles))
    charged = M @ v
    residual = np.abs((w * (s * charged - K @ v).T).sum(axis=1))
    sizes = np.abs(mass) @ np.abs(right) * np.abs(poles) + np.abs(pull) @ np.abs(right)
    rounding = UNITS * EPS * (np.abs(left) * sizes.T).sum(axis=1)
    with np.errstate(divide="ignore", invalid="ignore"):
        found = (2.0 * residual + rounding) / np.abs((w * charged.T).sum(axis=1))
    bounds = np.nan_to_num(found.astype(np.float64), nan=np.inf, posinf=np.inf)
    return np.where(modes.alone[:count], bounds, 0.0)
