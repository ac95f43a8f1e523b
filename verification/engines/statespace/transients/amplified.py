"""Transients of boards with behavioural (exponential) amplifiers: Radau IIA, exact Jacobian.

The board is reduced to its n states, ``x' = A x + B [on, 1] + E a``. The inputs a are the outputs
``-u_scale g(y)`` of the m amplifiers with ``y = v_in / v_scale``. The reported output of an
amplifier is g of the interpolated y, so a small u keeps its relative accuracy.

A large board is not reduced: it has index-1 equations, whose unknowns are all node voltages and
op-amp states, without any elimination. A rate costs four products of T with the stages, a
factorisation one structured factorisation for each shift (see `structured_solve`).
"""

from __future__ import annotations

import math
import time as clock
from collections.abc import Iterable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from taction.netlist_gen.analysis import Transient
from taction.netlist_gen.board.circuit import Circuit
from taction.system.array_types import Complexes, Floats, Indices
from taction.system.errors import DivergesError, EngineError
from taction.system.quantities import show
from taction.system.waveforms import Cost, Waveforms
from taction.verification.engines.statespace.equations.amplifier_gains import (
    LIMITER,
    OPAMP_KINDS,
    gain_of,
)
from taction.verification.engines.statespace.equations.structured_solve import Structure
from taction.verification.engines.statespace.linearised.board import LinearBoard, initial_unknowns
from taction.verification.engines.statespace.linearised.equilibrium import Equilibrium, solve_loop
from taction.verification.engines.statespace.transients.radau import Dense, Radau, Solve
from taction.verification.engines.statespace.transients.record_times import record_times

INSTANT = 1e-9  # of the fastest time constant: the settling time of the algebraic unknowns
SETTLING_STEPS = 50
STALLED = 1e-9  # of the largest unknown: a correction below it that does not shrink is rounding


