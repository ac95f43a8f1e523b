"""Steps of several small boards at a time, in the basis of their modes.

The boards are linearised at their equilibria, so in this basis their equations are

    z' = poles z + drive n + constant,    v = seen z + direct n + ...

with the remainders n of the amplifiers beyond their slopes at rest, and the systems of a step (see
`steps`) are divisions. Every board may have a length of step and slopes of its own.
"""

from __future__ import annotations

from collections.abc import Sequence
from copy import copy
from dataclasses import dataclass, replace

import numpy as np

from taction.system.array_types import Complexes, Floats, Ints
from taction.verification.engines.statespace.linearised.modes import Modes
from taction.verification.engines.statespace.transients.steps import SIGMA, TABLE, DenseBoard

DEFECT = 1e-10  # of ``left right - 1``: with more, modes lose digits that solves keep


def is_modal(modes: Modes) -> bool:
    """Whether the modes are a basis in which steps lose no digits."""
    return modes.defect < DEFECT and bool(modes.alone.all())


@dataclass(frozen=True, eq=False)
class ModalStep:
    """One step of each of R boards; see `Steps`.

    Attributes
    ----------
    weight : ndarray (R, k, n)
        Of the right-hand sides of the systems, s.
    core, inverse, transfer : ndarray (R, k, m, m)
        Inputs of nu at the slopes at rest, what other slopes make of them, and their product.
    change : ndarray (R, m)
        Slopes minus those at rest, V/V.
    """

    board: ModalBoards
    weight: Complexes
    core: Complexes
    inverse: Complexes
    transfer: Complexes
    change: Floats

    def part(self, rows: Ints) -> ModalStep:
        """See `Steps`."""
        found = {name: values[rows] for name, values in vars(self).items() if name != "board"}
        return replace(self, board=self.board.part(rows), **found)

    def free(self, rate: Complexes) -> tuple[Floats, Complexes]:
        """See `Steps`."""
        x = self.weight * (SIGMA[:, None] * rate[:, None, :])
        inputs = x @ self.board.seen_inputs
        return _stages((self.inverse @ inputs[..., None])[..., 0]), x

    def response(self, remainder: Floats, parts: Complexes) -> Floats:
        """See `Steps`."""
        return _stages((self.transfer @ _systems(remainder)[..., None])[..., 0])

    def end(self, remainder: Floats, inputs: Floats, parts: Complexes) -> tuple[Complexes, Floats]:
        """See `Steps`."""
        board = self.board
        nu = _systems(remainder + self.change[:, :, None] * inputs)
        x = parts + self.weight * (nu @ board.drive)
        half = 0.5 * (TABLE.right[-1] @ x)
        change = half + np.take_along_axis(half, board.mates, axis=1).conj()
        if not board.seen_others.shape[2]:
            return change, inputs
        others = _stages(x @ board.seen_others + nu @ board.direct_others)
        return change, np.concatenate([inputs, others], axis=1)


def _systems(stages: Floats) -> Complexes:
    """Return the values of the method's systems (R, k, m) from those of the stages (R, m, s)."""
    return np.asarray(TABLE.left @ stages.transpose(0, 2, 1))


def _stages(systems: Complexes) -> Floats:
    """Return the values of the stages (R, m, s) from those of the method's systems (R, k, m)."""
    return np.asarray((TABLE.right @ systems).real.transpose(0, 2, 1))


class ModalBoards:
    """R boards by their modes, as `Boards`.

    All have as many states, amplifiers and watched nodes. The voltages of a mode are at most 1 V,
    so that its coordinate is about its share in volts.

    Parameters
    ----------
    boards : sequence of DenseBoard
        At their slopes at rest.
    modes : sequence of Modes
        Of the same boards.
    """

    factorisations = 1

    def __init__(self, boards: Sequence[DenseBoard], modes: Sequence[Modes]) -> None:
        m = boards[0].count
        right, left = (np.stack(x) for x in zip(*((m.right, m.left) for m in modes), strict=True))
        scale = np.abs(right).max(axis=1)
        right, left = right / scale[:, None, :], scale[:, :, None] * left
        cores = zip(*(board.core for board in boards), strict=True)
        _, drive, seen, direct = (np.stack(part) for part in cores)
        self.poles = np.stack([each.poles for each in modes])
        self.mates = np.stack([each.mates for each in modes])
        self.slopes = np.stack([each.slopes for each in boards])
        self.left, self.drive = left, (left @ drive).transpose(0, 2, 1)  # (R, m, n)
        self.constant = (left @ np.stack([each.constant for each in boards])[..., None])[..., 0]
        seen, direct = (seen @ right).transpose(0, 2, 1), direct.transpose(0, 2, 1)
        self.seen_inputs, self.seen_others = seen[:, :, :m], seen[:, :, m:]
        self.direct_inputs, self.direct_others = direct[:, :, :m], direct[:, :, m:]
        count, k = len(boards), len(SIGMA)
        self.length, self.at = np.zeros(count), np.full((count, m), np.nan)
        self.weight = np.zeros((count, k, self.poles.shape[1]), dtype=np.complex128)
        self.core = np.zeros((count, k, m, m), dtype=np.complex128)
        self.inverse, self.transfer = np.zeros_like(self.core), np.zeros_like(self.core)

    def part(self, rows: Ints) -> ModalBoards:
        """See `Boards`."""
        found = copy(self)
        for name, values in vars(self).items():
            setattr(found, name, values[rows])
        return found

    def state(self, states: Floats) -> Complexes:
        """Return the coordinates of states (R, n), (R, n)."""
        return np.asarray((self.left @ states[..., None])[..., 0])

    def rate(self, state: Complexes, inputs: Floats, outputs: Floats) -> Complexes:
        """See `Boards`."""
        remainder = (outputs - self.slopes * inputs)[:, None, :]
        return np.asarray(self.poles * state + self.constant + (remainder @ self.drive)[:, 0])

    def size(self, state: Complexes) -> Floats:
        """See `Boards`."""
        return np.asarray(np.abs(state).max(axis=1, initial=0.0))

    def step(self, length: Floats, slopes: Floats) -> ModalStep:
        """See `Boards`."""
        longer = length != self.length
        rows = np.flatnonzero(longer)
        if rows.size:
            shifts = TABLE.shifts[:, None] / length[rows, None, None]
            weight = self.weight[rows] = 1.0 / (shifts - self.poles[rows, None, :])
            driven = weight[:, :, None, :] * self.drive[rows, None]
            core = driven @ self.seen_inputs[rows, None] + self.direct_inputs[rows, None]
            self.core[rows] = core.transpose(0, 1, 3, 2)
            self.length = length
        rows = np.flatnonzero(longer | (slopes != self.at).any(axis=1))
        if rows.size:
            change = slopes[rows] - self.slopes[rows]
            core = self.core[rows]
            inverse = np.linalg.inv(np.eye(core.shape[2]) - core * change[:, None, None, :])
            self.inverse[rows], self.transfer[rows] = inverse, inverse @ core
            self.at = slopes
        change = slopes - self.slopes
        return ModalStep(self, self.weight, self.core, self.inverse, self.transfer, change)
