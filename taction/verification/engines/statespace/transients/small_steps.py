"""Steps of several small boards at a time, in the basis of their modes where they have one.

The boards are linearised at their equilibria, so in this basis their equations are

    z' = poles z + drive n + constant,    v = seen z + direct n + ...

with the remainders n of the amplifiers beyond their slopes at rest, and the systems of a step (see
`steps`) are divisions. Modes that are joined because they are nearly defective have small matrices
in the place of poles; boards without any basis of modes keep their states, all of them joined.
Every board may have a length of step and slopes of its own.
"""

from __future__ import annotations

from collections.abc import Sequence
from copy import copy
from dataclasses import dataclass

import numpy as np

from taction.system.array_types import Bools, Complexes, Floats, Ints
from taction.system.errors import EngineError
from taction.verification.engines.statespace.linearised.loop_newton import solve_loop
from taction.verification.engines.statespace.linearised.modes import Modes
from taction.verification.engines.statespace.linearised.state_space import StateSpace
from taction.verification.engines.statespace.transients.radau import TABLE
from taction.verification.engines.statespace.transients.steps import (
    BEYOND,
    SIGMA,
    Amplifiers,
    Function,
)

DEFECT = 1e-10  # of ``left right - 1``: with more, modes lose digits that solves keep


def is_basis(modes: Modes) -> bool:
    """Whether the modes, some of them joined, are a basis in which steps lose no digits."""
    return modes.defect < DEFECT


@dataclass(frozen=True, slots=True, eq=False)
class Blocks:
    """Matrices of R boards and k systems, diagonal but for some joined rows and columns.

    Attributes
    ----------
    diagonal : ndarray (R, k, n)
        0 where joined.
    inner : ndarray (R, k, j, j)
        The joined part.
    joined : ndarray (j,)
        Its places.
    """

    diagonal: Complexes
    inner: Complexes
    joined: Ints

    @classmethod
    def of(cls, matrices: Complexes, joined: Ints) -> Blocks:
        """Return what matters of matrices (R, n, n)."""
        diagonal = np.diagonal(matrices, axis1=1, axis2=2).copy()
        diagonal[:, joined] = 0.0
        inner = matrices[:, joined[:, None], joined]
        return cls(diagonal[:, None].astype(np.complex128), inner[:, None], joined)

    def part(self, rows: Ints) -> Blocks:
        """Return those of some boards."""
        return Blocks(self.diagonal[rows], self.inner[rows], self.joined)

    def with_part(self, rows: Ints, other: Blocks) -> Blocks:
        """Put those of some boards into their places, and return all."""
        self.diagonal[rows], self.inner[rows] = other.diagonal, other.inner
        return self

    def times(self, rows: Complexes) -> Complexes:
        """Return the products with vectors (R, k or 1, q, n), (R, k, q, n)."""
        found = np.asarray(self.diagonal[:, :, None, :] * rows)
        if self.joined.size:
            found[..., self.joined] = rows[..., self.joined] @ self.inner.swapaxes(-1, -2)
        return found

    def inverse(self, shifts: Complexes) -> Blocks:
        """Return the inverses of ``shift - matrix`` for shifts (R, k)."""
        inner = np.zeros((*shifts.shape, *self.inner.shape[2:]), dtype=np.complex128)
        if self.joined.size:
            one = np.eye(self.joined.size)
            inner[:] = np.linalg.inv(shifts[:, :, None, None] * one - self.inner)
        return Blocks(1.0 / (shifts[:, :, None] - self.diagonal), inner, self.joined)