class Wide:
    """One large board; `nodes` are reported."""

    def __init__(self, board: LinearBoard, nodes: tuple[str, ...]) -> None:
        self.board, self.descriptor = board, board.descriptor
        descriptor, self.devices = self.descriptor, self.descriptor.devices
        self.size = descriptor.size
        inner = [kind in OPAMP_KINDS for kind in self.devices.kinds]
        self.inner = self.devices.output[np.array(inner, dtype=np.bool_)]
        self.gain = gain_of(self.devices.kinds)
        self.structure = Structure(descriptor)
        self.drive = descriptor.drive(sources_on=True)
        places = [descriptor.place(name) for name in nodes]
        # The reported output of an amplifier is g of its interpolated input.
        device = {int(p): k for k, p in enumerate(self.devices.output)}
        self.source = np.array([device.get(p, -1) for p in places], dtype=np.int64)
        self.places = np.array(places, dtype=np.int64)
        outputs = self.source >= 0
        self.places[outputs] = self.devices.input[self.source[outputs]]

    def rate(self, z: Floats) -> Floats:
        """Return ``K z + b + f(z)``; not finite if an amplifier leaves the range of floats."""
        wide = z if z.ndim == 2 else z[:, None]
        rate = self.structure.local @ wide + self.drive[:, None]
        for part in self.descriptor.couplings:
            rate[part.sinks] += part.conductance @ wide[part.drivers]
            rate[part.drivers] += (part.conductance * part.loaded).T @ wide[part.sinks]
        y = wide[self.devices.input] / self.devices.v_scale[:, None]
        rate[self.devices.output] -= self.devices.u_scale[:, None] * self.gain.outputs(y)
        return np.asarray(rate.reshape(z.shape))

    def mass(self, z: NDArray[np.inexact]) -> NDArray[np.inexact]:
        """Return ``M z``."""
        return np.asarray(self.structure.mass @ z)

    def factor(self, z: Floats, shifts: Complexes) -> list[Solve]:
        """Return structured solvers of ``(shift M - K - f'(z)) x = r``."""
        y = z[self.devices.input] / self.devices.v_scale
        slopes = -self.devices.u_scale / self.devices.v_scale * self.gain.slope(y)
        if not self.descriptor.is_large:
            return [self._dense(shift, slopes) for shift in shifts.tolist()]
        structure = Structure(self.descriptor, slopes)
        solvers: list[Solve] = []
        for shift in shifts.tolist():
            if shift.imag == 0.0:
                real = structure.factor(shift.real).solve
                solvers.append(lambda r, real=real: real(np.ascontiguousarray(r.real)) + 0j)  # type: ignore[misc]
            else:
                solvers.append(structure.factor(shift).solve)
        return solvers

    def _dense(self, shift: complex, slopes: Floats) -> Solve:
        """Return a dense solver of a small board, whose structure costs more than it saves."""
        from scipy.linalg import lu_factor, lu_solve

        devices, board = self.devices, self.descriptor.dense
        matrix = (shift.real if shift.imag == 0.0 else shift) * board.mass - board.stiffness
        matrix[devices.output, devices.input] -= slopes
        scale, real = np.abs(matrix).max(axis=1), shift.imag == 0.0
        factor = lu_factor(matrix / scale[:, None], check_finite=False)

        def solve(r: Complexes) -> Complexes:
            rows = (np.stack([r.real, r.imag], axis=1) if real else r[:, None]) / scale[:, None]
            x = lu_solve(factor, rows, check_finite=False)
            return np.asarray(x[:, 0] + 1j * x[:, 1] if real else x[:, 0])

        return solve

    def watch(self, z: Floats) -> Floats:
        """Select the reported nodes, with amplifier inputs instead of amplifier outputs."""
        return z[self.places]

    def report(self, watched: Floats) -> Floats:
        """Return node voltages for watched values (P, K)."""
        voltages = watched.copy()
        for k in np.flatnonzero(self.source >= 0).tolist():
            device = self.source[k]
            y = watched[:, k] / self.devices.v_scale[device]
            gain = gain_of((self.devices.kinds[device],))
            voltages[:, k] = -self.devices.u_scale[device] * gain.outputs(y)
        return voltages

    def rates(self) -> Floats:
        """Return the rate of every row of M that is not empty, 1/s, 0 elsewhere; shape (size,)."""
        weight = self.structure.capacitance
        pull = abs(self.structure.local).max(axis=1).toarray().ravel()
        return np.where(weight > 0.0, pull / np.where(weight > 0.0, weight, 1.0), 0.0)

    def start(self, analysis: Transient) -> Floats:
        """Return consistent unknowns just after the strain step; EngineError without any."""
        z = initial_unknowns(self.board, analysis.initial, analysis.voltages)
        charge = self.mass(z).astype(np.float64)
        shift = float(self.rates().max(initial=1.0)) / INSTANT
        before = math.inf
        for _ in range(SETTLING_STEPS):
            rest = self.rate(z) - shift * (self.mass(z) - charge)
            if not np.all(np.isfinite(rest)):
                break
            solve = self.factor(z, np.array([shift], dtype=np.complex128))[0]
            dz = solve(rest.astype(np.complex128)).real
            z = z + dz
            size = float(np.abs(dz).max()) / max(float(np.abs(z).max()), 1e-300)
            # Below a correction that no longer shrinks there is only rounding.
            if size <= 1e-12 or STALLED >= size >= 0.5 * before:
                return z
            before = size
        raise EngineError("an amplifier is beyond the range of floats in the initial state")

    def magnitudes(self, rest: Equilibrium) -> Floats:
        """Return the magnitudes of the unknowns at an equilibrium, shape (size,)."""
        return np.abs(rest.values)

    def speed(self, z: Floats, floor: Floats) -> float:
        """Return the fastest relative rate of a charge, 1/s."""
        weight = self.structure.capacitance
        moving = weight > 0.0
        return float(np.max(np.abs(self.rate(z))[moving] / weight[moving] / floor[moving]))


METHOD = "Radau IIA"
TOLERANCE = 1e-9  # of a step, relative to each voltage's own scale
ESCAPED = 1e8  # of the board's largest voltage: a board above it has diverged, and the record ends
FIRST = 0.01  # largest change of an unknown in the first step, in its magnitude
FLOOR = 1e-3  # of the board's largest voltage: the error of a smaller unknown counts absolutely


