"""The amplifiers of a board, also along straight pieces, and where these end.

In a step every such amplifier goes on along its straight piece, so that nothing in the step bends.
The step ends at the first root of (input - break) on its polynomial, and the next one begins on the
next piece.

The right-hand side of a board with a continuous g is Lipschitz continuous, so one solution passes
through every state: it neither slides along a break nor chatters there. Only an amplifier that
drives its own input without any delay, by a gain above 1, makes the equations ambiguous, as a
Schmitt trigger's are; `JUMPS` refuses that in words.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.polynomial.legendre import legroots, legval, legvander

from taction.system.array_types import EPS, Complexes, Floats, Ints
from taction.verification.engines.statespace.equations.amplifier_gains import GAINS, Gain, gain_of
from taction.verification.engines.statespace.equations.descriptor import Devices
from taction.verification.engines.statespace.transients.radau import NODES, STAGES, TABLE

BEYOND = "an amplifier is beyond the range of floats in the initial state"


class Amplifiers:
    """The amplifiers of a board as functions of their inputs (m, s), V."""

    def __init__(self, devices: Devices) -> None:
        self.gain, self.count = gain_of(devices.kinds), devices.count
        self.u_scale, self.v_scale = devices.u_scale[:, None], devices.v_scale[:, None]
        self.pieces = StraightPieces(devices.kinds)

    def outputs(self, inputs: Floats) -> Floats:
        """Return the outputs, V; not finite beyond the range of floats."""
        return np.asarray(-self.u_scale * self.gain.outputs(inputs / self.v_scale))

    def slopes(self, inputs: Floats) -> Floats:
        """Return the slopes, V/V; not finite beyond the range of floats."""
        with np.errstate(over="ignore"):
            slope = self.gain.slope(inputs / self.v_scale)
            return np.asarray(-self.u_scale / self.v_scale * slope)

    def steepest(self) -> Floats:
        """Return the largest slopes of straight pieces, V/V, (m,); 0 of other amplifiers."""
        return np.asarray((self.u_scale / self.v_scale)[:, 0] * self.pieces.steepest)

    def along(self, inputs: Floats, segments: Ints) -> Floats:
        """Return the outputs, V, those of straight pieces along `segments` (m,), also beyond."""
        if not self.pieces.broken.any():
            return self.outputs(inputs)
        rise, offset = (part[:, None] for part in self.pieces.lines(segments))
        lines = -self.u_scale * (rise * (inputs / self.v_scale) + offset)
        if self.pieces.broken.all():
            return np.asarray(lines)
        return np.asarray(np.where(self.pieces.broken[:, None], lines, self.outputs(inputs)))

    def slopes_along(self, inputs: Floats, segments: Ints) -> Floats:
        """Return the slopes at inputs (m,), those of straight pieces along theirs."""
        rise, _ = self.pieces.lines(segments)
        lines = -(self.u_scale / self.v_scale)[:, 0] * rise
        slopes = self.slopes(inputs[:, None])[:, 0]
        return np.asarray(np.where(self.pieces.broken, lines, slopes))


class StraightPieces:
    """The straight pieces of amplifiers (m,), dimensionless; any other has one endless piece.

    Those of `broken` have pieces between `edges` (m, S + 1), where g is ``rise y + offset``, (m, S)
    each; `steepest` (m,) is the largest rise.
    """

    def __init__(self, kinds: Sequence[str]) -> None:
        gains, m = [GAINS[kind] for kind in kinds], len(kinds)
        most = max((len(gain.breaks or ()) for gain in gains), default=0) + 1
        self.broken = np.array([gain.breaks is not None for gain in gains], dtype=np.bool_)
        self.edges = np.full((m, most + 1), np.inf)
        self.edges[:, 0] = -np.inf
        self.rise, self.offset = np.zeros((m, most)), np.zeros((m, most))
        for k, gain in enumerate(gains):
            if gain.breaks is not None:
                count = len(gain.breaks)
                self.edges[k, 1 : count + 1] = gain.breaks
                self.rise[k, : count + 1], self.offset[k, : count + 1] = _lines(gain)
        self.steepest = np.abs(self.rise).max(axis=1, initial=0.0)
        self.every = np.arange(m)

    def at(self, y: Floats) -> Ints:
        """Return the piece of each input (m,)."""
        return np.asarray((y[:, None] >= self.edges[:, 1:-1]).sum(axis=1))

    def ends(self, segments: Ints) -> tuple[Floats, Floats]:
        """Return both ends of pieces (m,)."""
        return self.edges[self.every, segments], self.edges[self.every, segments + 1]

    def lines(self, segments: Ints) -> tuple[Floats, Floats]:
        """Return rise and offset of pieces (m,)."""
        return self.rise[self.every, segments], self.offset[self.every, segments]


def _lines(gain: Gain) -> tuple[Floats, Floats]:
    """Return rise and offset of the pieces of one g."""
    breaks = np.array(gain.breaks or ())
    inside = np.concatenate([breaks[:1] - 1.0, 0.5 * (breaks[1:] + breaks[:-1]), breaks[-1:] + 1.0])
    rise = gain.slope(inside)
    return rise, gain.value(inside) - rise * inside


SLACK = 1e-3  # of the tolerance: how far behind a break an output counts as beyond it
ROUNDED = 256 * EPS  # of the largest input: the least slack
PASSED = 0.4  # of the slack: amplifiers so far behind a break pass it together
MOST_SWITCHES = 2000
JUMPS = (
    "some of its amplifiers drive their own inputs without delay, by a gain above 1: the board has"
    " several voltages for one state, and jumps. Give the op-amps a bandwidth, or the signal nodes"
    " a capacitance"
)


def first_passage(excess: Floats) -> float:
    """Return where the first of polynomials on [0, 1] becomes positive; 1 if none does.

    `excess` (Q, s + 1) are their Legendre coefficients. Between two neighbouring roots a polynomial
    keeps its sign, so no passage is missed, also two in one step.
    """
    found = 1.0
    for row in excess[excess[:, 0] + np.abs(excess[:, 1:]).sum(axis=1) > 0.0]:
        # A last coefficient far below rounding would be divided by.
        piece = np.where(np.abs(row) < 1e-3 * EPS * np.abs(row).max(), 0.0, row)
        roots = legroots(piece)
        inside = np.sort(roots.real[(roots.imag == 0.0) & (np.abs(roots.real) < 1.0)])
        ends = np.concatenate([[-1.0], inside, [1.0]])
        beyond = legval(0.5 * (ends[1:] + ends[:-1]), piece) > 0.0
        if beyond.any():
            found = min(found, 0.5 * (1.0 + float(ends[beyond.argmax()])))
    return found


def shortened(piece: Floats, theta: float) -> tuple[Floats, Floats, Complexes]:
    """Cut steps with Legendre coefficients (W, s + 1) at `theta`.

    Return the coefficients of what is left, the values at its end (W,), and the weights (k,) by
    which the method's systems give the change of the states up to there.
    """
    values = piece @ legvander(2.0 * theta * NODES - 1.0, STAGES).T
    basis = legvander(np.array([2.0 * theta - 1.0]), STAGES)[0] @ TABLE.legendre
    return values @ TABLE.legendre.T, values[:, -1], basis[1:] @ TABLE.right


@dataclass(frozen=True, slots=True)
class Switch:
    """The start of a stretch on straight pieces `segments` (m,), at `time`, s."""

    time: float
    segments: tuple[int, ...]
