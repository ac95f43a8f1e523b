"""Newton's method for the loop of behavioural amplifiers, ``y + H g(y) = a``.

A step is accepted if the correction that the same Jacobian finds after it is smaller (the natural
monotonicity test of Deuflhard, Newton Methods for Nonlinear Problems, section 3.3): a damping that
does not depend on the scales of the rows, of which some have a loop gain above 1e7. Steps are taken
in the safe coordinate ``q = y + diag(H) g(y)`` (see `amplifier_gains`).
"""

from __future__ import annotations

import numpy as np

from taction.system.array_types import Floats
from taction.system.errors import EngineError
from taction.verification.engines.statespace.equations.amplifier_gains import Gain

MAX_STEPS = 200
STAGES = 10.0 ** np.arange(0, -17, -2)  # of the homotopy: added diagonal feedback, times H
EXACT, STALLED = 1e-14, 1e-11  # residuals, of the terms of a row: at the end, and without progress
ENOUGH = 1e-3  # correction of y that is near a solution
LEAST_DAMPING = 1e-10


def solve_loop(H: Floats, a: Floats, gain: Gain, *, near: bool = False) -> tuple[Floats, int]:
    """Solve ``y + H g(y) = a``.

    Where the loop need not be monotone, as that of transistors around op-amps without limits, there
    may be several solutions. Then a homotopy leads to the one of a loop with more feedback.
    With `near` an end near a solution suffices, where rounding of H and a hides its last digits: it
    is a start for steps on all unknowns of the board.

    Parameters
    ----------
    H : ndarray (m, m)
        Dimensionless DC feedback.
    a : ndarray (m,)
        Inputs without feedback.

    Returns
    -------
    tuple of ndarray (m,) and int
        y, and the Newton steps taken.

    Raises
    ------
    EngineError
        The steps do not converge.
    """
    h = np.maximum(np.diag(H), 1e-12 * np.abs(H).max(initial=1e-300))
    y, steps, done = _newton(H, h, a, gain, a, near)
    if done and np.linalg.eigvals(np.eye(len(y)) + H * gain.slope(y)).real.min(initial=1.0) > 0.0:
        return y, steps
    q, rows = a, np.abs(H).sum(axis=1)
    for stage in (*STAGES, 0.0):
        extra = stage * rows
        y, taken, done = _newton(H + np.diag(extra), h + extra, a, gain, q, near)
        steps += taken
        q = y + (h + 1e-2 * extra) * gain.value(np.minimum(y, gain.upper))
    if done:
        return y, steps
    raise EngineError(
        f"no equilibrium found in {steps} Newton steps: the loop through the signal amplifiers has"
        " no bounded solution within the range of floats, or is not monotone"
    )


def _newton(
    H: Floats, h: Floats, a: Floats, gain: Gain, q: Floats, near: bool
) -> tuple[Floats, int, bool]:
    """Take steps in q from a start; return y, the steps, and whether they end at a solution."""
    weight = np.abs(H).sum(axis=1) + 1.0

    def residual(q: Floats) -> tuple[Floats, Floats, float]:
        """Return y, F, and the largest part of the terms of its row; infinite beyond floats."""
        y = gain.from_coordinate(q, h)
        with np.errstate(invalid="ignore", over="ignore"):
            g = gain.outputs(y)
            F = y + H @ g - a
            terms = np.abs(y) + np.abs(H) @ np.abs(g) + np.abs(a) + len(y)
            return y, F, float((np.abs(F) / terms).max()) if np.isfinite(terms).all() else np.inf

    y, F, left = residual(q)
    for step in range(MAX_STEPS):
        if left <= EXACT or left == np.inf:
            return y, step, left <= EXACT
        slope = gain.slope(y)
        share = 1.0 / (1.0 + h * slope)  # dy/dq
        try:
            inverse = np.linalg.inv((np.diag(share) + H * (slope * share)) / weight[:, None])
        except np.linalg.LinAlgError:
            return y, step, False
        dq = -inverse @ (F / weight)
        size, damping = float(np.linalg.norm(dq)), 1.0
        while True:
            trial = residual(q + damping * dq)
            if trial[2] < np.inf:
                following = float(np.linalg.norm(inverse @ (trial[1] / weight)))
                if following <= (1.0 - damping / 4.0) * size:
                    break
            damping *= 0.5
            if damping < LEAST_DAMPING:  # F is at its rounding
                close = np.all(np.abs(share * dq) <= ENOUGH * (1.0 + np.abs(y)))
                return y, step, left <= STALLED or (near and bool(close))
        q = q + damping * dq
        y, F, left = trial
    return y, MAX_STEPS, False
