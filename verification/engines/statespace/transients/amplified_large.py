"""Large boards with behavioural amplifiers, as index-1 equations for `radau.Radau`.

The unknowns are all node voltages and op-amp states; nothing is eliminated but through the
board's structure. A rate costs four products of T with the stages, a factorisation one structured
one per shift (see `structure`).
"""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from netlist_gen.analysis import Transient
from spice_models.array_types import Complexes, Floats
from spice_models.errors import EngineError
from verification.engines.statespace.equations.amplifier_gains import gain_of
from verification.engines.statespace.equations.structured_solve import Structure
from verification.engines.statespace.linearised.board import LinearBoard
from verification.engines.statespace.linearised.equilibrium import Equilibrium
from verification.engines.statespace.linearised.initial_state import initial_unknowns
from verification.engines.statespace.transients.radau import Solve

INSTANT = 1e-9  # of the fastest time constant: the time that algebraic unknowns get to settle
SETTLING_STEPS = 50
STALLED = 1e-9  # of the largest unknown: a correction below it that does not shrink is rounding


class Wide:
    """One large board.

    Parameters
    ----------
    board : LinearBoard
        It.
    nodes : tuple of str
        What to report.
    """

    def __init__(self, board: LinearBoard, nodes: tuple[str, ...]) -> None:
        self.board, self.descriptor = board, board.descriptor
        descriptor, self.devices = self.descriptor, self.descriptor.devices
        self.size = descriptor.size
        # a linear board has no amplifiers, so it does not matter which kind they are not
        self.gain = gain_of(self.devices.kind or "exponential")
        self.structure = Structure(descriptor)
        self.drive = descriptor.drive(sources_on=True)
        places = [descriptor.place(name) for name in nodes]
        # An amplifier's output is reported as g of its interpolated input.
        device = {int(p): k for k, p in enumerate(self.devices.output)}
        self.source = np.array([device.get(p, -1) for p in places], dtype=np.int64)
        self.places = np.array(places, dtype=np.int64)
        told = self.source >= 0
        self.places[told] = self.devices.input[self.source[told]]

    def rate(self, z: Floats) -> Floats:
        """``K z + b + f(z)``; not finite where an amplifier is beyond the range of floats."""
        wide = z if z.ndim == 2 else z[:, None]
        found = self.structure.local @ wide + self.drive[:, None]
        for part in self.descriptor.couplings:
            found[part.sinks] += part.conductance @ wide[part.drivers]
            found[part.drivers] += (part.conductance * part.loaded).T @ wide[part.sinks]
        y = wide[self.devices.input] / self.devices.v_scale[:, None]
        found[self.devices.output] -= self.devices.u_scale[:, None] * self._value(y)
        return np.asarray(found.reshape(z.shape))

    def _value(self, y: Floats) -> Floats:
        with np.errstate(over="ignore"):
            return self.gain.value(np.where(y > self.gain.upper, np.inf, y))

    def mass(self, z: NDArray[np.inexact]) -> NDArray[np.inexact]:
        """Return ``M z``."""
        return np.asarray(self.structure.mass @ z)

    def factor(self, z: Floats, shifts: Complexes) -> list[Solve]:
        """Structured solvers of ``(shift M - K - f'(z)) x = r``."""
        y = z[self.devices.input] / self.devices.v_scale
        slopes = -self.devices.u_scale / self.devices.v_scale * self.gain.slope(y)
        structure = Structure(self.descriptor, slopes)
        found: list[Solve] = []
        for shift in shifts.tolist():
            if shift.imag == 0.0:
                real = structure.factor(shift.real).solve
                found.append(lambda r, real=real: real(np.ascontiguousarray(r.real)) + 0j)  # type: ignore[misc]
            else:
                found.append(structure.factor(shift).solve)
        return found

    def watch(self, z: Floats) -> Floats:
        """Pick the reported nodes, and amplifier inputs in place of amplifier outputs."""
        return z[self.places]

    def report(self, watched: Floats) -> Floats:
        """Node voltages from watched values (P, K)."""
        found = watched.copy()
        for k in np.flatnonzero(self.source >= 0).tolist():
            device = self.source[k]
            y = watched[:, k] / self.devices.v_scale[device]
            found[:, k] = -self.devices.u_scale[device] * self._value(y)
        return found

    def rates(self) -> Floats:
        """Rate of every row of M that is not empty, 1/s; 0 elsewhere; shape (size,)."""
        weight = abs(self.structure.mass).max(axis=1).toarray().ravel()
        pull = abs(self.structure.local).max(axis=1).toarray().ravel()
        return np.where(weight > 0.0, pull / np.where(weight > 0.0, weight, 1.0), 0.0)

    def start(self, analysis: Transient) -> Floats:
        """Consistent unknowns just after the strain steps on.

        Raises
        ------
        EngineError
            No equilibrium to start from, or the amplifiers do not find their place.
        """
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
        """Magnitudes of the unknowns at an equilibrium, shape (size,)."""
        return np.abs(rest.values)

    def speed(self, z: Floats, floor: Floats) -> float:
        """Fastest relative rate of a charge, 1/s."""
        weight = abs(self.structure.mass).max(axis=1).toarray().ravel()
        moving = weight > 0.0
        return float(np.max(np.abs(self.rate(z))[moving] / weight[moving] / floor[moving]))
