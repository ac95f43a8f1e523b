"""The DC equilibrium of a board: linear solve, or a globally convergent Newton method.

A step of Newton's method for the loop of behavioural amplifiers, ``y + H g(y) = a``, is accepted if
the correction that the same Jacobian finds after it is smaller (the natural monotonicity test of
Deuflhard, Newton Methods for Nonlinear Problems, section 3.3): a damping that does not depend on
the scales of the rows, of which some have a loop gain above 1e7. Steps are taken in the safe
coordinate ``q = y + diag(H) g(y)`` (see `amplifier_gains`).

A board with m behavioural amplifiers is a linear network with m nonlinear one-ports. The equation
of the ports is ``y + H g(y) = a`` with ``y = v_in / v_scale``: H is the DC gain from amplifier
outputs back to inputs, a the inputs due to the sources alone. H is nearly symmetric and positive
semidefinite (the network descends an energy), so the solution is unique, and Newton's method finds
it from any start.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from taction.system.array_types import EPS, Floats
from taction.system.errors import EngineError
from taction.verification.engines.statespace.equations.amplifier_gains import Gain
from taction.verification.engines.statespace.equations.descriptor import Descriptor
from taction.verification.engines.statespace.equations.structured_solve import Response, Structure

MAX_STEPS = 200
STAGES = 10.0 ** np.arange(0, -17, -2)  # of the homotopy: added diagonal feedback, times H
EXACT, STALLED = 1e-14, 1e-11  # residuals, of the terms of a row: at the end, and without progress
ENOUGH = 1e-3  # correction of y that is near a solution
DAMPINGS = 1e-3, 1e-10  # least ones of steps: before the homotopy, and in it
AT_ROUNDING = 0.01  # least damping of a step with a residual `STALLED`


def solve_loop(H: Floats, a: Floats, gain: Gain, *, near: bool = False) -> Floats:
    """Solve ``y + H g(y) = a``.

    Where the loop need not be monotone, as that of transistors around op-amps without limits, there
    may be several solutions. Then a homotopy leads to the one of a loop with more feedback.
    With `near` an end near a solution suffices: a start for steps on all unknowns of the board.
    H (m, m) is the DC feedback, a (m,) the inputs without it.

    EngineError: the steps do not converge.
    """
    h = np.maximum(np.diag(H), 1e-12 * np.abs(H).max(initial=1e-300))
    y, steps, done = _newton(H, h, a, gain, a, near, DAMPINGS[0])
    if done and np.linalg.eigvals(np.eye(len(y)) + H * gain.slope(y)).real.min(initial=1.0) > 0.0:
        return y
    q, rows = a, np.abs(H).sum(axis=1)
    for stage in (*STAGES, 0.0):
        extra = stage * rows
        y, taken, done = _newton(H + np.diag(extra), h + extra, a, gain, q, near, DAMPINGS[1])
        steps += taken
        q = y + (h + 1e-2 * extra) * gain.value(np.minimum(y, gain.upper))
    if done:
        return y
    raise EngineError(
        f"no equilibrium found in {steps} Newton steps: the loop through the signal amplifiers has"
        " no bounded solution within the range of floats, or is not monotone"
    )


def _newton(
    H: Floats, h: Floats, a: Floats, gain: Gain, q: Floats, near: bool, least: float
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
            if damping < (AT_ROUNDING if left <= STALLED else least):
                close = np.all(np.abs(share * dq) <= ENOUGH * (1.0 + np.abs(y)))
                return y, step, left <= STALLED or (near and bool(close))
        q = q + damping * dq
        y, F, left = trial
    return y, MAX_STEPS, False


POLISHING = 4  # Newton steps on all unknowns
POLISHED = 1e-13  # residual above which the last steps are taken on all unknowns
CERTIFICATE = 1e-9  # largest residual accepted, relative to the terms that cancel in it
# An unknown below this share of the largest counts as if it had it: where only rounding is left
# (a channel without strain), a residual of 64 units of rounding of the largest is accepted.
QUIET = 64 * EPS / CERTIFICATE
PROBES, SPREAD = 4, 4.0  # draws of the rounding, and how much more than the largest counts


@dataclass(frozen=True, slots=True, eq=False)
class Equilibrium:
    """The DC equilibrium of a board."""

    descriptor: Descriptor  # the solved equations
    values: Floats  # node voltages and op-amp states, V
    # (m,): ``d v_out / d v_in`` of each behavioural amplifier at the equilibrium, V/V (negative).
    slopes: Floats
    # Largest residual, relative to the terms that cancel in it, unknowns at least `QUIET`.
    residual: float

    @classmethod
    def at(cls, descriptor: Descriptor, z: Floats, sources_on: bool) -> Equilibrium:
        """Return the equilibrium z with its certificate."""
        slopes, F, terms = balance(descriptor, z, sources_on=sources_on)
        residual = np.max(np.abs(F) / np.where(terms > 0.0, terms, 1.0), initial=0.0)
        return cls(descriptor, z, slopes, float(residual))

    def __getitem__(self, name: str) -> float:
        """Return a node's voltage, V; 0 for ground."""
        return 0.0 if name == "0" else float(self.values[self.descriptor.place(name)])


