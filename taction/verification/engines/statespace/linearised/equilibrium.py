"""The DC equilibrium of a board: linear solve, or a globally convergent Newton method.

A board with m behavioural amplifiers is a linear network with m nonlinear one-ports. The equation
of the ports is ``y + H g(y) = a`` with ``y = v_in / v_scale``: H is the DC gain from amplifier
outputs back to inputs, a the inputs due to the sources alone. H is nearly symmetric and positive
semidefinite (the network descends an energy), so the solution is unique, and `loop_newton` finds it
from any start.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from taction.system.array_types import EPS, Floats
from taction.system.errors import EngineError
from taction.verification.engines.statespace.equations.amplifier_gains import gain_of
from taction.verification.engines.statespace.equations.descriptor import Descriptor
from taction.verification.engines.statespace.equations.structured_solve import Response, Structure
from taction.verification.engines.statespace.linearised.loop_newton import solve_loop

POLISHING = 4  # Newton steps on all unknowns
POLISHED = 1e-13  # residual above which the last steps are taken on all unknowns
CERTIFICATE = 1e-9  # largest residual accepted, relative to the terms that cancel in it
# An unknown below this share of the largest counts as if it had it: where only rounding is left
# (a channel without strain), a residual of 64 units of rounding of the largest is accepted.
QUIET = 64 * EPS / CERTIFICATE
FIRST = 1e-3  # of the fastest time constant: the first step in time
GROWTH = 2.0
STEPS = 400
CORRECTIONS = 8  # of Newton's method in a step
ALIKE = 1e-9  # of the largest unknown: a correction that ends a step
PROBES, SPREAD = 4, 4.0  # draws of the rounding, and how much more than the largest counts


@dataclass(frozen=True, slots=True, eq=False)
class Equilibrium:
    """The DC equilibrium of a board.

    Attributes
    ----------
    descriptor : Descriptor
        The solved equations.
    values : ndarray (size,)
        Node voltages and op-amp states, V.
    slopes : ndarray (m,)
        ``d v_out / d v_in`` of each behavioural amplifier at the equilibrium, V/V (negative).
    residual : float
        Largest residual, relative to the terms that cancel in it, unknowns at least `QUIET`.
    steps : int
        Newton steps; 0 for a linear board.
    """

    descriptor: Descriptor
    values: Floats
    slopes: Floats
    residual: float
    steps: int

    def __getitem__(self, name: str) -> float:
        """Return a node's voltage, V; 0 for ground."""
        return 0.0 if name == "0" else float(self.values[self.descriptor.place(name)])


@np.errstate(over="ignore", invalid="ignore")  # the residual judges what comes out
def solve_equilibrium(
    descriptor: Descriptor, response: Response, *, sources_on: bool = True
) -> Equilibrium:
    """Find the DC equilibrium.

    `response` is that of `structured_solve.dense_response`. Without `sources_on` the strain
    currents are zero, but voltage sources stay on. The result contains its certificate
    (`residual`).

    Raises
    ------
    EngineError
        The input of an amplifier is beyond the range of floats, or the residual is above
        `CERTIFICATE`; a wrong equilibrium is never returned.

    Notes
    -----
    Costs one dense factorisation of size m per Newton step.
    """
    drive, (solve, columns) = descriptor.drive(sources_on=sources_on), response
    z = solve(-drive)
    devices, steps = descriptor.devices, 0
    if devices.count:
        gain = gain_of(devices.kinds)
        H = columns[devices.input] * devices.u_scale / devices.v_scale[:, None]
        y, steps = solve_loop(H, z[devices.input] / devices.v_scale, gain, near=True)
        z -= columns @ (devices.u_scale * gain.value(y))
        z[devices.input] = devices.v_scale * y
        z[devices.output] = -devices.u_scale * gain.value(y)
        if _residual(descriptor, z, drive) > POLISHED:
            z = _polish(descriptor, z, drive)
    found = _found(descriptor, z, drive, steps)
    if devices.count and not found.residual <= CERTIFICATE:
        raise EngineError(
            f"the equilibrium has a relative residual of {found.residual:.3g}, above {CERTIFICATE}"
        )
    return found


