"""Steps of small boards in the basis of their modes, where they have one.

The boards are linearised at their equilibria, so in this basis their equations are

    z' = poles z + drive n + constant,    v = seen z + direct n + ...

with the remainders n of the amplifiers beyond their slopes at rest, and the systems of a step (see
`integrator`) are divisions. Boards without a basis of modes keep their states, and have a matrix in
the place of poles. Every board may have a length of step and slopes of its own.
"""

from __future__ import annotations

import numpy as np

from taction.system.array_types import Bools, Complexes, Floats
from taction.system.errors import EngineError
from taction.verification.engines.statespace.linearised.equilibrium import solve_loop
from taction.verification.engines.statespace.linearised.modes import Modes
from taction.verification.engines.statespace.linearised.state_space import StateSpace
from taction.verification.engines.statespace.transients.radau import SIGMA, TABLE
from taction.verification.engines.statespace.transients.straight_pieces import (
    BEYOND,
    Amplifiers,
    Batch,
)

DEFECT = 1e-10  # of ``left right - 1``: with more, modes lose digits that solves keep


def is_basis(modes: Modes) -> bool:
    """Whether the modes are a basis in which steps lose no digits."""
    return bool(modes.alone.all()) and modes.defect < DEFECT


class StateBoard:
    """A board by its states: ``x' = A x + B + E a``, ``y = C x + D + H a``.

    y are the inputs of the amplifiers, then other watched nodes. `core` are the four matrices, and
    `constant` the other terms of x', of the board with `slopes` in the place of its amplifiers.

    `space`: its states, with the outputs of the amplifiers as inputs.
    `nodes`: the other watched nodes.
    `slopes` (m,): of the amplifiers, V/V.
    `draw`: if not 0, every coefficient is moved by this draw of the relative `rounding`. A slow
      mode beside fast ones has few digits in A: a second run by the same matrices has the same
      errors, one by these shows them.
    `rounding`: see `draw`.
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

    def state(self, unknowns: Floats) -> Floats:
        """Return the states of all unknowns, (n,)."""
        return self.space.state_of(unknowns)

    def start(self, state: Floats, amplifiers: Amplifiers) -> tuple[Floats, Floats]:
        """See `StructuredBoard`."""
        m, watched = self.count, self.C @ state + self.D
        inputs, H = watched[:m], self.H[:m]
        if H.any():
            scale = amplifiers.v_scale[0, :, 0]
            loop = H * amplifiers.u_scale[0, :, 0] / scale[:, None]
            inputs = scale * solve_loop(loop, inputs / scale, amplifiers.gain)[0]
        outputs = amplifiers.outputs(inputs[None, :, None])[0, :, 0]
        if not np.all(np.isfinite(outputs)):
            raise EngineError(BEYOND)
        return state, np.append(inputs, (watched + self.H @ outputs)[m:])


def _systems(stages: Floats) -> Complexes:
    """Return the values of the method's systems (R, k, m) from those of the stages (R, m, s)."""
    return np.asarray(TABLE.left @ stages.transpose(0, 2, 1))


def _stages(systems: Complexes) -> Floats:
    """Return the values of the stages (R, m, s) from those of the method's systems (R, k, m)."""
    return np.asarray((TABLE.right @ systems).real.transpose(0, 2, 1))