class StateBoard:
    """A board by its states: ``x' = A x + B + E a``, ``y = C x + D + H a``.

    y are the inputs of the amplifiers, then other watched nodes. `core` are the four matrices, and
    `constant` the other terms of x', of the board with `slopes` in the place of its amplifiers.
    """

    def __init__(self, space: StateSpace, nodes: tuple[str, ...], slopes: Floats) -> None:
        places = space.descriptor.devices.input
        self.space, self.slopes, self.count = space, slopes, len(slopes)
        watched, direct = space.rows(nodes)
        self.A, self.B, self.E = space.A, space.B[:, :2].sum(axis=1), space.B[:, 2:]
        self.C = np.concatenate([space.C[places], watched])
        D = np.concatenate([space.D[places], direct])
        self.D, self.H = D[:, :2].sum(axis=1), D[:, 2:]
        self.draws = 0
        self.nominal: StateBoard | None = None  # before its coefficients were moved
        self._close()

    def _close(self) -> None:
        """Compute the matrices with the slopes in the place of the amplifiers."""
        slopes = self.slopes
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

    def perturbed(self, rounding: float) -> StateBoard:
        """Return the board with every coefficient moved by a draw of its relative `rounding`.

        A slow mode beside fast ones has few digits in A: a second run by the same matrices has the
        same errors, one by these shows them. A third run moves the first ones, too, or it would err
        by the sum of both draws where its difference to the second shows one.
        """
        found = copy(self)
        found.draws, found.nominal = self.draws + 1, self.nominal or self
        draw = np.random.default_rng([1992, found.draws])
        for name in ("A", "B", "E", "C", "D"):
            values = getattr(found.nominal, name)
            moved = values * (1.0 + rounding * draw.choice([-1.0, 1.0], values.shape))
            setattr(found, name, moved)
        found._close()
        return found

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

    def equations(self, amplifiers: Amplifiers) -> tuple[Function, Function, Function]:
        """Return rate, Jacobian and watched voltages of states, for other integrators.

        The voltages (P, m + K) are those of states (n, P).

        Raises
        ------
        EngineError
            The output of an amplifier acts on its own input without delay.
        """
        m = self.count
        if self.H[:m].any():
            raise EngineError("an amplifier feeds back on itself without delay")
        C, D = self.C[:m], self.D[:, None]

        def rate(x: Floats) -> Floats:
            inputs = (C @ x + self.D[:m])[None, :, None]
            outputs = amplifiers.outputs(inputs)[0, :, 0]
            return np.asarray(self.A @ x + self.B + self.E @ outputs)

        def jacobian(x: Floats) -> Floats:
            slopes = amplifiers.slopes((C @ x + self.D[:m])[None, :, None])[0, :, 0]
            return np.asarray(self.A + (self.E * slopes) @ C)

        def watch(x: Floats) -> Floats:
            found = self.C @ x + D
            return np.asarray((found + self.H @ amplifiers.outputs(found[None, :m])[0]).T)

        return rate, jacobian, watch


def _systems(stages: Floats) -> Complexes:
    """Return the values of the method's systems (R, k, m) from those of the stages (R, m, s)."""
    return np.asarray(TABLE.left @ stages.transpose(0, 2, 1))


def _stages(systems: Complexes) -> Floats:
    """Return the values of the stages (R, m, s) from those of the method's systems (R, k, m)."""
    return np.asarray((TABLE.right @ systems).real.transpose(0, 2, 1))


