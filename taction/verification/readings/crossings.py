"""Level crossings and peaks between the points of sampled waveforms, with their uncertainty.

Samples count as exact. Between samples, a cubic through the four nearest points gives the value,
and the distance of the cubic from two parabolas and from the chord gives the uncertainty. The
uncertainty of a crossing's time is the time in which the cubic passes through its uncertainty in
value, so a shallow crossing is more uncertain than a steep crossing. A peak that reaches the level
only within its uncertainty counts as well.

Many waveforms (R rows) are searched for many levels (J per row) at once. The largest value from
each point on never rises, so a bisection finds the last point above each level.
"""

from __future__ import annotations

from itertools import pairwise
from typing import NamedTuple

import numpy as np

from taction.system.array_types import Floats, Indices

# The fine grid on which a bracketed crossing is located before a last linear step.
_GRID = np.linspace(0.0, 1.0, 129)
_STENCIL = np.arange(4)[:, None]
_SIGNS = np.array([0.0, -1.0, 1.0])[:, None]
# A peak whose sample is below this fraction of a positive level does not reach it between points.
_NEAR = 0.5


class Crossings(NamedTuple):
    """Instants and uncertainties of many crossings, s, of one shape; NaN for no crossing."""

    time: Floats
    uncertainty: Floats


class Peaks(NamedTuple):
    """Local maxima, (M,) each: instant, height and uncertainty of the height."""

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


def peaks(time: Floats, y: Floats, row: Indices, k: Indices) -> Peaks:
    """Interpolate the inner points `k` of waveforms `row`, (M,) each, which are local maxima."""
    t, here = time[k], y[row, k]
    before, after = t - time[k - 1], time[k + 1] - t
    fall_l, fall_r = (here - y[row, k - 1]) / before, (here - y[row, k + 1]) / after
    curvature = fall_l + fall_r
    flat = curvature <= 0
    offset = np.where(flat, 0.0, (fall_l * after - fall_r * before) / np.where(flat, 1, curvature))
    at = t + 0.5 * np.minimum(np.maximum(offset, -before), after)
    value, doubt = interpolate(time, y, row, k - (at < t), at[:, None])
    return Peaks(at, np.maximum(value[:, 0], here), doubt[:, 0])


def maxima(y: Floats, floor: Floats) -> tuple[Indices, Indices]:
    """Return the rows and the inner points of local maxima of y (R, P) above a `floor` (R,)."""
    here = y[:, 1:-1]
    top = (here > floor[:, None]) & (here >= y[:, :-2]) & (here >= y[:, 2:])
    row, k = np.nonzero(top)
    return row, k + 1


def highest(time: Floats, y: Floats) -> tuple[Floats, Floats]:
    """Return the maximum of each row, a peak between points included.

    Parameters
    ----------
    time, y : ndarray (P,) and (R, P)
        Record, P at least 4.

    Returns
    -------
    ndarray (R,) and ndarray (R,)
        The maxima and their uncertainty, in the unit of `y`.
    """
    heights, doubts = y.max(axis=1), np.zeros(len(y))
    five = np.clip(y.argmax(axis=1)[:, None] + np.arange(-2, 3), 1, time.size - 2)
    row, k = np.repeat(np.arange(len(y)), 5), five.ravel()
    top = (y[row, k] >= y[row, k - 1]) & (y[row, k] >= y[row, k + 1])
    row, k = row[top], k[top]
    near = peaks(time, y, row, k)
    np.maximum.at(heights, row, near.height)
    np.maximum.at(doubts, row, near.uncertainty)
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


def _falls(time: Floats, y: Floats, row: Indices, level: Floats, since: Floats) -> Crossings:
    """Locate falls of ``y[row]`` through `level` from `since` to the next point, (S,)."""
    interval = np.minimum(np.searchsorted(time, since, side="right"), time.size - 1) - 1
    rest = time[interval + 1] - since
    value, doubt = interpolate(time, y, row, interval, since[:, None] + rest[:, None] * _GRID)
    excess = value - level[:, None]
    part = _last_positive(np.concatenate([excess, excess - doubt, excess + doubt]))
    at, early, late = since + rest * part.reshape(3, -1)
    width = np.maximum(at - early, late - at)
    return Crossings(at, np.maximum(width, np.spacing(np.abs(at))))


def _latest(at: Floats, height: Floats, levels: Floats) -> Floats:
    """Return the last of the instants `at` (M,) with a `height` (M,) above each level, or -inf."""
    rising = np.maximum.accumulate(height[::-1])
    return np.append(at[::-1], -np.inf)[rising.searchsorted(levels, side="right")]


def last_crossings(time: Floats, y: Floats, levels: Floats) -> Crossings:
    """Find the last instants at which waveforms are above their levels.

    Parameters
    ----------
    time, y : ndarray (P,) and (R, P)
        Record, P at least 4; s and any unit.
    levels : ndarray (J, R)
        In the unit of `y`.

    Returns
    -------
    Crossings
        Shape (J, R). NaN for a row that is never above; the last point, with uncertainty 0, for a
        row that ends above. A later peak that reaches the level only between points, or only within
        its uncertainty, counts: in the instant if the interpolated peak is above, in the
        uncertainty in any case.
    """
    low = levels.min(axis=0)
    row, k = maxima(y, low - (1 - _NEAR) * np.abs(low))
    top, value = peaks(time, y, row, k), y[row, k]
    # As interpolated, and with the uncertainty subtracted and added.
    heights = top.height + _SIGNS * top.uncertainty
    heights = np.minimum(heights, value / np.where(value > 0, _NEAR, 2 - _NEAR))
    starts = np.empty((3, *levels.shape))
    ends = row.searchsorted(np.arange(len(y) + 1))
    for n, (begin, end) in enumerate(pairwise(ends.tolist())):
        over = np.flatnonzero(y[n] > low[n])
        sampled = _latest(time[over], y[n, over], levels[:, n])
        for start, height in zip(starts, heights, strict=True):
            between = _latest(top.time[begin:end], height[begin:end], levels[:, n])
            start[:, n] = np.maximum(sampled, between)
    return _crossings(time, y, levels, starts)


def _crossings(time: Floats, y: Floats, levels: Floats, starts: Floats) -> Crossings:
    """Locate falls after the instants `starts` (3, J, R): likely, and two possible instants."""
    start = starts[0]
    ends = y[:, -1] > levels
    inside = ~ends & (starts > -np.inf)
    at, doubt = np.where(ends, time[-1], np.nan), np.where(ends, 0.0, np.nan)
    places = np.nonzero(inside[0])
    at[places], doubt[places] = _falls(time, y, places[1], levels[places], start[places])
    rivals = inside[0] & inside & (starts != start)
    for other in np.flatnonzero(rivals.any(axis=(1, 2))):
        places = np.nonzero(rivals[other])
        rival = _falls(time, y, places[1], levels[places], starts[other][places])
        apart = np.abs(rival.time - at[places]) + rival.uncertainty
        doubt[places] = np.maximum(doubt[places], apart)
    return Crossings(at, doubt)


def first_crossings(time: Floats, y: Floats, levels: Floats) -> Crossings:
    """Find the first instants above; `last_crossings` with time reversed."""
    found = last_crossings(-time[::-1], y[:, ::-1], levels)
    return Crossings(-found.time, found.uncertainty)
