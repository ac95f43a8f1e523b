"""Steps of one large board by all its unknowns, by solves with the structure of its equations."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np

from taction.system.array_types import Bools, Complexes, Floats, Ints
from taction.system.errors import EngineError
from taction.verification.engines.statespace.equations.structured_solve import Structure
from taction.verification.engines.statespace.linearised.board import LinearBoard
from taction.verification.engines.statespace.transients.radau import TABLE
from taction.verification.engines.statespace.transients.steps import (
    BEYOND,
    SIGMA,
    Amplifiers,
)

Solve = Callable[[Any], Any]  # of a right-hand side
INSTANT = 1e-9  # of the fastest time constant: a step without charge
SETTLING_STEPS = 50
SETTLED = 1e-12  # of the largest unknown: a correction that ends the search for the start
STALLED = 1e-9  # the same of a correction that does not shrink, which is rounding
KEPT = 12  # binary orders of length beside the present one: steps that stay prepared


@dataclass(eq=False)
class StructuredStep:
    """A step of one board, `Steps` of R = 1: solves with the amplifiers' slopes in the cells."""

    board: StructuredBoard
    count: int  # of amplifiers
    solvers: list[Solve]

    def _stages(self, rhs: Complexes) -> tuple[Floats, Complexes]:
        """Solve for right-hand sides (k, size); return inputs and watched nodes, and solutions."""
        x = [self.solvers[0](np.ascontiguousarray(rhs[0].real))]
        x += [solve(r) for solve, r in zip(self.solvers[1:], rhs[1:], strict=True)]
        solution = np.stack(x)
        return (TABLE.right @ solution[:, self.board.places]).real.T[None], solution

    def free(self, rate: Floats) -> tuple[Floats, Any]:
        """See `Steps`."""
        stages, x = self._stages(SIGMA[:, None] * rate)
        return stages[:, : self.count], [(stages, x)]

    def response(self, remainder: Floats, parts: Any) -> Floats:
        """See `Steps`."""
        rhs = np.zeros((len(self.solvers), self.board.unknowns), np.complex128)
        rhs[:, self.board.outputs] = TABLE.left @ remainder[0].T
        parts[1:] = [self._stages(rhs)]
        return np.asarray(parts[1][0][:, : self.count])

    def end(self, remainder: Floats, inputs: Floats, parts: Any) -> tuple[Complexes, Floats]:
        """See `Steps`."""
        stages, x = parts[0]
        for more, y in parts[1:]:
            stages, x = stages + more, x + y
        return x, stages

    def moved(self, parts: Complexes, weights: Complexes) -> Floats:
        """See `Steps`."""
        return np.asarray((weights[0] @ parts).real[None])


class StructuredBoard:
    """A board by all its unknowns, as `Boards` of R = 1; its prepared steps are kept.

    The watched voltages are the inputs of the amplifiers, then those of `nodes`.
    """

    def __init__(self, board: LinearBoard, nodes: tuple[str, ...]) -> None:
        self.descriptor, devices = board.descriptor, board.descriptor.devices
        self.count, self.unknowns = devices.count, board.descriptor.size
        self.structure, self.bare = board.structure, Structure(self.descriptor)
        self.drive, self.outputs = self.descriptor.drive(sources_on=True), devices.output
        watched = np.array([self.descriptor.place(name) for name in nodes], dtype=np.int64)
        self.places: Ints = np.concatenate([devices.input, watched])
        self.slopes, self.prepared = np.zeros(0), dict[float, StructuredStep]()
        self.factorisations = 0

    def part(self, rows: Ints) -> StructuredBoard:
        """See `Boards`."""
        return self

    def jumping(self, slopes: Floats) -> Bools:
        """See `Boards`: not looked for."""
        return np.zeros(1, dtype=np.bool_)

    def state(self, unknowns: Floats) -> Floats:
        """Return the state of all unknowns, which they are themselves."""
        return unknowns

    def rate(self, state: Floats, inputs: Floats, outputs: Floats) -> Floats:
        """See `Boards`."""
        return self._rate(state[0], outputs[0])[None]

    def _rate(self, state: Floats, outputs: Floats) -> Floats:
        rate = self.bare.stiffness_times(state) + self.drive
        rate[self.outputs] += outputs
        return np.asarray(rate)

    def start(self, state: Floats, amplifiers: Amplifiers) -> tuple[Floats, Floats]:
        """Return the state, and inputs and watched nodes, V, (m + K,), just after the strain step.

        By Newton's method on a step in which no charge moves. Unknowns without a charge jump, such
        as the difference of the inputs of an op-amp with an offset: the state just before the step
        has others than the voltages that the steps start from.

        Raises
        ------
        EngineError
            An amplifier is beyond the range of floats.
        """
        weight, m = self.structure.capacitance, self.count
        pull = abs(self.structure.local).max(axis=1).toarray().ravel()
        fastest = float((pull[weight > 0.0] / weight[weight > 0.0]).max(initial=1.0))
        now, before = state.copy(), math.inf
        for _ in range(SETTLING_STEPS):
            inputs = now[None, self.places[:m], None]
            slopes = amplifiers.slopes(inputs)[0, :, 0]
            outputs = amplifiers.outputs(inputs)[0, :, 0]
            if not (np.all(np.isfinite(slopes)) and np.all(np.isfinite(outputs))):
                break
            shift = fastest / INSTANT
            moved = shift * (self.structure.mass @ (now - state))
            structure = Structure(self.descriptor, slopes) if m else self.structure
            change = structure.factor(shift).solve(self._rate(now, outputs) - moved)
            now = now + change
            size = float(np.abs(change).max()) / max(float(np.abs(now).max()), 1e-300)
            # Below a correction that no longer shrinks there is only rounding.
            if size <= SETTLED or STALLED >= size >= 0.5 * before:
                return now, np.asarray(now[self.places])
            before = size
        raise EngineError(BEYOND)

    def step(self, length: Floats, slopes: Floats) -> StructuredStep:
        """See `Boards`."""
        (wanted,) = length.tolist()
        if not np.array_equal(slopes[0], self.slopes):
            self.slopes, self.prepared = slopes[0], {}
        if wanted not in self.prepared:
            far = 2.0**KEPT
            near = {h: each for h, each in self.prepared.items() if h / far <= wanted <= h * far}
            structure = Structure(self.descriptor, self.slopes) if self.count else self.structure
            solvers = [structure.solver(shift / wanted) for shift in TABLE.shifts.tolist()]
            self.prepared = near | {wanted: StructuredStep(self, self.count, solvers)}
            self.factorisations += len(TABLE.shifts)
        return self.prepared[wanted]