class SmallBoards:
    """R boards by their modes, as `Boards`, and their present `Steps`.

    All have as many states, amplifiers and watched nodes. The voltages of a mode are at most 1 V,
    so that its coordinate is about its share in volts.

    Parameters
    ----------
    boards : sequence of StateBoard
        At their slopes at rest.
    modes : sequence of Modes
        Of the same boards; empty where they are no basis.
    """

    factorisations = 1

    def __init__(self, boards: Sequence[StateBoard], modes: Sequence[Modes]) -> None:
        m, cores = boards[0].count, zip(*(board.core for board in boards), strict=True)
        matrix, drive, seen, direct = (np.stack(part) for part in cores)
        count, n = matrix.shape[:2]
        joined = np.arange(n)
        if modes:
            right, left = (
                np.stack(x) for x in zip(*((m.right, m.left) for m in modes), strict=True)
            )
            scale = np.abs(right).max(axis=1)
            right, left = right / scale[:, None, :], scale[:, :, None] * left
            joined, mates = np.flatnonzero(~modes[0].alone), [each.mates for each in modes]
        else:
            left = right = np.broadcast_to(np.eye(n, dtype=np.complex128), matrix.shape).copy()
            mates = [joined] * count
        self.mates = np.stack(mates)
        self.matrix = Blocks.of(left @ matrix @ right, joined)
        self.slopes = np.stack([each.slopes for each in boards])
        self.left, self.drive = left, (left @ drive).transpose(0, 2, 1)  # (R, m, n)
        self.constant = (left @ np.stack([each.constant for each in boards])[..., None])[..., 0]
        seen, direct = (seen @ right).transpose(0, 2, 1), direct.transpose(0, 2, 1)
        self.seen_inputs, self.seen_others = seen[:, :, :m], seen[:, :, m:]
        self.direct_inputs, self.direct_others = direct[:, :, :m], direct[:, :, m:]
        k = len(SIGMA)
        self.at_once = np.stack([each.H[: each.count] for each in boards])
        self.length, self.at = np.zeros(count), np.full((count, m), np.nan)
        self.weight = self.matrix.inverse(np.ones((count, k), dtype=np.complex128))
        self.core = np.zeros((count, k, m, m), dtype=np.complex128)
        self.transfer = np.zeros_like(self.core)  # inputs of nu at the slopes
        self.change = np.zeros((count, m))  # slopes minus those at rest, V/V

    def part(self, rows: Ints) -> SmallBoards:
        """See `Boards`."""
        found = copy(self)
        for name, values in vars(self).items():
            kept = values.part(rows) if isinstance(values, Blocks) else values[rows]
            setattr(found, name, kept)
        return found

    def state(self, states: Floats) -> Complexes:
        """Return the coordinates of states (R, n), (R, n)."""
        return np.asarray((self.left @ states[..., None])[..., 0])

    def rate(self, state: Complexes, inputs: Floats, outputs: Floats) -> Complexes:
        """See `Boards`."""
        remainder = (outputs - self.slopes * inputs)[:, None, :]
        moving = self.matrix.times(state[:, None, None, :])[:, 0, 0]
        return np.asarray(moving + self.constant + (remainder @ self.drive)[:, 0])

    def step(self, length: Floats, slopes: Floats) -> SmallBoards:
        """See `Boards`: the step of boards is a part of theirs."""
        longer = length != self.length
        rows = np.flatnonzero(longer)
        if rows.size:
            weight = self.matrix.part(rows).inverse(TABLE.shifts / length[rows, None])
            self.weight = self.weight.with_part(rows, weight)
            driven = weight.times(self.drive[rows, None])
            core = driven @ self.seen_inputs[rows, None] + self.direct_inputs[rows, None]
            self.core[rows] = core.transpose(0, 1, 3, 2)
            self.length = length
        rows = np.flatnonzero(longer | (slopes != self.at).any(axis=1))
        if rows.size:
            change = slopes[rows] - self.slopes[rows]
            core = self.core[rows]
            loop = np.eye(core.shape[2]) - core * change[:, None, None, :]
            self.transfer[rows] = np.linalg.solve(loop, core)
            self.at = slopes
        self.change = slopes - self.slopes
        return self

    def free(self, rate: Complexes) -> tuple[Floats, Complexes]:
        """See `Steps`."""
        x = self.weight.times(SIGMA[:, None, None] * rate[:, None, None, :])[:, :, 0]
        inputs = x @ self.seen_inputs
        changed = (self.change[:, None] * inputs)[..., None]
        return _stages(inputs + (self.transfer @ changed)[..., 0]), x

    def response(self, remainder: Floats, parts: Complexes) -> Floats:
        """See `Steps`."""
        return _stages((self.transfer @ _systems(remainder)[..., None])[..., 0])

    def end(self, remainder: Floats, inputs: Floats, parts: Complexes) -> tuple[Complexes, Floats]:
        """See `Steps`."""
        nu = _systems(remainder + self.change[:, :, None] * inputs)
        x = parts + self.weight.times((nu @ self.drive)[:, :, None])[:, :, 0]
        if not self.seen_others.shape[2]:
            return x, inputs
        others = _stages(x @ self.seen_others + nu @ self.direct_others)
        return x, np.concatenate([inputs, others], axis=1)

    def moved(self, parts: Complexes, weights: Complexes) -> Complexes:
        """See `Steps`."""
        half = 0.5 * (weights[:, None, :] @ parts)[:, 0]
        return np.asarray(half + half[np.arange(len(half))[:, None], self.mates].conj())

    def jumping(self, slopes: Floats) -> Bools:
        """See `Boards`: the sign of ``det(1 - H slopes)`` is 1 where nothing comes back at once.

        With one sign on all straight pieces, none turns back at a break.
        """
        loop = np.eye(slopes.shape[1]) - self.at_once * slopes[:, None, :]
        return np.asarray(np.linalg.slogdet(loop)[0] <= 0.0)
