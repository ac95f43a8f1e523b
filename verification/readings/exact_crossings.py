"""Crossings and peaks of an exact transient, by bounds and root finding on the solution itself.

A search starts with the intervals of a grid (see `exact_grid`) and their upper bounds. While the
interval that may hold the crossing or the peak does not resolve the ringing, it is divided. Then
the instant is refined on the continuous solution. No instant is left out, and no horizon has to be
chosen: the interval after the last point counts like any other.
"""

from __future__ import annotations

import numpy as np

from taction.system.array_types import Floats, Ints
from taction.verification.engines.statespace.transients.exact import Exact
from taction.verification.readings.crossings import Crossings
from taction.verification.readings.exact_grid import ExactGrid

ROUNDS = 200  # largest number of rounds of one search
TOGETHER = 32  # intervals that a search for a maximum divides in one round
EPS = float(np.finfo(np.float64).eps)


class ExactSignal:
    """Errors of the channels ``u = sign V`` of an exact solution, a `measures.readings.Signal`.

    Parameters
    ----------
    solution : Exact
        Solution of a stable board, whose nodes are the channels.
    signs, target : ndarray (N,)
        Signs of the channels, and their reference steady state, V.
    target_error : float
        Error of the target, V, which adds to the bounds of the solution.
    detail : float
        Amplitude of a mode below which the first grid does not resolve it, V.
    """

    def __init__(
        self, solution: Exact, signs: Floats, target: Floats, target_error: float, detail: float
    ) -> None:
        self.grid = ExactGrid(solution, signs, target, target_error, detail)
        self.ends = self.grid.ends
        # (instant, height) by side (0: of e, 1: of -e), channel, and instant before
        self.peaks: dict[tuple[int, int, float], tuple[float, float]] = {}

    @property
    def end_bounds(self) -> Floats:
        """See `Signal`."""
        return np.asarray(self.grid.solution.rest_error + self.grid.target_error)

    def last_outside(self, levels: Floats, shifts: Floats) -> Crossings:
        """See `Signal`."""
        shape = (2, len(levels), len(self.ends))
        side, j, channel = (part.ravel() for part in np.indices(shape))
        found = _Search(self, side, channel, levels[j], shifts[j], last=True).run()
        (up, down), (doubt_up, doubt_down) = (part.reshape(shape) for part in found)
        later = np.fmax(up, down)
        return Crossings(later, np.where(later == down, doubt_down, doubt_up))

    def first_reached(self, rows: Ints, steps: Floats, levels: Floats, shifts: Floats) -> Crossings:
        """See `Signal`."""
        shape = (len(levels), len(rows))
        j, r = (part.ravel() for part in np.indices(shape))
        level, side = (levels[j] - 1.0) * np.abs(steps[r]), (steps[r] < 0.0).astype(np.int64)
        found = _Search(self, side, rows[r], level, shifts[j], last=False).run()
        return Crossings(*(part.reshape(shape) for part in found))

    def highest(self, sign: float) -> tuple[Floats, Floats]:
        """See `Signal`."""
        grid, side = self.grid, int(sign < 0.0)
        best, every = sign * self.ends, np.arange(len(self.ends))
        for _ in range(ROUNDS):
            best = np.maximum(best, (sign * grid.errors).max(axis=0))
            place, channel = np.nonzero(grid.caps[side] > best + grid.noise)
            fine = grid.resolved[place]
            if fine.any():
                sides = np.full(np.count_nonzero(fine), side)
                heights = self.peak(sides, place[fine], channel[fine])[1]
                np.maximum.at(best, channel[fine], heights)
            above = grid.caps[side][place, channel] - best[channel] - grid.noise
            coarse = np.flatnonzero(~fine & (above > 0.0))
            widest = coarse[np.argsort(-above[coarse])[:TOGETHER]]
            if not (widest.size and self.refine(place[widest])):
                break
        reached = grid.caps[side] + grid.reach
        lowest = grid.reach[grid.caps[side].argmax(axis=0), every]
        return best, np.maximum(reached.max(axis=0) - best, lowest)

    def peak(self, side: Ints, k: Ints, n: Ints) -> tuple[Floats, Floats]:
        """Return instants and heights of the peaks of channels n in the resolved intervals k.

        The heights replace the bounds of the intervals.
        """
        grid = self.grid
        keys = list(zip(side.tolist(), n.tolist(), grid.time[k].tolist(), strict=True))
        new = np.array([i for i, key in enumerate(keys) if key not in self.peaks], dtype=np.int64)
        if new.size:
            place, channel, sign = k[new], n[new], 1.0 - 2.0 * side[new]
            at = grid.roots(channel, np.zeros(len(new)), grid.time[place], grid.time[place + 1], 1)
            height = sign * grid.value(channel, at)
            for end in (place, place + 1):
                height = np.maximum(height, sign * grid.errors[end, channel])
            grid.caps[side[new], place, channel] = height
            found = zip(at.tolist(), height.tolist(), strict=True)
            self.peaks |= zip([keys[i] for i in new.tolist()], found, strict=True)
        instants, heights = np.array([self.peaks[key] for key in keys]).T
        return instants, heights

    def refine(self, places: Ints) -> bool:
        """Divide intervals; return False if none of them can be divided further."""
        last = len(self.grid.time) - 1
        left = self.grid.remainder(float(self.grid.time[last])).max(initial=0.0)
        places = np.unique(places if left > self.grid.noise else places[places < last])
        return places.size > 0 and self.grid.refine(places)