class Amplified:
    """The reduced equations of a board with amplifiers, for `radau.Radau`.

    A rate costs one product with A (n² for every z), a factorisation one dense inverse of size n
    for each shift. `nodes` are reported.
    """

    def __init__(self, board: LinearBoard, nodes: tuple[str, ...]) -> None:
        self.board, self.nodes = board, nodes
        self.space = space = board.open_loop
        self.size, self.inner = space.n, np.zeros(0, dtype=np.int64)
        self.devices = space.descriptor.devices
        self.gain = gain_of(self.devices.kinds)
        on = np.ones(2)
        self.constant = space.B[:, :2] @ on
        self.E = space.B[:, 2:]
        v_scale = self.devices.v_scale[:, None]
        self.Cy = space.C[self.devices.input] / v_scale
        self.dy = space.D[self.devices.input, :2] @ on / v_scale[:, 0]
        self.H = space.D[self.devices.input, 2:] * self.devices.u_scale / v_scale
        self.direct = bool(np.any(self.H))
        self.C, D = space.rows(nodes)
        self.d, self.Da = D[:, :2] @ on, D[:, 2:]

    def inputs(self, x: Floats) -> Floats:
        """Return ``y = v_in / v_scale`` of every amplifier, shape (m,) or (m, s)."""
        y = self.Cy @ x + (self.dy if x.ndim == 1 else self.dy[:, None])
        if not self.direct:
            return np.asarray(y)
        if x.ndim == 1:
            return solve_loop(self.H, y, self.gain)[0]
        return np.stack([solve_loop(self.H, column, self.gain)[0] for column in y.T], axis=1)

    def outputs(self, y: Floats) -> Floats:
        """Return the amplifier voltages; not finite where y is beyond the range of floats."""
        value = self.gain.outputs(y)
        return -(self.devices.u_scale if y.ndim == 1 else self.devices.u_scale[:, None]) * value

    def rate(self, z: Floats) -> Floats:
        """Return the time derivative of the states."""
        a = self.outputs(self.inputs(z))
        if not np.all(np.isfinite(a)):
            return np.full(z.shape, np.inf)
        constant = self.constant if z.ndim == 1 else self.constant[:, None]
        return np.asarray(self.space.A @ z + constant + self.E @ a)

    def mass(self, z: NDArray[np.inexact]) -> NDArray[np.inexact]:
        """Return z: the mass matrix is the identity."""
        return z

    def jacobian(self, x: Floats) -> Floats:
        """Return the exact derivative of `rate`, shape (n, n)."""
        y = self.inputs(x)
        slope = self.gain.slope(y)
        # dy = Cy dx - H g'(y) dy
        feel = self.Cy
        if self.direct:
            feel = np.asarray(np.linalg.inv(np.eye(len(y)) + self.H * slope) @ self.Cy)
        return np.asarray(self.space.A - (self.E * (self.devices.u_scale * slope)) @ feel)

    def factor(self, z: Floats, shifts: Complexes) -> list[Solve]:
        """Invert ``shift - J`` for every shift."""
        J = self.jacobian(z)
        found: list[Solve] = []
        for shift in shifts.tolist():
            matrix = -J.astype(np.complex128) if shift.imag else -J
            matrix[np.diag_indices(self.size)] += shift if shift.imag else shift.real
            inverse = np.linalg.inv(matrix)
            found.append(lambda r, inverse=inverse: inverse @ r)  # type: ignore[misc]
        return found

    def watch(self, z: Floats) -> Floats:
        """Return the states' part of the reported nodes, then of the amplifiers' inputs."""
        return np.vstack([self.C, self.Cy]) @ z

    def report(self, watched: Floats) -> Floats:
        """Return node voltages for watched values (P, K + m), shape (P, K)."""
        K = len(self.nodes)
        y = watched[:, K:].T + self.dy[:, None]
        if self.direct:
            y = np.stack([solve_loop(self.H, column, self.gain)[0] for column in y.T], axis=1)
        return np.asarray(watched[:, :K] + self.d + self.outputs(y).T @ self.Da.T)

    def start(self, analysis: Transient) -> Floats:
        """Return the states just after the strain step, shape (n,)."""
        z = initial_unknowns(self.board, analysis.initial, analysis.voltages)
        return self.space.state_of(z)

    def magnitudes(self, rest: Equilibrium) -> Floats:
        """Return the magnitudes of the states at an equilibrium, shape (n,)."""
        return np.abs(self.space.state_of(rest.values))

    def speed(self, z: Floats, floor: Floats) -> float:
        """Return the fastest relative rate of a state, 1/s."""
        return float(np.max(np.abs(self.rate(z)) / floor, initial=0.0))


