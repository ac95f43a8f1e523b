"""The DC equilibrium of a board: linear solve, or a globally convergent Newton method.

A board with m behavioural amplifiers is a linear network with m nonlinear one-ports. The equation
of the ports is ``y + H g(y) = a`` with ``y = v_in / v_scale``: H is the DC gain from amplifier
outputs back to inputs, a the inputs due to the sources alone. H is nearly symmetric and positive
semidefinite (the network descends an energy), so the solution is unique, and Newton's method damped
on ``|F|`` converges from any start in ``q = y + diag(H) g(y)`` (see `amplifier_gains`).
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from taction.system.array_types import EPS, Floats
from taction.system.errors import EngineError
from taction.verification.engines.statespace.equations.amplifier_gains import Gain, gain_of
from taction.verification.engines.statespace.equations.descriptor import Descriptor
from taction.verification.engines.statespace.equations.structured_solve import Response, Structure
from taction.verification.engines.statespace.linearised.natural_newton import natural_newton

MAX_STEPS = 200
STAGES = 10.0 ** np.arange(0, -17, -2)  # of the homotopy: added diagonal feedback, times H
POLISHING = 4  # Newton steps on all unknowns
POLISHED = 1e-13  # residual above which the last steps are taken on all unknowns
CERTIFICATE = 1e-9  # largest residual accepted, relative to the terms that cancel in it
# An unknown below this share of the largest counts as if it had it: where only rounding is left
# (a channel without strain), a residual of 64 units of rounding of the largest is accepted.
QUIET = 64 * EPS / CERTIFICATE
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


def solve_equilibrium(
    descriptor: Descriptor, response: Response, *, sources_on: bool = True
) -> Equilibrium:
    """Find the DC equilibrium.

    `response` is that of `dc_solve.dense_response`. Without `sources_on` the strain currents are
    zero, but voltage sources stay on. The result contains its certificate (`residual`).

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
    devices = descriptor.devices
    if not devices.count:
        return Equilibrium(descriptor, z, np.zeros(0), _residual(descriptor, z, drive), 0)
    gain = gain_of(devices.kinds)
    H = columns[devices.input] * devices.u_scale / devices.v_scale[:, None]
    y, steps = _near_solution(H, z[devices.input] / devices.v_scale, gain)
    z = solve(-drive) - columns @ (devices.u_scale * gain.value(y))
    z[devices.input] = devices.v_scale * y
    z[devices.output] = -devices.u_scale * gain.value(y)
    residual = _residual(descriptor, z, drive)
    if residual > POLISHED:
        z = _polish(descriptor, z, drive)
        y, residual = z[devices.input] / devices.v_scale, _residual(descriptor, z, drive)
    if not residual <= CERTIFICATE:
        message = f"the equilibrium has a relative residual of {residual:.3g}, above {CERTIFICATE}"
        raise EngineError(message)
    slopes = -devices.u_scale / devices.v_scale * gain.slope(y)
    return Equilibrium(descriptor, z, slopes, residual, steps)


def _near_solution(H: Floats, a: Floats, gain: Gain) -> tuple[Floats, int]:
    """Return ``y + H g(y) = a`` and the steps, near enough for `_polish`.

    Where rounding of H hides the end, steps of another damping go on from where each stage of the
    homotopy ended, the last one first: a start far from there may find another solution, as the
    loop of stages of transistors around op-amps without limits need not be monotone.
    """
    h, ends = coordinate(H), list[Floats]()
    for y, steps, done in _stages(H, h, a, gain):
        if done:
            return y, steps
        ends.append(y + h * gain.value(np.minimum(y, gain.upper)))
    for begin in (*reversed(ends), a, h * gain.value(np.zeros_like(a))):
        y, taken, done = natural_newton(H, h, a, gain, begin)
        if done:
            return y, steps + taken
    raise _no_equilibrium(steps)


def equilibrium_near(
    descriptor: Descriptor, z: Floats, *, sources_on: bool = True
) -> Equilibrium | None:
    """Return the equilibrium that Newton steps on all unknowns find from z, or None.

    From the equilibrium without the limits of the op-amps it takes one or two steps, unless the
    board rests beyond a limit.
    """
    drive, devices = descriptor.drive(sources_on=sources_on), descriptor.devices
    z = _polish(descriptor, z, drive)
    if not np.all(np.isfinite(z)):
        return None
    residual = _residual(descriptor, z, drive)
    if not residual <= CERTIFICATE:
        return None
    y = z[devices.input] / devices.v_scale
    slopes = -devices.u_scale / devices.v_scale * gain_of(devices.kinds).slope(y)
    return Equilibrium(descriptor, z, slopes, residual, POLISHING)


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


