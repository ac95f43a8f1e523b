"""Follow a board with limited op-amps to its rest, where Newton's method alone finds none."""

from __future__ import annotations

import numpy as np

from taction.system.array_types import Floats
from taction.verification.engines.statespace.equations.amplifier_gains import gain_of
from taction.verification.engines.statespace.equations.descriptor import Descriptor

FIRST = 1e-3  # of the fastest time constant: the first step
GROWTH = 2.0
STEPS = 400
CORRECTIONS = 8  # of Newton's method in a step
ALIKE = 1e-9  # of the largest unknown: a correction that ends a step


def settled(descriptor: Descriptor, drive: Floats) -> Floats:
    """Return the unknowns, (size,), after implicit Euler steps from zero with growing lengths.

    A step whose corrections do not shrink is halved. The steps end where they are so long that
    the charges no longer count: near the equilibrium, which Newton's method then finds.
    """
    M, K = descriptor.dense.mass, descriptor.dense.stiffness
    weight, pull = np.abs(M).max(axis=1), np.abs(K).max(axis=1)
    fastest = float((pull[weight > 0.0] / weight[weight > 0.0]).max(initial=1.0))
    slowest = float((pull[weight > 0.0] / weight[weight > 0.0]).min(initial=1.0))
    z, step = np.zeros(descriptor.size), FIRST / fastest
    for _ in range(STEPS):
        following = _euler(descriptor, drive, z, step)
        if following is None:
            step *= 0.25
            continue
        z = following
        if step * slowest > 1e6:
            break
        step *= GROWTH
    return z


def _euler(descriptor: Descriptor, drive: Floats, z: Floats, step: float) -> Floats | None:
    """Return the unknowns one step later; None if Newton's method does not converge."""
    M, K, devices = descriptor.dense.mass, descriptor.dense.stiffness, descriptor.devices
    gain, x, before = gain_of(devices.kinds), z.copy(), np.inf
    for _ in range(CORRECTIONS):
        y = x[devices.input] / devices.v_scale
        F = K @ x + drive - M @ (x - z) / step
        F[devices.output] -= devices.u_scale * gain.outputs(y)
        J = M / step - K
        J[devices.output, devices.input] += devices.u_scale / devices.v_scale * gain.slope(y)
        if not np.all(np.isfinite(F)):
            return None
        scale = np.abs(J).max(axis=1)
        dx = np.linalg.solve(J / scale[:, None], F / scale)
        x = x + dx
        size = float(np.abs(dx).max()) / max(float(np.abs(x).max()), 1e-300)
        if size < ALIKE:
            return x
        if size > 2.0 * before:
            return None
        before = size
    return None