@np.errstate(over="ignore", invalid="ignore")  # the residual judges what comes out
def solve_equilibrium(
    descriptor: Descriptor,
    response: Callable[[], Response],
    start: Floats | None = None,
    *,
    sources_on: bool = True,
) -> Equilibrium:
    """Find the DC equilibrium.

    `response` returns that of `structured_solve.dense_response`. A `start`, the equilibrium without
    the limits of the op-amps, is one or two steps away, unless the board rests beyond a limit.
    Without `sources_on` the strain currents are zero, but voltage sources stay on. The result
    contains its certificate (`residual`).

    EngineError: the input of an amplifier is beyond the range of floats, or the residual is above
      `CERTIFICATE`; a wrong equilibrium is never returned.
    """
    error: EngineError | None = None
    begins: list[Callable[[], Floats]] = [lambda: _by_loop(descriptor, response(), sources_on)]
    if start is not None:
        begins.insert(0, lambda: np.asarray(start))
    for begin in begins:
        try:
            z = begin()
        except EngineError as failed:
            error = failed
            continue
        found = Equilibrium.at(descriptor, z, sources_on)
        if descriptor.devices.count and not found.residual <= POLISHED:
            for _ in range(POLISHING):
                z = z + newton_step(descriptor, z, sources_on)
            found = Equilibrium.at(descriptor, z, sources_on)
        if not descriptor.devices.count or found.residual <= CERTIFICATE:
            return found
    raise error or EngineError(
        f"the equilibrium has a relative residual of {found.residual:.3g}, above {CERTIFICATE}"
    )


def _by_loop(descriptor: Descriptor, response: Response, sources_on: bool) -> Floats:
    """Return the unknowns of a solution of the loop of amplifiers, (size,)."""
    devices, (solve, columns) = descriptor.devices, response
    z = solve(-descriptor.drive(sources_on=sources_on))
    if not devices.count:
        return z
    gain = devices.gain
    H = columns[devices.input] * devices.u_scale / devices.v_scale[:, None]
    y = solve_loop(H, z[devices.input] / devices.v_scale, gain, near=True)
    z -= columns @ (devices.u_scale * gain.value(y))
    z[devices.input] = devices.v_scale * y
    z[devices.output] = -devices.u_scale * gain.value(y)
    return z


def newton_step(descriptor: Descriptor, z: Floats, sources_on: bool) -> Floats:
    """Return a Newton step on all unknowns at once.

    The gain of the loop magnifies rounding: successive steps reduce every row's residual to the
    rounding of its terms.
    """
    slopes, F, _ = balance(descriptor, z, sources_on=sources_on)
    return _solved(descriptor, slopes, F[:, None], np.abs(z))[:, 0]


def _solved(descriptor: Descriptor, slopes: Floats, F: Floats, size: Floats) -> Floats:
    """Solve ``(K + slopes) dz = -F``, F (size, Q), unknowns counted in their `size`."""
    if descriptor.is_large:
        return np.asarray(Structure(descriptor, slopes).factor(0.0)(F))
    J, row, column = scaled_jacobian(descriptor, slopes, size)
    return np.asarray(column * np.linalg.solve(J, -F / row))


def scaled_jacobian(
    descriptor: Descriptor, slopes: Floats, size: Floats
) -> tuple[Floats, Floats, Floats]:
    """Return ``(K + slopes) * column.T / row``, row and column, (size, 1) each.

    A column is the `size` of its unknown, (size,), and at least a trace of the largest; a row is
    the largest element that is left in it.
    """
    devices, K = descriptor.devices, descriptor.dense.stiffness.copy()
    K[devices.output, devices.input] += slopes
    column = np.maximum(size, 1e-12 * (size.max() or 1.0))
    K *= column
    row = np.abs(K).max(axis=1, keepdims=True)
    return K / row, row, column[:, None]


def rounding(rest: Equilibrium, response: Callable[[], Response]) -> Floats:
    """Return how far rounding of the stamped values moves each unknown, V; shape (size,).

    The rounding of every row, with signs drawn at random, through the linearised equations;
    `response` as in `solve_equilibrium`.
    """
    descriptor, z = rest.descriptor, rest.values
    terms = balance(descriptor, z)[2]
    draws = np.random.default_rng(1992).standard_normal((descriptor.size, PROBES))
    rows = EPS * terms[:, None] * draws
    if descriptor.devices.count:
        moved = _solved(descriptor, rest.slopes, rows, np.abs(z))
    else:
        moved = response()[0](rows)
    return np.asarray(SPREAD * np.abs(moved).max(axis=1))


def balance(
    descriptor: Descriptor, z: Floats, *, sources_on: bool = True
) -> tuple[Floats, Floats, Floats]:
    """Return the amplifiers' slopes at z, V/V, ``K z + b + f(z)``, and the sizes of its terms.

    In these, z is at least `QUIET`. The sum is zero at the equilibrium.
    """
    devices, f = descriptor.devices, np.zeros(descriptor.size)
    gain, drive = devices.gain, descriptor.drive(sources_on=sources_on)
    y = np.minimum(z[devices.input] / devices.v_scale, gain.upper)
    f[devices.output] = -devices.u_scale * gain.value(y)
    least = np.maximum(np.abs(z), QUIET * np.abs(z).max(initial=0.0))
    if descriptor.is_large:
        kept = descriptor.stiffness_times(z)
        size = descriptor.stiffness_times(least, magnitudes=True)
    else:
        K = descriptor.dense.stiffness
        kept, size = K @ z, np.abs(K) @ least
    slopes = -devices.u_scale / devices.v_scale * gain.slope(y)
    return slopes, kept + drive + f, size + np.abs(drive) + np.abs(f)
