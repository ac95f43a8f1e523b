"""Steps of a board: of a small one in the basis of its modes, of a large one in all its unknowns.

A small board is linearised at its equilibrium, so in the basis of its modes its equations are

    z' = poles z + drive n + constant,    v = seen z + direct n + ...

with the remainders n of the amplifiers beyond their slopes at rest, and the systems of a step (see
`radau_integrator`) are divisions. A board without a basis of modes keeps its states, and has a
matrix in the place of poles. A large board has solves with the structure of its equations.
"""

from __future__ import annotations

from typing import Any

import numpy as np

from taction.system.array_types import Complexes, Floats
from taction.system.errors import EngineError
from taction.verification.engines.statespace.equations.descriptor import Devices
from taction.verification.engines.statespace.equations.structured_solve import Structure
from taction.verification.engines.statespace.linearised.equilibrium import balance, solve_loop
from taction.verification.engines.statespace.linearised.linear_board import LinearBoard
from taction.verification.engines.statespace.linearised.modes import Modes
from taction.verification.engines.statespace.linearised.state_space import StateSpace
from taction.verification.engines.statespace.transients.radau import SIGMA, TABLE

BEYOND = "an amplifier is beyond the range of floats in the initial state"
DEFECT = 1e-10  # of ``left right - 1``: with more, modes lose digits that solves keep
INSTANT = 1e-9  # of the fastest time constant: a step without charge
SETTLING_STEPS = 50  # of Newton's method in it
ALIKE = 1e-9  # of the largest unknown: a correction that ends it


def is_basis(modes: Modes) -> bool:
    """Whether the modes are a basis in which steps lose no digits."""
    return bool(modes.alone.all()) and modes.defect < DEFECT


class StateBoard:
    """A board by its states: ``x' = A x + B + E a``, ``y = C x + D + H a``.

    y are the inputs of the amplifiers, then other watched `nodes`. `core` are the four matrices,
    and `constant` the other terms of x', of the board with `slopes` (m,), V/V, in the place of its
    amplifiers. A `draw` that is not 0 moves every coefficient by the relative `rounding`: a slow
    mode beside fast ones has few digits in A, and a second run by the same matrices the same
    errors.
    """

    def __init__(
        self,
        space: StateSpace,
        nodes: tuple[str, ...],
        slopes: Floats,
        draw: int = 0,
        rounding: float = 0.0,
    ) -> None:
        places, random = space.descriptor.devices.input, np.random.default_rng([1992, draw])
        self.space, self.slopes, self.count = space, slopes, len(slopes)
        watched, direct = space.rows(nodes)
        D = np.concatenate([space.D[places], direct])

        def moved(values: Floats) -> Floats:
            if not draw:
                return values
            return values * (1.0 + rounding * random.choice([-1.0, 1.0], values.shape))

        self.A, self.B = moved(space.A), moved(space.B[:, :2].sum(axis=1))
        self.E, self.C = moved(space.B[:, 2:]), moved(np.concatenate([space.C[places], watched]))
        self.D, self.H = moved(D[:, :2].sum(axis=1)), D[:, 2:]
        loop = np.linalg.inv(np.eye(self.count) - self.H[: self.count] * slopes)
        closed = loop @ self.C[: self.count]
        beyond = np.eye(self.count) + slopes[:, None] * (loop @ self.H[: self.count])
        self.core = (
            self.A + (self.E * slopes) @ closed,
            self.E @ beyond,
            self.C + (self.H * slopes) @ closed,
            self.H @ beyond,
        )
        self.constant = self.B + (self.E * slopes) @ (loop @ self.D[: self.count])

    def start(self, unknowns: Floats, devices: Devices) -> tuple[Floats, Floats]:
        """See `StructuredBoard`."""
        state = self.space.state_of(unknowns)
        m, watched = self.count, self.C @ state + self.D
        inputs, H = watched[:m], self.H[:m]
        if H.any():
            scale = devices.v_scale
            loop = H * devices.u_scale / scale[:, None]
            inputs = scale * solve_loop(loop, inputs / scale, devices.gain)
        outputs = devices.outputs(inputs[:, None])[:, 0]
        if not np.all(np.isfinite(outputs)):
            raise EngineError(BEYOND)
        return state, np.append(inputs, (watched + self.H @ outputs)[m:])


def _systems(stages: Floats) -> Complexes:
    """Return the values of the method's systems (k, m) from those of the stages (m, s)."""
    return np.asarray(TABLE.left @ stages.T)


def _stages(systems: Complexes) -> Floats:
    """Return the values of the stages (m, s) from those of the method's systems (k, m)."""
    return np.asarray((TABLE.right @ systems).real.T)