@dataclass(frozen=True, slots=True, eq=False)
class Curve:
    """Reported voltages of nodes (Q,) at instants (Q,), from the polynomials of the steps."""

    system: Amplified | Wide
    dense: Dense

    def __call__(self, times: Floats, columns: Indices) -> Floats:
        """Return voltages (Q,)."""
        instants, place = np.unique(times, return_inverse=True)
        return np.asarray(self.system.report(self.dense.at(instants))[place, columns])


def simulate(
    circuit: Circuit | LinearBoard,
    analysis: Transient,
    *,
    nodes: Iterable[str] | None = None,
    times: Floats | None = None,
    tolerance: float = TOLERANCE,
) -> Waveforms:
    """Simulate a transient of a board with behavioural amplifiers.

    Parameters
    ----------
    circuit, analysis, nodes, times
        See `simulate.simulate`; the error estimate controls the step.
    tolerance : float
        Relative, of one step.

    Returns
    -------
    Waveforms
        The record of a board that diverges ends early, beyond any physical bound.

    Raises
    ------
    DivergesError
        The board diverges before the last of `times`; the exception has the record.
    EngineError
        No equilibrium, no state space, or the solution leaves the range of floats.

    Notes
    -----
    A step costs about four Newton iterations of six products with A; a change of step or of the
    operating point costs one real and two complex inverses of size n (n = 91: 4 ms). Above
    `LARGE` unknowns both go through the board's structure.
    """
    began = clock.perf_counter()
    board = LinearBoard.of(circuit)
    wanted = board.reported(nodes)
    # A limited output current moves its own node, a loop without charge: `Wide` does not solve it
    # at every evaluation.
    looped = LIMITER in board.descriptor.devices.kinds
    system = (Wide if looped or board.descriptor.is_large else Amplified)(board, wanted)
    z = system.start(analysis)
    floor = voltage_floor(system.magnitudes(board.equilibrium), z, system.inner)
    largest = max(floor.max(initial=0.0), system.devices.u_scale.max(initial=0.0))
    limit = ESCAPED * float(largest)
    stop = analysis.stop if times is None else float(times[-1])
    speed = system.speed(z, floor)
    if not math.isfinite(speed):
        raise EngineError("an amplifier is beyond the range of floats in the initial state")
    first = min(FIRST / speed if speed > 0.0 else stop, stop)
    dense = Radau(system, z, tolerance, floor, first, limit).run(stop)
    diverges = f"the board diverges: it passes {limit:.3g} V at {show(dense.ends[-1], 's')}"
    instants = _instants(dense, analysis, times)
    values = system.report(dense.at(instants))
    if not np.all(np.isfinite(values)):
        raise EngineError("an amplifier left the range of floats between two steps")
    cost = Cost(clock.perf_counter() - began, dense.steps, dense.factorisations)
    blurred = f"rounding leaves up to {dense.rounding:.3g} V, in a step more than its tolerance"
    flags = (diverges,) * dense.escaped + (blurred,) * dense.coarse
    waveforms = Waveforms(
        instants, wanted, values, "statespace", cost, flags, dense.rounding,
        curve=Curve(system, dense), method=METHOD,
    )  # fmt: skip
    if times is not None and dense.escaped:
        raise DivergesError(diverges, waveforms)
    return waveforms


def _instants(dense: Dense, analysis: Transient, times: Floats | None) -> Floats:
    """Return the instants of the record, s: `times` as far as the board is followed."""
    if times is None:
        return record_times(analysis, dense.ends[-1])
    if dense.escaped:
        return np.append(times[times < dense.ends[-1]], dense.ends[-1])
    return times


def voltage_floor(rest: Floats, z: Floats, inner: Indices | None = None) -> Floats:
    """Return the magnitudes below which an unknown's error counts absolutely, V; (size,).

    The outputs `inner` of the amplifiers within op-amps are no voltages of the board: the clamp of
    an overdriven one is at 1e5 V. Their size is that of their own error only.
    """
    typical = np.maximum(rest, np.abs(z))
    largest = float((typical if inner is None else np.delete(typical, inner)).max(initial=0.0))
    return np.maximum(typical, FLOOR * (largest if largest > 0.0 else 1.0))
