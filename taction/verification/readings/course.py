"""The ways of boards' channels to their targets, with bounds and the instants that resolve them.

The numbers of many boards stand in the same arrays, so that each step of a search is some array
operations over all boards. Sums over modes are products of each board's own matrices.
"""

from __future__ import annotations

import functools
import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from itertools import pairwise
from typing import Any

import numpy as np
from numpy.typing import NDArray

from taction.system.array_types import EPS, Bools, Complexes, Floats, Ints
from taction.verification.engines.statespace.transients.exact import Exact

FINENESS = 0.25  # step times |p| of the fastest mode of a resolved interval: 25 points a period
PER_OCTAVE = 32  # over ln 2: the step is at most this part of the time
SEEN = 2.0  # width times |p| up to which a chord bounds a mode better than its envelope
LONGER = 1.1  # times the end of the grid: the least next end
EARLY = 4.0 ** -np.arange(13, 1, -1)  # of the fastest mode's time constant: the first instants
NOISE = 0.1  # of the error bound: smaller amplitudes are not followed
BLOCK = 1 << 18  # modes times instants that are evaluated together


@dataclass(frozen=True, eq=False)
class Course:
    """The way of one board's channels ``u = sign V`` to their targets, ``e = u - target``."""

    solution: Exact  # solution of a stable board, whose nodes are the channels
    # `signs`, `target`: (N,): signs of the channels, and their reference steady state, V.
    signs: Floats
    target: Floats
    target_error: float  # error of the target, V, which adds to the bounds of the solution
    detail: float  # amplitude of a mode below which the first grid does not resolve it, V
    # Error that a maximum may have where several intervals may hold it, V; rounding if smaller.
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


def _stacked(parts: Sequence[NDArray[Any]]) -> NDArray[Any]:
    """Return arrays of the boards as one, with zeros behind each.

    Of arrays (m_k,) that is (m, boards), of arrays (m_k, N) it is (boards, N, m).
    """
    counts = np.array([len(part) for part in parts])
    inside = np.arange(counts.max()) < counts[:, None]
    found = np.zeros((*inside.shape, *parts[0].shape[1:]), parts[0].dtype)
    found[inside] = np.concatenate(parts)
    return np.ascontiguousarray(found.T if found.ndim == 2 else found.swapaxes(1, 2))


