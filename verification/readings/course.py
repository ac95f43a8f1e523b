"""The way of a board's channels to their targets, with bounds and the instants that resolve it."""

from __future__ import annotations

import functools
import math
from dataclasses import dataclass

import numpy as np

from taction.system.array_types import EPS, Bools, Floats, Ints
from taction.verification.engines.statespace.transients.exact import Exact

FINENESS = 0.25  # step times |p| of the fastest mode of a resolved interval: 25 points a period
PER_OCTAVE = 32  # over ln 2: the step is at most this part of the time
SEEN = 2.0  # width times |p| up to which a chord bounds a mode better than its envelope
LONGER = 1.1  # times the end of the grid: the least next end
EARLY = 4.0 ** -np.arange(13, 1, -1)  # of the fastest mode's time constant: the first instants
NOISE = 0.1  # of the error bound: smaller amplitudes are not followed


@dataclass(frozen=True, eq=False)
class Course:
    """The way of one board's channels ``u = sign V`` to their targets, ``e = u - target``.

    Attributes
    ----------
    solution : Exact
        Solution of a stable board, whose nodes are the channels.
    signs, target : ndarray (N,)
        Signs of the channels, and their reference steady state, V.
    target_error : float
        Error of the target, V, which adds to the bounds of the solution.
    detail : float
        Amplitude of a mode below which the first grid does not resolve it, V.
    level : float
        Error that a maximum may have where several intervals may hold it, V; rounding if smaller.
    """

    solution: Exact
    signs: Floats
    target: Floats
    target_error: float
    detail: float
    level: float = 0.0

    @functools.cached_property
    def ends(self) -> Floats:
        """Errors at the end of time, V, (N,)."""
        return np.asarray(self.solution.final * self.signs - self.target)

    @functools.cached_property
    def noise(self) -> float:
        """Amplitude that is not followed, V."""
        largest = float(np.abs([self.solution.start, self.solution.final]).max(initial=0.0))
        return NOISE * (self.solution.error + self.target_error + EPS * largest)

    @functools.cached_property
    def weight(self) -> Floats:
        """Largest share of every mode in every channel, V, (m, N)."""
        return np.abs(self.solution.flow.share)

    @functools.cached_property
    def _lost(self) -> tuple[Floats, Floats]:
        return self._fastest(self.noise)

    def _fastest(self, level: float) -> tuple[Floats, Floats]:
        """Return instants (m,) at which modes fall below `level`, and the fastest |p| before each.

        The last rate, of the time after all instants, is 0.
        """
        flow = self.solution.flow
        with np.errstate(divide="ignore"):
            lives = np.log(level / self.weight.max(axis=1, initial=0.0)) / flow.rates
        lives = np.maximum(lives, 0.0)
        order = np.argsort(lives)
        rates = np.append(flow.speeds[order], 0.0)
        return lives[order], np.maximum.accumulate(rates[::-1])[::-1]

    def rate(self, times: Floats) -> Floats:
        """Return |p| of the fastest mode above the noise at `times` (Q,), 1/s."""
        lost, fastest = self._lost
        return np.asarray(fastest[np.searchsorted(lost, times, side="right")])

    def first_grid(self) -> Floats:
        """Return instants that resolve modes above `detail`, at least `PER_OCTAVE` to an octave.

        From rest on all modes nearly cancel, and what is left may turn well before any of them.
        """
        lives, rates = self._fastest(self.detail)
        shortest = 1.0 / float(self.solution.flow.speeds.max(initial=1.0))
        begin = np.append(0.0, lives[:-1])
        some = np.flatnonzero(lives > begin)
        begin, end, step = begin[some], lives[some], FINENESS / rates[some]
        if not some.size:
            return np.unique(np.append(shortest * EARLY, [0.0, shortest]))
        even = np.minimum(np.maximum(PER_OCTAVE * step, begin), end)
        ends = np.stack([begin, even, end], axis=1)
        counts = np.ceil([(even - begin) / step, PER_OCTAVE * np.log(end / even)])
        grid = _between(ends, counts.T.astype(np.int64))
        return np.unique(np.concatenate([[0.0], shortest * EARLY, grid]))

    def later(self, begin: float) -> Floats:
        """Return instants after the last of a grid, `begin`, s, until all modes are noise."""
        slowest = float(self.solution.flow.rates[0])
        left = float(self.remainder(begin).max(initial=0.0))
        end = begin + math.log(max(left / self.noise, 1.0)) / -slowest
        end = LONGER * max(begin, end)
        count = math.ceil(PER_OCTAVE * math.log(end / begin))
        return _between(np.array([[begin, begin, end]]), np.array([[0, count]]))

    def evaluate(self, times: Floats) -> tuple[Floats, Floats, Floats]:
        """Return errors, slopes and bounds at `times`, (Q, N) each."""
        values, slopes = self.solution.flow.pair(times)
        bounds = self.solution.bounds(times) + self.target_error
        return values * self.signs + self.ends, slopes * self.signs, bounds

    def remainder(self, time: float) -> Floats:
        """Return a bound (N,) on what the modes have left after `time`, V."""
        return np.asarray(np.exp(self.solution.flow.rates * time) @ self.weight)

    def room(self, begin: Floats, width: Floats) -> tuple[Floats, Bools]:
        """Bound what lies between the channels and the cubics through values and slopes, V, (Q, N).

        The intervals (Q,) have a `width` each, s. Of a mode slower than the width the fourth
        derivative counts, of a faster one its envelope and the cubic through it. The second result
        tells where such a mode is above `detail`, so that `envelopes` are the better bounds.
        """
        flow = self.solution.flow
        angle, size = flow.speeds * width[:, None], np.exp(flow.rates * begin[:, None])
        most = 2.0 + 0.3 * angle
        slow, fast = size * np.minimum(angle**4 / 384.0, most), np.where(angle > SEEN, size, 0.0)
        rings = (fast @ self.weight.max(axis=1, initial=0.0)) > self.detail
        return np.asarray(slow @ self.weight), np.asarray(rings)

    def envelopes(self, begin: Floats, end: Floats) -> Floats:
        """Bound ``e`` and ``-e`` in intervals (Q,) by chords of slow modes and envelopes of others.

        Returns the bounds, V, (Q, 2, N).
        """
        flow, width = self.solution.flow, (end - begin)[:, None]
        seen = flow.speeds * width <= SEEN
        size, share = np.exp(flow.rates * begin[:, None]), flow.share * self.signs
        still = [
            (shape * seen).real @ share.real - (shape * seen).imag @ share.imag
            for shape in (flow.basis(begin), flow.basis(end))
        ]
        bend = np.where(seen, (flow.speeds * width) ** 2 / 8.0, 1.0)
        room = (size * bend) @ self.weight
        high = np.maximum(*still) + self.ends + room
        return np.stack([high, room - np.minimum(*still) - self.ends], axis=1)


def _between(ends: Floats, counts: Ints) -> Floats:
    """Return instants of pieces of time, s, one after the other, each without its begin.

    From the first of its `ends` (Q, 3) to the second a piece has so many even steps as the first of
    its `counts` (Q, 2), from there to the third so many steps in geometric progression as the
    second.
    """
    count = counts.ravel()
    which = np.repeat(np.arange(len(count)), count)
    last = np.cumsum(count)
    share = (np.arange(len(which)) + 1 - (last - count)[which]) / count[which]
    begin, end = ends[:, :2].ravel()[which], ends[:, 1:].ravel()[which]
    curved = which % 2 == 1
    found = begin + (end - begin) * share
    found[curved] = begin[curved] * (end[curved] / begin[curved]) ** share[curved]
    found[last[count > 0] - 1] = ends[:, 1:].ravel()[count > 0]
    return found