class ModalBoard:
    """A board at its slopes at rest by its modes, if these are a basis, and its prepared step.

    The voltages of a mode are at most 1 V, so that its coordinate is about its share in volts.
    """

    factorisations = 1

    def __init__(self, board: StateBoard, modes: Modes | None) -> None:
        matrix, drive, seen, direct = board.core
        n, m = drive.shape
        if modes is None:
            left = right = np.eye(n, dtype=np.complex128)
            self.joined, self.mates = list(range(n)), np.arange(n)
        else:
            scale = np.abs(modes.right).max(axis=0)
            right, left = modes.right / scale, scale[:, None] * modes.left
            self.joined, self.mates = [], modes.mates
        turned = left @ matrix @ right
        self.poles = np.diagonal(turned).copy()
        self.poles[self.joined] = 0.0
        self.inner = turned[np.ix_(self.joined, self.joined)]
        self.slopes, self.left = board.slopes, left
        self.drive, self.constant = (left @ drive).T, left @ board.constant
        self.seen, self.direct, self.at_once = (seen @ right).T, direct.T, board.H[:m]
        self.length, self.at = 0.0, np.full(m, np.nan)
        self.change = np.zeros(m)  # slopes of the step minus those at rest, V/V

    def state(self, states: Floats) -> Complexes:
        """Return the coordinates of states (n,), (n,)."""
        return np.asarray(self.left @ states)

    def rate(self, state: Complexes, inputs: Floats, outputs: Floats) -> Complexes:
        """Return the rates of a state for inputs and outputs (m,) of the amplifiers."""
        moving = self.poles * state
        moving[self.joined] = self.inner @ state[self.joined]
        return np.asarray(moving + self.constant + (outputs - self.slopes * inputs) @ self.drive)

    def prepare(self, length: float, slopes: Floats) -> None:
        """Prepare a step of a length, s, at slopes (m,)."""
        m, longer = len(slopes), length != self.length
        if longer:
            shifts, one = TABLE.shifts / length, np.eye(len(self.joined))
            self.weight = 1.0 / (shifts[:, None] - self.poles)
            self.joint = np.linalg.inv(shifts[:, None, None] * one - self.inner)
            core = self._solved(self.drive[None]) @ self.seen[:, :m] + self.direct[:, :m]
            self.core, self.length = core.transpose(0, 2, 1), length
        if longer or not np.array_equal(slopes, self.at):
            self.at, self.change = slopes, slopes - self.slopes
            self.transfer = np.linalg.solve(np.eye(m) - self.core * self.change, self.core)

    def _solved(self, rows: Complexes) -> Complexes:
        """Solve the method's systems for right-hand sides (k or 1, q, n), (k, q, n)."""
        found = np.asarray(self.weight[:, None] * rows)
        if self.joined:
            found[..., self.joined] = rows[..., self.joined] @ self.joint.swapaxes(1, 2)
        return found

    def free(self, rate: Complexes) -> tuple[Floats, Complexes]:
        """Return the inputs' changes without remainders (m, s), and what `end` needs."""
        x = self._solved((SIGMA[:, None] * rate)[:, None])[:, 0]
        inputs = x @ self.seen[:, : len(self.at)]
        changed = (self.change * inputs)[..., None]
        return _stages(inputs + (self.transfer @ changed)[..., 0]), x

    def response(self, remainder: Floats, parts: Complexes) -> Floats:
        """Return what remainders (m, s) add to the inputs, (m, s)."""
        return _stages((self.transfer @ _systems(remainder)[..., None])[..., 0])

    def end(self, remainder: Floats, inputs: Floats, parts: Complexes) -> tuple[Complexes, Floats]:
        """Return what `moved` needs, and the changes of inputs and watched nodes (m + K, s)."""
        m = len(inputs)
        nu = _systems(remainder + self.change[:, None] * inputs)
        x = parts + self._solved((nu @ self.drive)[:, None])[:, 0]
        others = _stages(x @ self.seen[:, m:] + nu @ self.direct[:, m:])
        return x, np.concatenate([inputs, others])

    def moved(self, parts: Complexes, weights: Complexes) -> Complexes:
        """Return the change of the state up to where the systems have `weights` (k,)."""
        half = 0.5 * (weights @ parts)
        return np.asarray(half + half[self.mates].conj())

    def jumping(self, steepest: Floats) -> bool:
        """Return whether a board with straight pieces may have several voltages for a state.

        `steepest` (m,) are the largest slopes. A gain at once above a half can also keep the
        iterations at a break from converging, however short the step is.
        """
        loop = self.at_once * steepest
        return bool(np.abs(np.linalg.eigvals(loop)).max(initial=0.0) > 0.5)


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
