"""Newton's method for ``y + H g(y) = a`` with a damping that does not depend on the rows' scales.

A step is accepted if the correction that the same Jacobian finds after it is smaller (the natural
monotonicity test of Deuflhard, Newton Methods for Nonlinear Problems, section 3.3). The sum of the
squares of F is dominated by the rows with the largest loop gain, and allows tiny steps only where
H is far from symmetric, as in the stages of transistors around op-amps with a gain above 1e7. There
the rounding of H and a also hides the last digits of y, so the result is only a start.
"""

from __future__ import annotations

import numpy as np

from taction.system.array_types import Floats
from taction.verification.engines.statespace.equations.amplifier_gains import Gain

MAX_STEPS = 100
ENOUGH = 1e-3  # last full correction of y, near enough for steps on all unknowns of the board
LEAST_DAMPING = 1e-10


def natural_newton(
    H: Floats, h: Floats, a: Floats, gain: Gain, q: Floats
) -> tuple[Floats, int, bool]:
    """Take steps in ``q = y + h g(y)`` from a start; return y, the steps, and whether it converged.

    The shapes of H, h, a and q are (m, m), (m,), (m,) and (m,).
    """
    weight = np.abs(H).sum(axis=1) + 1.0
    y, F = _residual(H, h, a, gain, q)
    for step in range(MAX_STEPS):
        if not np.all(np.isfinite(F)):
            return y, step, False
        slope = gain.slope(y)
        share = 1.0 / (1.0 + h * slope)  # dy/dq
        J = (np.diag(share) + H * (slope * share)) / weight[:, None]
        try:
            inverse = np.linalg.inv(J)
        except np.linalg.LinAlgError:
            return y, step, False
        dq = -inverse @ (F / weight)
        size, damping = float(np.linalg.norm(dq)), 1.0
        while True:
            y, F = _residual(H, h, a, gain, q + damping * dq)
            left = (
                float(np.linalg.norm(inverse @ (F / weight))) if np.all(np.isfinite(F)) else np.inf
            )
            if left <= (1.0 - damping / 4.0) * size:
                break
            damping *= 0.5
            if damping < LEAST_DAMPING:
                return y, step, False
        q = q + damping * dq
        if damping == 1.0 and np.all(np.abs(share * dq) <= ENOUGH * (1.0 + np.abs(y))):
            return y, step + 1, True
    return y, MAX_STEPS, False


def _residual(H: Floats, h: Floats, a: Floats, gain: Gain, q: Floats) -> tuple[Floats, Floats]:
    """Return y and F; F is not finite where y is beyond the range of floats."""
    y = gain.from_coordinate(q, h)
    with np.errstate(invalid="ignore"):
        return y, y + H @ gain.outputs(y) - a