class Courses:
    """The courses of boards with equally many channels, N.

    Instants (Q,) belong each to a board; where a function divides them by boards (all but `rate`
    and `sums`), the boards rise.

    Attributes
    ----------
    ends : ndarray (boards, N)
        Errors at the end of time, V.
    noise, detail, level : ndarray (boards,)
        See `Course`, V; no level is below the noise.
    """

    def __init__(self, courses: Sequence[Course]) -> None:
        flows = [course.solution.flow for course in courses]
        self._courses, self.channels = courses, len(courses[0].signs)
        self.ends = np.array([course.ends for course in courses])
        self.noise = np.array([course.noise for course in courses])
        self.detail = np.array([course.detail for course in courses])
        self.level = np.maximum([course.level for course in courses], self.noise)
        self._poles = _stacked([flow.poles for flow in flows])
        self._powers = _stacked([flow.powers for flow in flows])
        self._scales = _stacked([flow.scales for flow in flows])
        self._rates = _stacked([flow.rates for flow in flows])
        self._speeds = _stacked([flow.speeds for flow in flows])
        self._share = _stacked(
            [flow.share * c.signs for flow, c in zip(flows, courses, strict=True)]
        )
        self._weight = np.abs(self._share)
        self._largest = np.ascontiguousarray(self._weight.max(axis=1, initial=0.0).T)
        self._highest = int(self._powers.max(initial=0))

    @functools.cached_property
    def _shares(self) -> list[Complexes]:
        """Shares of the values and of two time derivatives, (boards, N, m) each."""
        found, poles, scales = [self._share], self._poles.T[:, None], self._scales.T[:, None]
        for _ in range(2):
            after = np.zeros_like(self._share)
            after[:, :, :-1] = np.where(self._powers.T[:, None, 1:] > 0, found[-1][:, :, 1:], 0.0)
            found.append(found[-1] * poles + scales * after)
        return found

    def _basis(self, times: Floats, board: Ints) -> Complexes:
        """Return the terms with shares of 1 at `times` (Q,), (m, Q)."""
        basis: Complexes = np.exp(self._poles[:, board] * times)
        for k in range(1, self._highest + 1):
            rows = np.flatnonzero((self._powers >= k).any(axis=1))
            grown = self._scales[np.ix_(rows, board)] * times / k
            basis[rows] *= np.where(self._powers[np.ix_(rows, board)] >= k, grown, 1.0)
        return basis

    @property
    def count(self) -> int:
        """Number of boards."""
        return len(self._courses)

    @functools.cached_property
    def end_bounds(self) -> Floats:
        """Bounds of the error of `ends`, V, (boards, N)."""
        parts = [each.solution.rest_error + each.target_error for each in self._courses]
        return np.array(parts)

    def each(self, board: Ints) -> Iterator[tuple[int, slice]]:
        """Yield the boards of a rising list, and where each stands in it."""
        begins = np.searchsorted(board, np.arange(self.count + 1)).tolist()
        for k, (begin, end) in enumerate(pairwise(begins)):
            if begin < end:
                yield k, slice(begin, end)

    def _blocks(self, board: Ints) -> Iterator[slice]:
        """Yield parts of a rising list of instants that are evaluated together."""
        length = max(BLOCK // max(len(self._rates), 1), 1)
        for first in range(0, len(board), length):
            yield slice(first, first + length)

    def _sums(self, left: Complexes | Floats, weight: Complexes | Floats, board: Ints) -> Floats:
        """Return the real part of sums over terms (m, Q) with weights (boards, N, m); (Q, N)."""
        found = np.empty((len(board), self.channels))
        for k, some in self.each(board):
            a, b = left[:, some].T, weight[k].T
            found[some] = a.real @ b.real
            if np.iscomplexobj(a) and np.iscomplexobj(b):
                found[some] -= a.imag @ b.imag
        return found

    def _lives(self, level: Floats) -> Floats:
        """Return instants at which modes fall below a `level` (boards,), s, (m, boards)."""
        with np.errstate(divide="ignore", invalid="ignore"):
            lives = np.log(level / self._largest) / self._rates
        return np.where(self._largest > 0.0, np.maximum(lives, 0.0), 0.0)

    @functools.cached_property
    def _lost(self) -> Floats:
        return self._lives(self.noise)

    def rate(self, times: Floats, board: Ints) -> Floats:
        """Return |p| of the fastest mode above the noise at `times` (Q,), 1/s."""
        heard = self._lost[:, board] > times
        return np.asarray(np.where(heard, self._speeds[:, board], 0.0).max(axis=0, initial=0.0))

    def first_grids(self) -> tuple[Floats, Ints]:
        """Return instants that resolve modes above `detail`, and the board of each.

        There are at least `PER_OCTAVE` to an octave. From rest on all modes nearly cancel, and what
        is left may turn well before any of them.
        """
        lives, every = self._lives(self.detail).T, np.arange(self.count)
        order = np.argsort(lives, axis=1)
        lives = np.take_along_axis(lives, order, axis=1)
        rates = np.take_along_axis(self._speeds.T, order, axis=1)
        rates = np.maximum.accumulate(rates[:, ::-1], axis=1)[:, ::-1]  # of modes that live on
        before = np.concatenate([np.zeros((self.count, 1)), lives], axis=1)[:, :-1]
        board, mode = np.nonzero(lives > before)
        begin, end, step = before[board, mode], lives[board, mode], FINENESS / rates[board, mode]
        even = np.minimum(np.maximum(PER_OCTAVE * step, begin), end)
        counts = np.ceil([(even - begin) / step, PER_OCTAVE * np.log(end / even)]).T
        counts = counts.astype(np.int64)
        grid = _between(np.stack([begin, even, end], axis=1), counts)
        shortest = 1.0 / self._speeds.max(axis=0, initial=1.0)
        empty = np.setdiff1d(every, board)
        parts = [np.zeros(self.count), np.outer(shortest, EARLY).ravel(), shortest[empty], grid]
        owners = [every, np.repeat(every, len(EARLY)), empty, np.repeat(board, counts.sum(axis=1))]
        time, owner = np.concatenate(parts), np.concatenate(owners)
        order = np.lexsort((time, owner))
        time, owner = time[order], owner[order]
        new = np.append(True, (time[1:] != time[:-1]) | (owner[1:] != owner[:-1]))
        return time[new], owner[new]

    def later(self, k: int, begin: float) -> Floats:
        """Return instants after the last of a grid of board k, until all its modes are noise, s."""
        slowest = float(self._rates[0, k])
        left = float(self.remainder(np.array([begin]), np.array([k])).max(initial=0.0))
        end = begin + math.log(max(left / float(self.noise[k]), 1.0)) / -slowest
        end = LONGER * max(begin, end)
        count = math.ceil(PER_OCTAVE * math.log(end / begin))
        return _between(np.array([[begin, begin, end]]), np.array([[0, count]]))

    def evaluate(self, times: Floats, board: Ints) -> tuple[Floats, Floats]:
        """Return errors and slopes at `times`, (Q, N) each."""
        values, slopes = np.empty((2, len(times), self.channels))
        for some in self._blocks(board):
            basis, of = self._basis(times[some], board[some]), board[some]
            values[some] = self._sums(basis, self._shares[0], of)
            slopes[some] = self._sums(basis, self._shares[1], of)
        return values + self.ends[board], slopes

    @functools.cached_property
    def _bound_terms(self) -> tuple[Floats, Floats, Floats, Floats]:
        """Rates (m, boards), lags and errors (boards, N, m), and errors that stay (boards, N)."""
        parts = [course.solution.flow.bound_terms for course in self._courses]
        rates, lag, vague, omitted = (list(each) for each in zip(*parts, strict=True))
        return _stacked(rates), _stacked(lag), _stacked(vague), np.array(omitted) + self.end_bounds

    def bounds(self, times: Floats, board: Ints) -> Floats:
        """Return bounds on the error of the errors at `times`, V, (Q, N)."""
        rates, lag, vague, rest = self._bound_terms
        found = rest[board]
        for some in self._blocks(board):
            at, of = times[some], board[some]
            left = np.exp(rates[:, of] * at)
            found[some] += self._sums(at * left, lag, of) + self._sums(left, vague, of)
        return found

    def sums(self, times: Floats, board: Ints, channel: Ints, order: int) -> tuple[Floats, Floats]:
        """Return derivatives of two orders from `order` of one channel at each time, (Q,)."""
        basis = self._basis(times, board)
        first, second = (
            np.einsum("mq,qm->q", basis, self._shares[order + k][board, channel]).real
            for k in range(2)
        )
        return (first, second) if order else (first + self.ends[board, channel], second)

    def remainder(self, times: Floats, board: Ints) -> Floats:
        """Return bounds on what the modes have left after `times`, V, (Q, N)."""
        found = np.empty((len(times), self.channels))
        for some in self._blocks(board):
            of = board[some]
            size = np.exp(self._rates[:, of] * times[some])
            found[some] = self._sums(size, self._weight, of)
        return found

    def room(self, begin: Floats, width: Floats, board: Ints) -> tuple[Floats, Bools]:
        """Bound what lies between the channels and the cubics through values and slopes, V, (Q, N).

        The intervals (Q,) have a `width` each, s. Of a mode slower than the width the fourth
        derivative counts, of a faster one its envelope and the cubic through it. The second result
        tells where such a mode is above `detail`, so that `envelopes` are the better bounds.
        """
        room, loud = np.empty((len(begin), self.channels)), np.empty(len(begin))
        for some in self._blocks(board):
            of = board[some]
            angle = self._speeds[:, of] * width[some]
            size, most = np.exp(self._rates[:, of] * begin[some]), 2.0 + 0.3 * angle
            slow, fast = size * np.minimum(angle**4 / 384.0, most), np.where(angle > SEEN, size, 0)
            room[some] = self._sums(slow, self._weight, of)
            loud[some] = (fast * self._largest[:, of]).sum(axis=0)
        return room, loud > self.detail[board]

    def envelopes(self, begin: Floats, end: Floats, board: Ints) -> Floats:
        """Bound ``e`` and ``-e`` in intervals (Q,) by chords of slow modes and envelopes of others.

        Returns the bounds, V, (Q, 2, N).
        """
        found = np.empty((len(begin), 2, self.channels))
        for some in self._blocks(board):
            first, last, of = begin[some], end[some], board[some]
            angle = self._speeds[:, of] * (last - first)
            ends, seen = self.ends[of], angle <= SEEN
            still = np.stack(
                [self._sums(self._basis(at, of) * seen, self._share, of) for at in (first, last)]
            )
            bend = np.where(seen, angle**2 / 8.0, 1.0)
            room = self._sums(np.exp(self._rates[:, of] * first) * bend, self._weight, of)
            found[some, 0] = still.max(axis=0) + ends + room
            found[some, 1] = room - still.min(axis=0) - ends
        return found


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