def _found(descriptor: Descriptor, z: Floats, drive: Floats, steps: int) -> Equilibrium:
    slopes, _ = _linearised(descriptor, z, drive)
    return Equilibrium(descriptor, z, slopes, _residual(descriptor, z, drive), steps)


def limited_equilibrium(
    descriptor: Descriptor, z: Floats, *, sources_on: bool
) -> Equilibrium | None:
    """Return the equilibrium with limits of op-amps near that without them, or None.

    A small board that rests beyond a limit is followed in time from zero.
    """
    near = equilibrium_near(descriptor, z, sources_on=sources_on)
    if near is None and not descriptor.is_large:
        there = _settled(descriptor, descriptor.drive(sources_on=sources_on))
        near = equilibrium_near(descriptor, there, sources_on=sources_on)
    return near


@np.errstate(over="ignore", invalid="ignore")  # the residual judges what comes out
def equilibrium_near(
    descriptor: Descriptor, z: Floats, *, sources_on: bool = True
) -> Equilibrium | None:
    """Return the equilibrium that Newton steps on all unknowns find from z, or None.

    From the equilibrium without the limits of the op-amps it takes one or two steps, unless the
    board rests beyond a limit.
    """
    drive = descriptor.drive(sources_on=sources_on)
    z = _polish(descriptor, z, drive)
    if not np.all(np.isfinite(z)):
        return None
    found = _found(descriptor, z, drive, POLISHING)
    return found if found.residual <= CERTIFICATE else None


@np.errstate(over="ignore", invalid="ignore")  # the residual judges what comes out
def _settled(descriptor: Descriptor, drive: Floats) -> Floats:
    """Return the unknowns, (size,), after implicit Euler steps from zero with growing lengths.

    A step whose corrections do not shrink is halved. The steps end where they are so long that
    the charges no longer count: near the equilibrium, which Newton's method then finds.
    """
    M, K = descriptor.dense.mass, descriptor.dense.stiffness
    weight, pull = np.abs(M).max(axis=1), np.abs(K).max(axis=1)
    rates = pull[weight > 0.0] / weight[weight > 0.0]
    slowest = float(rates.min(initial=1.0))
    z, step = np.zeros(descriptor.size), FIRST / float(rates.max(initial=1.0))
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
    mass, x, before = descriptor.dense.mass / step, z, np.inf
    for _ in range(CORRECTIONS):
        slopes, F = _linearised(descriptor, x, drive)
        F -= mass @ (x - z)
        if not np.all(np.isfinite(F)):
            return None
        dx = _newton_step(descriptor, slopes, F[:, None], np.abs(x), mass)[:, 0]
        x = x + dx
        size = float(np.abs(dx).max()) / max(float(np.abs(x).max()), 1e-300)
        if size < ALIKE:
            return x
        if size > 2.0 * before:
            return None
        before = size
    return None


def tangent(descriptor: Descriptor, z: Floats, *, sources_on: bool = True) -> Equilibrium:
    """Return where a board would rest if its amplifiers were the tangents that they have at z.

    Raises
    ------
    EngineError
        That linear board has no equilibrium.
    """
    slopes, F = _linearised(descriptor, z, descriptor.drive(sources_on=sources_on))
    try:
        step = _newton_step(descriptor, slopes, F[:, None], np.abs(z))[:, 0]
    except np.linalg.LinAlgError as error:
        raise EngineError("the board with the slopes of its start has no equilibrium") from error
    return Equilibrium(descriptor, z + step, slopes, 0.0, 1)


def _linearised(descriptor: Descriptor, z: Floats, drive: Floats) -> tuple[Floats, Floats]:
    """Return the amplifiers' slopes at z, V/V, and what the equations lack there, (size,)."""
    devices = descriptor.devices
    gain = gain_of(devices.kinds)
    y = np.minimum(z[devices.input] / devices.v_scale, gain.upper)
    F = descriptor.stiffness_times(z) + drive
    F[devices.output] -= devices.u_scale * gain.value(y)
    return -devices.u_scale / devices.v_scale * gain.slope(y), F