class _Search:
    """A search for the last, or the first, instants at which channels (Q,) are above levels (Q,).

    They are searches of ``e`` (side 0) or ``-e`` (side 1), shifted up by `shift` times its bound.
    """

    def __init__(
        self,
        signal: ExactSignal,
        side: Ints,
        channel: Ints,
        level: Floats,
        shift: Floats,
        *,
        last: bool,
    ) -> None:
        self.signal, self.grid, self.side, self.last = signal, signal.grid, side, last
        self.sign = 1.0 - 2.0 * side
        self.channel, self.level, self.shift = channel, level, shift

    def run(self) -> Crossings:
        """Return the instants.

        NaN for a channel that never is above; the last point for a channel that ends above and is
        searched for its last instant; infinite uncertainty for an instant that the rounding of the
        solution, or the size of the grid, leaves open.
        """
        grid = self.grid
        above, below, doubt, moved = np.full((4, len(self.channel)), np.nan)
        left = np.arange(len(self.channel))
        for _ in range(ROUNDS):
            left, k = self._candidates(left)
            if not left.size:
                break
            n, tail = self.channel[left], k == len(grid.time) - 1
            above[left] = self._above(left, k)
            below[left] = grid.time[np.minimum(k + self.last, len(grid.time) - 1)]
            moved[left] = self.shift[left] * grid.reach[k, n]
            coarse, done = ~grid.resolved[k], ~np.isnan(above[left])
            if self.last:
                off = self.sign[left] * self.signal.ends[n] + moved[left]
                ends = tail & (off > self.level[left])
                above[left[ends]], coarse, done = grid.time[-1], coarse & ~ends, done | ends
            if coarse.any() and not self.signal.refine(k[coarse]):
                doubt[left[coarse]] = np.inf
                above[left[coarse]] = grid.time[k[coarse]] if self.last else np.nan
                done |= coarse
            left = left[~done]
        between = np.flatnonzero(~np.isnan(above) & (above != below))
        low, high = np.sort([above[between], below[between]], axis=0)
        level = (self.sign * (self.level - moved))[between]
        above[between] = grid.roots(self.channel[between], level, low, high, 0)
        rounding = np.fmax(np.spacing(np.abs(above)), EPS * grid.time[1])
        return Crossings(above, np.fmax(doubt, rounding))

    def _candidates(self, left: Ints) -> tuple[Ints, Ints]:
        """Return the searches of `left` that have an interval above their level, and the interval.

        It is the last, or the first, of all such intervals.
        """
        n = self.channel[left]
        caps, reach = self.grid.caps, self.grid.reach
        bound = caps[self.side[left], :, n].T + self.shift[left] * reach[:, n]
        over = bound > self.level[left]
        end = len(over) - 1
        k = end - over[::-1].argmax(axis=0) if self.last else over.argmax(axis=0)
        found = over[k, np.arange(len(left))]
        return left[found], k[found]

    def _above(self, left: Ints, k: Ints) -> Floats:
        """Return instants in the resolved of intervals `k` at which the channels are above."""
        grid, n, limit = self.grid, self.channel[left], self.level[left]
        sign, shift = self.sign[left], self.shift[left]
        at = np.full(len(k), np.nan)
        points = (k,) if self.last else (np.minimum(k + 1, len(grid.time) - 1), k)
        for point in points:
            value = sign * grid.errors[point, n] + shift * grid.bounds[point, n]
            at = np.where(value > limit, grid.time[point], at)
        at[~grid.resolved[k]] = np.nan
        hidden = np.flatnonzero(grid.resolved[k] & np.isnan(at))
        if hidden.size:
            place, channel = k[hidden], n[hidden]
            instant, height = self.signal.peak(self.side[left[hidden]], place, channel)
            height = height + shift[hidden] * grid.reach[place, channel]
            at[hidden] = np.where(height > limit[hidden], instant, np.nan)
        return at