class ModalBoards(Batch):
    """Boards by their modes, and their prepared steps.

    Those that are joined have as many states, amplifiers and watched nodes. The voltages of a mode
    are at most 1 V, so that its coordinate is about its share in volts.

    `board`: one board at its slopes at rest.
    `modes`: of the same board; None where they are no basis.
    """

    factorisations = 1

    def __init__(self, board: StateBoard, modes: Modes | None) -> None:
        matrix, drive, seen, direct = board.core
        n, m = drive.shape
        if modes is None:
            left = right = np.eye(n, dtype=np.complex128)
            self.joined, mates = list(range(n)), np.arange(n)
        else:
            scale = np.abs(modes.right).max(axis=0)
            right, left = modes.right / scale, scale[:, None] * modes.left
            self.joined, mates = [], modes.mates
        turned = left @ matrix @ right
        poles, inner = np.diagonal(turned).copy(), turned[np.ix_(self.joined, self.joined)]
        poles[self.joined] = 0.0
        self.mates, self.poles, self.inner = mates[None], poles[None, None], inner[None, None]
        self.slopes, self.left = board.slopes[None], left[None]
        self.drive, self.constant = (left @ drive).T[None], (left @ board.constant)[None]
        self.seen, self.direct = (seen @ right).T[None], direct.T[None]
        self.at_once = board.H[:m][None]
        self.length, self.at = np.zeros(1), np.full((1, m), np.nan)
        self.change = np.zeros((1, m))  # slopes of the step minus those at rest, V/V

    def state(self, states: Floats) -> Complexes:
        """Return the coordinates of states (R, n), (R, n)."""
        return np.asarray((self.left @ states[..., None])[..., 0])

    def _times(self, poles: Complexes, inner: Complexes, rows: Complexes) -> Complexes:
        """Multiply vectors (R, k or 1, q, n) by diagonal (R, k, n) and joined part of a matrix."""
        found = np.asarray(poles[:, :, None, :] * rows)
        if self.joined:
            found[..., self.joined] = rows[..., self.joined] @ inner.swapaxes(-1, -2)
        return found

    def rate(self, state: Complexes, inputs: Floats, outputs: Floats) -> Complexes:
        """Return the rates of states for inputs and outputs (R, m) of the amplifiers."""
        remainder = (outputs - self.slopes * inputs)[:, None, :]
        moving = self._times(self.poles, self.inner, state[:, None, None, :])[:, 0, 0]
        return np.asarray(moving + self.constant + (remainder @ self.drive)[:, 0])

    def prepare(self, length: Floats, slopes: Floats) -> None:
        """Prepare a step of each board, of lengths (R,), s, at slopes (R, m)."""
        m = slopes.shape[1]
        longer = not np.array_equal(length, self.length)
        if longer:
            shifts = TABLE.shifts / length[:, None]
            self.weight = 1.0 / (shifts[:, :, None] - self.poles)
            self.joint = np.zeros((*shifts.shape, len(self.joined), len(self.joined)))
            if self.joined:
                one = np.eye(len(self.joined))
                self.joint = np.linalg.inv(shifts[:, :, None, None] * one - self.inner)
            driven = self._times(self.weight, self.joint, self.drive[:, None])
            core = driven @ self.seen[:, None, :, :m] + self.direct[:, None, :, :m]
            self.core, self.length = core.transpose(0, 1, 3, 2), length
        if longer or not np.array_equal(slopes, self.at):
            self.at, self.change = slopes, slopes - self.slopes
            loop = np.eye(m) - self.core * self.change[:, None, None, :]
            self.transfer = np.linalg.solve(loop, self.core)

    def free(self, rate: Complexes) -> tuple[Floats, Complexes]:
        """Return the inputs' changes without remainders (R, m, s), and what `end` needs."""
        rows = SIGMA[:, None, None] * rate[:, None, None, :]
        x = self._times(self.weight, self.joint, rows)[:, :, 0]
        inputs = x @ self.seen[:, :, : self.at.shape[1]]
        changed = (self.change[:, None] * inputs)[..., None]
        return _stages(inputs + (self.transfer @ changed)[..., 0]), x

    def response(self, remainder: Floats, parts: Complexes) -> Floats:
        """Return what remainders (R, m, s) add to the inputs, (R, m, s)."""
        return _stages((self.transfer @ _systems(remainder)[..., None])[..., 0])

    def end(self, remainder: Floats, inputs: Floats, parts: Complexes) -> tuple[Complexes, Floats]:
        """Return what `moved` needs, and the changes of inputs and watched nodes (R, m + K, s)."""
        m = inputs.shape[1]
        nu = _systems(remainder + self.change[:, :, None] * inputs)
        x = parts + self._times(self.weight, self.joint, (nu @ self.drive)[:, :, None])[:, :, 0]
        others = _stages(x @ self.seen[:, :, m:] + nu @ self.direct[:, :, m:])
        return x, np.concatenate([inputs, others], axis=1)

    def moved(self, parts: Complexes, weights: Complexes) -> Complexes:
        """Return the changes of the states up to where the systems have `weights` (R, k)."""
        half = 0.5 * (weights[:, None, :] @ parts)[:, 0]
        return np.asarray(half + half[np.arange(len(half))[:, None], self.mates].conj())

    def jumping(self, slopes: Floats) -> Bools:
        """Return which boards (R,) have several voltages for a state at slopes (R, m).

        The sign of ``det(1 - H slopes)`` is 1 where nothing comes back at once. With one sign on
        all straight pieces, none turns back at a break.
        """
        loop = np.eye(slopes.shape[1]) - self.at_once * slopes[:, None, :]
        return np.asarray(np.linalg.slogdet(loop)[0] <= 0.0)