def _polish(descriptor: Descriptor, z: Floats, drive: Floats) -> Floats:
    """Take Newton steps on all unknowns at once, since the gain of the loop magnifies rounding.

    Successive corrections of z reduce every row's residual to the rounding of its terms.
    """
    for _ in range(POLISHING):
        slopes, F = _linearised(descriptor, z, drive)
        z = z + _newton_step(descriptor, slopes, F[:, None], np.abs(z))[:, 0]
    return z


def _newton_step(
    descriptor: Descriptor, slopes: Floats, F: Floats, size: Floats, mass: Floats | float = 0.0
) -> Floats:
    """Solve ``(K + slopes - mass) dz = -F``, F (size, Q), the unknowns counted in their `size`."""
    if descriptor.is_large:
        solve = Structure(descriptor, slopes).factor(0.0).solve
        return np.stack([np.asarray(solve(column)) for column in F.T], axis=1)
    J, row, column = scaled_jacobian(descriptor, slopes, size, mass)
    return np.asarray(column * np.linalg.solve(J, -F / row))


def scaled_jacobian(
    descriptor: Descriptor, slopes: Floats, size: Floats, mass: Floats | float = 0.0
) -> tuple[Floats, Floats, Floats]:
    """Return ``(K + slopes - mass) * column.T / row``, row and column, (size, 1) each.

    A column is the `size` of its unknown, (size,), and at least a trace of the largest; a row is
    the largest element that is left in it.
    """
    devices, K = descriptor.devices, descriptor.dense.stiffness - mass
    K[devices.output, devices.input] += slopes
    column = np.maximum(size, 1e-12 * (size.max() or 1.0))
    K *= column
    row = np.abs(K).max(axis=1, keepdims=True)
    return K / row, row, column[:, None]


def _residual(descriptor: Descriptor, z: Floats, drive: Floats) -> float:
    """Largest ``|K z + b + f|`` relative to the terms of its row, z at least `QUIET`."""
    kept, terms = _cancelling(descriptor, z, drive)
    return float(np.max(np.abs(kept) / np.where(terms > 0.0, terms, 1.0), initial=0.0))


def rounding(rest: Equilibrium) -> Floats:
    """Return how far rounding of the stamped values moves each unknown, V; shape (size,)."""
    descriptor, z = rest.descriptor, rest.values
    terms = _cancelling(descriptor, z, descriptor.drive(sources_on=True))[1]
    return moved_by_rounding(rest, terms)


def moved_by_rounding(rest: Equilibrium, terms: Floats) -> Floats:
    """Return how far rounding of the `terms` that cancel in each row moves the unknowns, V.

    Both have the shape (size,).
    """
    descriptor, z = rest.descriptor, rest.values
    # The rounding of every row, with signs drawn at random, through the linearised equations.
    draws = np.random.default_rng(1992).standard_normal((descriptor.size, PROBES))
    noise = EPS * terms[:, None] * draws
    moved = _newton_step(descriptor, rest.slopes, noise, np.abs(z))
    return np.asarray(SPREAD * np.abs(moved).max(axis=1))


def balance(descriptor: Descriptor, z: Floats) -> Floats:
    """Return ``K z + b + f(z)`` with the sources on, (size,): zero at the equilibrium."""
    return _cancelling(descriptor, z, descriptor.drive(sources_on=True))[0]


def _cancelling(descriptor: Descriptor, z: Floats, drive: Floats) -> tuple[Floats, Floats]:
    """Return ``K z + b + f`` and the magnitudes that cancel in its rows, z at least `QUIET`."""
    f = np.zeros(descriptor.size)
    devices = descriptor.devices
    if devices.count:
        value = gain_of(devices.kinds).value(z[devices.input] / devices.v_scale)
        f[devices.output] = -devices.u_scale * value
    least = np.maximum(np.abs(z), QUIET * np.abs(z).max(initial=0.0))
    if descriptor.is_large:
        kept = descriptor.stiffness_times(z)
        size = descriptor.stiffness_times(least, magnitudes=True)
    else:
        K = descriptor.dense.stiffness
        kept, size = K @ z, np.abs(K) @ least
    return kept + drive + f, size + np.abs(drive) + np.abs(f)
