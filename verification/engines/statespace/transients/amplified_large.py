"""Large boards with behavioural amplifiers, as index-1 equations for `radau.Radau`.

The unknowns are all node voltages and op-amp states, without any elimination. A rate costs four
products of T with the stages, a factorisation one structured factorisation for each shift (see
`structured_solve`).
"""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from taction.netlist_gen.analysis import Transient
from taction.system.array_types import Complexes, Floats
from taction.system.errors import EngineError
from taction.verification.engines.statespace.equations.amplifier_gains import gain_of
from taction.verification.engines.statespace.equations.structured_solve import Structure
from taction.verification.engines.statespace.linearised.board import LinearBoard
from taction.verification.engines.statespace.linearised.equilibrium import Equilibrium
from taction.verification.engines.statespace.linearised.initial_state import initial_unknowns
from taction.verification.engines.statespace.transients.radau import Solve

INSTANT = 1e-9  # of the fastest time constant: the settling time of the algebraic unknowns
SETTLING_STEPS = 50
STALLED = 1e-9  # of the largest unknown: a correction below it that does not shrink is rounding


class Wide:
    """One large board; `nodes` are reported."""

    def __init__(self, board: LinearBoard, nodes: tuple[str, ...]) -> None:
        self.board, self.descriptor = board, board.descriptor
        descriptor, self.devices = self.descriptor, self.descriptor.devices
        self.size = descriptor.size
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
