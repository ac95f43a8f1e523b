"""Steps of one large board by all its unknowns, by solves with the structure of its equations."""

from __future__ import annotations

from typing import Any

import numpy as np

from taction.system.array_types import Complexes, Floats
from taction.system.errors import EngineError
from taction.verification.engines.statespace.equations.descriptor import Devices
from taction.verification.engines.statespace.equations.structured_solve import Structure
from taction.verification.engines.statespace.linearised.equilibrium import balance
from taction.verification.engines.statespace.linearised.linear_board import LinearBoard
from taction.verification.engines.statespace.transients.modal_steps import BEYOND
from taction.verification.engines.statespace.transients.radau import SIGMA, TABLE

INSTANT = 1e-9  # of the fastest time constant: a step without charge
SETTLING_STEPS = 50  # of Newton's method in it
ALIKE = 1e-9  # of the largest unknown: a correction that ends it


class StructuredBoard:
    """A board by all its unknowns, with the methods of `ModalBoard`.

    The watched voltages are the inputs of the amplifiers, then those of `nodes`.
    """

    def __init__(self, board: LinearBoard, nodes: tuple[str, ...]) -> None:
        self.descriptor, devices = board.descriptor, board.descriptor.devices
        self.count, self.structure = devices.count, board.structure
        outputs, others = devices.output.tolist(), map(self.descriptor.place, nodes)
        self.outputs, self.places = outputs, [*devices.input.tolist(), *others]
        self.drive = self.descriptor.drive(sources_on=True)
        self.prepared: tuple[float, bytes] | None = None
        self.solvers: list[Any] = []
        self.factorisations = 0

    def state(self, unknowns: Floats) -> Floats:
        """Return the state of all unknowns, which they are themselves."""
        return unknowns

    def jumping(self, slopes: Floats) -> bool:
        """See `ModalBoard`: not looked for."""
        return False

    def rate(self, state: Floats, inputs: Floats, outputs: Floats) -> Floats:
        """See `ModalBoard`."""
        rate = self.descriptor.stiffness_times(state) + self.drive
        rate[self.outputs] += outputs
        return np.asarray(rate)

    def start(self, state: Floats, devices: Devices) -> tuple[Floats, Floats]:
        """Return the state, and inputs and watched nodes, V, (m + K,), just after the strain step.

        In a step in which no charge moves, unknowns without a charge jump.

        EngineError: an amplifier is beyond the range of floats.
        """
        mass, now, size = self.structure.mass, state, np.inf
        weight, pull = (
            abs(part).max(axis=1).toarray().ravel() for part in (mass, self.structure.local)
        )
        rate = float((pull[weight > 0.0] / weight[weight > 0.0]).max(initial=1.0)) / INSTANT
        for _ in range(SETTLING_STEPS):
            with np.errstate(over="ignore", invalid="ignore"):
                slopes, F, _ = balance(self.descriptor, now)
                solve = Structure(self.descriptor, slopes).factor(rate)
                change = solve(F - rate * (mass @ (now - state)))
            now, before = now + change, size
            size = float(np.abs(change).max()) / max(float(np.abs(now).max()), 1e-300)
            if size < ALIKE or not size <= 2.0 * before:
                break
        watched = now[self.places]
        outputs = devices.outputs(watched[: self.count, None])
        if not (size < ALIKE and np.isfinite(outputs).all()):
            raise EngineError(BEYOND)
        return now, watched

    def prepare(self, length: float, slopes: Floats) -> None:
        """See `ModalBoard`."""
        wanted = length, slopes.tobytes()
        if wanted != self.prepared:
            structure = Structure(self.descriptor, slopes) if self.count else self.structure
            shifts = (TABLE.shifts / length).tolist()
            self.solvers, self.prepared = [structure.solver(shift) for shift in shifts], wanted
            self.factorisations += len(shifts)

    def _solved(self, rhs: Complexes) -> tuple[Floats, Complexes]:
        """Solve for right-hand sides (k, size); return inputs and watched nodes, and solutions."""
        x = [self.solvers[0](np.ascontiguousarray(rhs[0].real))]
        x += [solve(r) for solve, r in zip(self.solvers[1:], rhs[1:], strict=True)]
        solution = np.stack(x)
        return (TABLE.right @ solution[:, self.places]).real.T, solution

    def free(self, rate: Floats) -> tuple[Floats, Any]:
        """See `ModalBoard`."""
        stages, x = self._solved(SIGMA[:, None] * rate)
        return stages[: self.count], [(stages, x)]

    def response(self, remainder: Floats, parts: Any) -> Floats:
        """See `ModalBoard`."""
        rhs = np.zeros((len(self.solvers), self.descriptor.size), np.complex128)
        rhs[:, self.outputs] = TABLE.left @ remainder.T
        parts[1:] = [self._solved(rhs)]
        return np.asarray(parts[1][0][: self.count])

    def end(self, remainder: Floats, inputs: Floats, parts: Any) -> tuple[Complexes, Floats]:
        """See `ModalBoard`."""
        stages, x = parts[0]
        for more, y in parts[1:]:
            stages, x = stages + more, x + y
        return x, stages

    def moved(self, parts: Complexes, weights: Complexes) -> Floats:
        """See `ModalBoard`."""
        return np.asarray((weights @ parts).real)