def _newton_step(descriptor: Descriptor, slopes: Floats, F: Floats, size: Floats) -> Floats:
    """Solve ``(K + slopes) dz = -F``, F (size, Q), the unknowns counted in their own `size`."""
    if descriptor.is_large:
        solve = Structure(descriptor, slopes).factor(0.0).solve
        return np.stack([np.asarray(solve(column)) for column in F.T], axis=1)
    devices, K = descriptor.devices, descriptor.dense.stiffness.copy()
    K[devices.output, devices.input] += slopes
    size = np.maximum(size, 1e-12 * (size.max() or 1.0))
    K *= size
    scale = np.abs(K).max(axis=1)
    return np.asarray(size[:, None] * np.linalg.solve(K / scale[:, None], -F / scale[:, None]))


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


def solve_loop(H: Floats, a: Floats, gain: Gain) -> tuple[Floats, int]:
    """Solve ``y + H g(y) = a`` by damped Newton steps, with a homotopy where these stall.

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
        A stage did not converge within `MAX_STEPS`.
    """
    for y, steps, done in _stages(H, coordinate(H), a, gain):
        if done:
            return y, steps
    raise _no_equilibrium(steps)


def _stages(H: Floats, h: Floats, a: Floats, gain: Gain) -> Iterator[tuple[Floats, int, bool]]:
    """Yield where Newton's steps end, all steps so far, and whether ``y + H g(y) = a`` there.

    First without homotopy, then each of its stages, the last of which is without it again.
    """
    y, steps, done = _newton(H, h, a, gain, a.copy())
    yield y, steps, done
    q, rows = a.copy(), np.abs(H).sum(axis=1)
    for stage in (*STAGES, 0.0):
        extra = stage * rows
        y, taken, done = _newton(H + np.diag(extra), h + extra, a, gain, q)
        steps += taken
        yield y, steps, done and stage == 0.0
        q = y + (h + 1e-2 * extra) * gain.value(np.minimum(y, gain.upper))


def _no_equilibrium(steps: int) -> EngineError:
    return EngineError(
        f"no equilibrium found in {steps} Newton steps: the loop through the signal amplifiers has"
        " no bounded solution within the range of floats, or is not monotone"
    )


def coordinate(H: Floats) -> Floats:
    """Return the h of the safe coordinate ``q = y + h g(y)``, (m,)."""
    return np.asarray(np.maximum(np.diag(H), 1e-12 * np.abs(H).max(initial=1e-300)))


def _newton(H: Floats, h: Floats, a: Floats, gain: Gain, q: Floats) -> tuple[Floats, int, bool]:
    """Damp Newton's method on |F| in q; return whether F is below the rounding of its terms."""

    def evaluate(q: Floats) -> tuple[Floats, Floats, float, bool]:
        y = gain.from_coordinate(q, h)
        with np.errstate(over="ignore"):
            g = gain.value(y)
        if np.any(y > gain.upper) or not np.all(np.isfinite(g)):
            return y, np.full_like(y, np.inf), np.inf, False
        F = y + H @ g - a
        terms = np.abs(y) + np.abs(H) @ g + np.abs(a)
        return y, F, float(F @ F), bool(np.all(np.abs(F) <= 1e-14 * (terms + len(y))))

    y, F, merit, done = evaluate(q)
    for step in range(MAX_STEPS):
        if done or not np.isfinite(merit):
            return y, step, done
        slope = gain.slope(y)
        share = 1.0 / (1.0 + h * slope)  # dy/dq
        J = np.diag(share) + H * (slope * share)
        dq = np.linalg.lstsq(J, -F, rcond=None)[0]
        damping = 1.0
        while damping > 1e-14:
            trial = evaluate(q + damping * dq)
            if trial[2] < (1.0 - 1e-4 * damping) * merit or trial[3]:
                break
            damping *= 0.5
        else:
            # F is at its rounding: it no longer decreases along an exact Newton direction.
            terms = np.abs(y) + np.abs(H) @ gain.value(y) + np.abs(a)
            return y, step, bool(np.all(np.abs(F) <= 1e-11 * (terms + len(y))))
        q = q + damping * dq
        y, F, merit, done = trial
    return y, MAX_STEPS, False
