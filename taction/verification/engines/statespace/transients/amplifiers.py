"""The amplifiers of boards as functions of their inputs, also along their straight pieces."""

from __future__ import annotations

from collections.abc import Callable, Sequence

import numpy as np

from taction.system.array_types import Floats, Ints
from taction.verification.engines.statespace.equations.amplifier_gains import GAINS, Gain, gain_of
from taction.verification.engines.statespace.equations.descriptor import Devices
from taction.verification.engines.statespace.transients.batch import Batch

Function = Callable[[Floats], Floats]
BEYOND = "an amplifier is beyond the range of floats in the initial state"


class Amplifiers(Batch):
    """The amplifiers of boards of one kind, as functions of their inputs (R, m, s), V.

    Where there is one board, R may be any number.
    """

    def __init__(self, devices: Devices) -> None:
        self.kinds, self.gain, self.count = devices.kinds, gain_of(devices.kinds), devices.count
        self.u_scale = devices.u_scale[None, :, None]
        self.v_scale = devices.v_scale[None, :, None]
        self.pieces = StraightPieces(devices.kinds)

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
        return np.asarray((self.u_scale / self.v_scale)[:, :, 0] * self.pieces.steepest)

    def along(self, inputs: Floats, segments: Ints) -> Floats:
        """Return the outputs, V, those of straight pieces along `segments` (R, m), also beyond."""
        if not self.pieces.broken.any():
            return self.outputs(inputs)
        rise, offset = (part[:, :, None] for part in self.pieces.lines(segments))
        lines = -self.u_scale * (rise * (inputs / self.v_scale) + offset)
        if self.pieces.broken.all():
            return np.asarray(lines)
        return np.asarray(np.where(self.pieces.broken[:, None], lines, self.outputs(inputs)))

    def slopes_along(self, inputs: Floats, segments: Ints) -> Floats:
        """Return the slopes at inputs (R, m), those of straight pieces along theirs."""
        slopes = self.slopes(inputs[:, :, None])[:, :, 0]
        rise, _ = self.pieces.lines(segments)
        lines = -(self.u_scale / self.v_scale)[:, :, 0] * rise
        return np.asarray(np.where(self.pieces.broken, lines, slopes))

    @staticmethod
    def _by_row(function: Function, y: Floats) -> Floats:
        """Apply a function whose first axis is that of the amplifiers."""
        return function(y.transpose(1, 0, 2)).transpose(1, 0, 2)


class StraightPieces:
    """The straight pieces of amplifiers (m,), dimensionless; any other has one endless piece.

    Attributes
    ----------
    broken : ndarray (m,)
        Which amplifiers consist of straight pieces.
    edges, rise, offset : ndarray (m, S + 1), (m, S), (m, S)
        Where pieces begin and end; g is ``rise y + offset`` on each.
    steepest : ndarray (m,)
        The largest rise of each.
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
        """Return the piece of each input (R, m)."""
        return np.asarray((y[:, :, None] >= self.edges[:, 1:-1]).sum(axis=2))

    def ends(self, segments: Ints) -> tuple[Floats, Floats]:
        """Return both ends of pieces (R, m)."""
        return self.edges[self.every, segments], self.edges[self.every, segments + 1]

    def lines(self, segments: Ints) -> tuple[Floats, Floats]:
        """Return rise and offset of pieces (R, m)."""
        return self.rise[self.every, segments], self.offset[self.every, segments]


def _lines(gain: Gain) -> tuple[Floats, Floats]:
    """Return rise and offset of the pieces of one g."""
    breaks = np.array(gain.breaks or ())
    inside = np.concatenate([breaks[:1] - 1.0, 0.5 * (breaks[1:] + breaks[:-1]), breaks[-1:] + 1.0])
    rise = gain.slope(inside)
    return rise, gain.value(inside) - rise * inside
