"""What the integrator needs of its boards: their amplifiers, and their steps with a linear part.

A board is ``M x' = K x + b + F a(v)`` with inputs ``v = G x + H a(v)`` of m amplifiers. From the
start of a step on, K contains the amplifiers' `slopes`, and only what an amplifier does beyond its
slope is nonlinear: the remainder n. In the eigenbasis of the method's matrix the changes w of the s
stages since the start are separate systems

    (theta_k M / h - K) w_k = sigma_k r + F nu_k,

half of them by symmetry, where r is the rate at the start and nu are the remainders n of the stages
in this basis. So a step of a linear board needs no iteration, and the stages of any other board are
found by iterating on the m inputs alone. `small_steps` have these systems in the basis of the
modes, where they are divisions, `structured_steps` solve them in all unknowns.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from copy import copy
from typing import Any, Protocol

import numpy as np

from taction.system.array_types import Bools, Complexes, Floats, Ints
from taction.verification.engines.statespace.equations.amplifier_gains import gain_of
from taction.verification.engines.statespace.equations.descriptor import Devices
from taction.verification.engines.statespace.transients.radau import TABLE
from taction.verification.engines.statespace.transients.straight_pieces import StraightPieces

SIGMA = TABLE.left.sum(axis=1)

Function = Callable[[Floats], Floats]
BEYOND = "an amplifier is beyond the range of floats in the initial state"


class Amplifiers:
    """The amplifiers of boards of one kind, as functions of their inputs (R, m, s), V.

    Where there is one board, R may be any number.
    """

    def __init__(self, devices: Devices) -> None:
        self.kinds, self.gain, self.count = devices.kinds, gain_of(devices.kinds), devices.count
        self.u_scale = devices.u_scale[None, :, None]
        self.v_scale = devices.v_scale[None, :, None]
        found = StraightPieces(devices.kinds)
        self.pieces = found if found.broken.any() else None

    @classmethod
    def joined(cls, several: Sequence[Amplifiers]) -> Amplifiers:
        """Return those of several boards together."""
        found = copy(several[0])
        found.u_scale = np.concatenate([each.u_scale for each in several])
        found.v_scale = np.concatenate([each.v_scale for each in several])
        return found

    def part(self, rows: Ints) -> Amplifiers:
        """Return those of some boards."""
        found = copy(self)
        found.u_scale, found.v_scale = self.u_scale[rows], self.v_scale[rows]
        return found

    def outputs(self, inputs: Floats) -> Floats:
        """Return the outputs, V; not finite beyond the range of floats."""
        return np.asarray(-self.u_scale * self._by_row(self.gain.outputs, inputs / self.v_scale))

    def slopes(self, inputs: Floats) -> Floats:
        """Return the slopes, V/V; not finite beyond the range of floats."""
        with np.errstate(over="ignore"):
            slope = self._by_row(self.gain.slope, inputs / self.v_scale)
            return np.asarray(-self.u_scale / self.v_scale * slope)

    def steepest(self) -> Floats:
        """Return the largest slopes of straight pieces, V/V, (R, m); 0 of other amplifiers."""
        largest = 0.0 if self.pieces is None else self.pieces.steepest
        return np.asarray((self.u_scale / self.v_scale)[:, :, 0] * largest)

    def along(self, inputs: Floats, segments: Ints) -> Floats:
        """Return the outputs, V, those of straight pieces along `segments` (R, m), also beyond."""
        if self.pieces is None:
            return self.outputs(inputs)
        rise, offset = (part[:, :, None] for part in self.pieces.lines(segments))
        lines = -self.u_scale * (rise * (inputs / self.v_scale) + offset)
        if self.pieces.broken.all():
            return np.asarray(lines)
        return np.asarray(np.where(self.pieces.broken[:, None], lines, self.outputs(inputs)))

    def slopes_along(self, inputs: Floats, segments: Ints) -> Floats:
        """Return the mean slopes over inputs (R, m, s), those of straight pieces along theirs."""
        slopes = np.asarray(self.slopes(inputs).mean(axis=2))
        if self.pieces is None:
            return slopes
        rise, _ = self.pieces.lines(segments)
        lines = -(self.u_scale / self.v_scale)[:, :, 0] * rise
        return np.asarray(np.where(self.pieces.broken, lines, slopes))

    @staticmethod
    def _by_row(function: Function, y: Floats) -> Floats:
        """Apply a function whose first axis is that of the amplifiers."""
        return function(y.transpose(1, 0, 2)).transpose(1, 0, 2)


class Steps(Protocol):
    """One step of each of R boards; arrays have the boards on the first axis."""

    def free(self, rate: Any) -> tuple[Floats, Any]:
        """Return the inputs' changes without remainders (R, m, s), and what `end` needs."""
        ...

    def response(self, remainder: Floats, parts: Any) -> Floats:
        """Return what remainders (R, m, s) add to the inputs, (R, m, s)."""
        ...

    def end(self, remainder: Floats, inputs: Floats, parts: Any) -> tuple[Any, Floats]:
        """Return what `moved` needs, and the changes of inputs and watched nodes (R, m + K, s)."""
        ...

    def moved(self, parts: Any, weights: Complexes) -> Any:
        """Return the changes of the states up to where the systems have `weights` (R, k)."""
        ...


class Boards(Protocol):
    """What the integrator needs of its boards; arrays have the boards on the first axis."""

    factorisations: int  # so far, of each board

    def rate(self, state: Any, inputs: Floats, outputs: Floats) -> Any:
        """Return the right-hand sides for inputs and outputs (R, m) of the amplifiers."""
        ...

    def step(self, length: Floats, slopes: Floats) -> Steps:
        """Prepare a step of each board, of lengths (R,), s, at slopes (R, m), before the next."""
        ...

    def jumping(self, slopes: Floats) -> Bools:
        """Return which boards (R,) have several voltages for a state at slopes (R, m)."""
        ...

    def part(self, rows: Ints) -> Boards:
        """Return some of the boards."""
        ...
