"""Level crossings and peaks between the points of sampled waveforms, with their uncertainty.

Samples count as exact. Between samples, a cubic through the four nearest points gives the value,
and the distance of the cubic from two parabolas and from the chord gives the uncertainty. The
uncertainty of a crossing's time is the time in which the cubic passes through its uncertainty in
value, so a shallow crossing is more uncertain than a steep crossing. A peak that reaches the level
only within its uncertainty counts as well.

Many waveforms (R rows) are searched for many levels (J per row) at once: a few array operations
work on all the points near a level.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from taction.system.array_types import Bools, Floats, Indices

# The fine grid on which a bracketed crossing is located before a last linear step.
_GRID = np.linspace(0.0, 1.0, 129)
_STENCIL = np.arange(4)[:, None]
_AROUND = np.arange(-1, 2)[:, None]
_SIGNS = np.array([0.0, -1.0, 1.0])[:, None, None]
# A peak below this fraction of a positive level's height is not examined between its points.
_NEAR = 0.5
MOST_COMPARED = 4_000_000  # numbers of an array that compares points with levels: 32 MB


class Crossing(NamedTuple):
    """Instant of a crossing and its uncertainty, s."""

    time: float
    uncertainty: float


class Crossings(NamedTuple):
    """Instants and uncertainties of many crossings, s, of one shape; NaN for no crossing."""

    time: Floats
    uncertainty: Floats


class Peaks(NamedTuple):
    """Local maxima, (M,) each: index, instant, height and uncertainty of the height."""

    point: Indices
    time: Floats
    height: Floats
    uncertainty: Floats


def interpolate(
    time: Floats, y: Floats, row: Indices, interval: Indices, at: Floats
) -> tuple[Floats, Floats]:
    """Return the values of cubics and their uncertainties, both of shape (S, Q).

    The uncertainty is the larger of the distance to the two parabolas that leave out one outer
    point, and of a quarter of the distance to the chord. The parabolas show the third derivative,
    the chord the second; for a sinusoid of six points a period or more, one of the two is large
    wherever the error of the cubic is large.

    Parameters
    ----------
    time, y : ndarray (P,) and (R, P)
        Record, P at least 4; s and any unit.
    row, interval : ndarray (S,)
        Waveform, and the interval between two points, 0 to P - 2, to interpolate in.
    at : ndarray (S, Q)
        Instants in those intervals, s.
    """
    # minimum and maximum: for few instants np.clip costs as much as all other operations
    first = np.minimum(np.maximum(interval - 1, 0), time.size - 4)
    stencil = first + _STENCIL
    t0, t1, t2, t3 = time[stencil][:, :, None]
    y0, y1, y2, y3 = y[row, stencil][:, :, None]
    # Newton's divided differences, from the middle pair outwards.
    d12 = (y2 - y1) / (t2 - t1)
    d012 = (d12 - (y1 - y0) / (t1 - t0)) / (t2 - t0)
    d123 = ((y3 - y2) / (t3 - t2) - d12) / (t3 - t1)
    d0123 = (d123 - d012) / (t3 - t0)
    begin, end = time[interval][:, None], time[interval + 1][:, None]
    left, right = y[row, interval][:, None], y[row, interval + 1][:, None]
    after0, after1 = at - t0, at - t1
    middle = after1 * (at - t2)
    cubic = y1 + after1 * d12 + middle * (d012 + after0 * d0123)
    chord = left + (at - begin) * ((right - left) / (end - begin))
    outer = np.maximum(np.abs(after0), np.abs(at - t3))
    return cubic, np.maximum(np.abs(middle * d0123) * outer, 0.25 * np.abs(cubic - chord))


def peaks(time: Floats, y: Floats, row: Indices, k: Indices, sign: Floats) -> Peaks:
    """Interpolate those of the points `k` that are local maxima of ``sign * y[row]``, (S,) each."""
    inner = np.flatnonzero((k > 0) & (k < time.size - 1))
    around = sign[inner] * y[row[inner], k[inner] + _AROUND]
    top = np.flatnonzero((around[1] >= around[0]) & (around[1] >= around[2]))
    left, here, right = around[:, top]
    point = inner[top]
    k = k[point]
    t = time[k]
    before, after = t - time[k - 1], time[k + 1] - t
    fall_l, fall_r = (here - left) / before, (here - right) / after
    curvature = fall_l + fall_r
    flat = curvature <= 0
    offset = np.where(flat, 0.0, (fall_l * after - fall_r * before) / np.where(flat, 1, curvature))
    at = t + 0.5 * np.minimum(np.maximum(offset, -before), after)
    value, doubt = interpolate(time, y, row[point], k - (at < t), at[:, None])
    return Peaks(point, at, np.maximum(sign[point] * value[:, 0], here), doubt[:, 0])


def highest(time: Floats, y: Floats, sign: float) -> tuple[Floats, Floats]:
    """Return the maximum of each row of ``sign * y``, a peak between points included.

    Parameters
    ----------
    time, y : ndarray (P,) and (R, P)
        Record, P at least 4.
    sign : float
        1.0 or -1.0.

    Returns
    -------
    ndarray (R,) and ndarray (R,)
        The maxima and their uncertainty, in the unit of `y`.
    """
    row = np.arange(len(y))
    top = y.argmax(axis=1) if sign > 0 else y.argmin(axis=1)
    heights, doubts = sign * y[row, top], np.zeros(len(y))
    rows, five = np.repeat(row, 5), np.repeat(top, 5) + np.tile(np.arange(-2, 3), row.size)
    near = peaks(time, y, rows, five, np.full(rows.size, sign))
    np.maximum.at(heights, rows[near.point], near.height)
    np.maximum.at(doubts, rows[near.point], near.uncertainty)
    return heights, doubts


def _last_positive(f: Floats) -> Floats:
    """Return the last place, 0 to 1, where each row of `f` (S, Q) is positive; linear between."""
    last = f.shape[1] - 1
    row = np.arange(len(f))
    i = last - (f[:, ::-1] > 0).argmax(axis=1)
    here, beyond = f[row, i], f[row, np.minimum(i + 1, last)]
    falls = (here > 0) & (i < last)
    part = np.where(falls, here / np.where(falls, here - beyond, 1.0), 0.0)
    return np.where(here > 0, (i + part) / last, 0.0)


class _Sides(NamedTuple):
    """Columns ``sign * y[row]`` of a search, (C,) each."""

    row: Indices
    sign: Floats


def _falls(
    time: Floats, y: Floats, row: Indices, sign: Floats, level: Floats, since: Floats
) -> Crossings:
    """Locate falls of ``sign * y[row]`` through `level` from `since` to the next point, (S,)."""
    interval = np.minimum(np.searchsorted(time, since, side="right"), time.size - 1) - 1
    rest = time[interval + 1] - since
    value, doubt = interpolate(time, y, row, interval, since[:, None] + rest[:, None] * _GRID)
    excess = sign[:, None] * value - level[:, None]
    part = _last_positive(np.concatenate([excess, excess - doubt, excess + doubt]))
    at, early, late = since + rest * part.reshape(3, -1)
    width = np.maximum(at - early, late - at)
    return Crossings(at, np.maximum(width, np.spacing(np.abs(at))))


def _latest(mask: Bools, column: Indices, at: Floats, columns: int) -> Floats:
    """Return the last of `at` (M,) in each column, (..., C), where `mask` (..., M), or -inf."""
    latest = np.full((*mask.shape[:-1], columns), -np.inf)
    level, m = np.divmod(np.flatnonzero(mask), column.size)
    latest.reshape(-1, columns)[level, column[m]] = at[m]  # the last assignment stays
    return latest


def last_crossings(
    time: Floats, y: Floats, levels: Floats, first: Indices | None = None, *, mirrored: bool = False
) -> Crossings:
    """Find the last instants at which waveforms are above their levels.

    Parameters
    ----------
    time, y : ndarray (P,) and (R, P)
        Record, P at least 4; s and any unit.
    levels : ndarray (J, R)
        In the unit of `y`.
    first : ndarray (R,), optional
        First point of each row that is searched.
    mirrored : bool
        Whether ``-y`` is searched as well.

    Returns
    -------
    Crossings
        Shape (J, R), or (J, 2 R) with the crossings of ``-y`` last. NaN for a row that is never
        above; the last point, with uncertainty 0, for a row that ends above. A later peak that
        reaches the level only between points, or only within its uncertainty, counts: in the
        instant if the interpolated peak is above, in the uncertainty in any case.
    """
    rows, columns = len(y), len(y) * (1 + mirrored)  # all y[n], then all -y[n]
    sides = _Sides(np.arange(columns) % rows, np.repeat([1.0, -1.0], rows)[:columns])
    over = _beyond(y, levels.min(axis=0), first, mirrored)
    floor = levels - (1 - _NEAR) * np.abs(levels)
    near = _beyond(y, floor.min(axis=0), first, mirrored)
    near[:, 1:-1] &= _extremes(y, mirrored)
    if mirrored:
        levels, floor = (np.concatenate([each, each], axis=1) for each in (levels, floor))
    column, k = np.divmod(np.flatnonzero(over), time.size)
    value = sides.sign[column] * y[sides.row[column], k]
    sampled = np.concatenate(
        [
            _latest(value > levels[few][:, column], column, time[k], columns)
            for few in _blocks(len(levels), column.size)
        ]
    )
    column, k = np.divmod(np.flatnonzero(near), time.size)
    row, sign = sides.row[column], sides.sign[column]
    top = peaks(time, y, row, k, sign)
    value, column = (sign * y[row, k])[top.point], column[top.point]
    # As interpolated, and with the uncertainty subtracted and added.
    heights = top.height + _SIGNS * top.uncertainty
    found = []
    for few in _blocks(len(levels), 3 * column.size):
        high = value > floor[few][:, column]
        reached = heights > levels[few][:, column]
        found.append(_latest(high & reached, column, top.time, columns))
    starts = np.concatenate(found, axis=1)
    return _crossings(time, y, sides, levels, np.maximum(sampled, starts))


def _blocks(levels: int, points: int) -> list[slice]:
    """Return slices of the levels; in each, `points` make at most `MOST_COMPARED` numbers."""
    size = max(1, MOST_COMPARED // max(points, 1))
    return [slice(begin, begin + size) for begin in range(0, levels, size)]


def _beyond(y: Floats, low: Floats, first: Indices | None, mirrored: bool) -> Bools:
    """Mark the points from `first` on at which each row of y, then of -y, is above `low` (R,)."""
    low = low[:, None]
    above = np.concatenate([y > low, y < -low]) if mirrored else y > low
    if first is not None:
        for n, begin in enumerate(first.tolist()):
            above[n :: len(y), :begin] = False
    return above


def _extremes(y: Floats, mirrored: bool) -> Bools:
    """Mark the inner points that are local maxima of y and, if `mirrored`, then of -y."""
    up, down = y[:, 1:] >= y[:, :-1], y[:, 1:] <= y[:, :-1]
    maxima = up[:, :-1] & down[:, 1:]
    return np.concatenate([maxima, down[:, :-1] & up[:, 1:]]) if mirrored else maxima


def _crossings(time: Floats, y: Floats, sides: _Sides, levels: Floats, starts: Floats) -> Crossings:
    """Locate falls after the instants `starts` (3, J, C): likely, and two possible instants."""
    start = starts[0]
    ends = sides.sign * y[sides.row, -1] > levels
    inside = ~ends & (starts > -np.inf)
    at, doubt = np.where(ends, time[-1], np.nan), np.where(ends, 0.0, np.nan)

    def falls(since: Floats, level: Indices, column: Indices) -> Crossings:
        row, sign = sides.row[column], sides.sign[column]
        return _falls(time, y, row, sign, levels[level, column], since[level, column])

    places = np.nonzero(inside[0])
    at[places], doubt[places] = falls(start, *places)
    rivals = inside[0] & inside & (starts != start)
    for other in np.flatnonzero(rivals.any(axis=(1, 2))):
        places = np.nonzero(rivals[other])
        rival = falls(starts[other], *places)
        apart = np.abs(rival.time - at[places]) + rival.uncertainty
        doubt[places] = np.maximum(doubt[places], apart)
    return Crossings(at, doubt)


def first_crossings(
    time: Floats, y: Floats, levels: Floats, stop: Indices | None = None
) -> Crossings:
    """Find the first instants above; `last_crossings` with time reversed, up to `stop` (R,)."""
    first = None if stop is None else time.size - stop
    reversed_time = last_crossings(-time[::-1], y[:, ::-1], levels, first)
    return Crossings(-reversed_time.time, reversed_time.uncertainty)


def first_above(time: Floats, y: Floats, level: float) -> Crossing | None:
    """Find the first instant at which one waveform (P,) is above `level`, or None."""
    crossings = first_crossings(time, y[None], np.array([[level]]))
    at = crossings.time.item()
    return None if np.isnan(at) else Crossing(at, crossings.uncertainty.item())
