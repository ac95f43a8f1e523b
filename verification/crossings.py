"""Level crossings and peaks between the points of a sampled waveform, with their uncertainty.

Samples are taken as exact, the shape between them is not: a cubic through the four nearest points
gives the value, its distance from two parabolas and from the chord gives the doubt. A crossing's
doubt in time is the time the cubic takes to pass through its doubt in value, so a shallow crossing
is more uncertain than a steep one, and a peak that may or may not reach the level counts as well.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from verification.waveforms import Floats

# Points in the fine grid on which a bracketed crossing is located before a last linear step.
_GRID = 129
# A peak below this fraction of a positive level's height is not examined between its points.
_NEAR = 0.5


class Crossing(NamedTuple):
    """A crossing's instant and its uncertainty, both s."""

    time: float
    uncertainty: float


def lagrange(time: Floats, y: Floats, at: Floats, points: int) -> Floats:
    """Interpolate by the polynomial through the nearest points.

    Parameters
    ----------
    time : ndarray (P,)
        Strictly increasing, s; P is at least `points`.
    y : ndarray (P, K)
        Samples.
    at : ndarray (Q,)
        Instants wanted, s, inside the record.
    points : int
        Points in the stencil, even: 4 is the cubic.

    Returns
    -------
    ndarray (Q, K)
        Values at `at`.
    """
    first = np.searchsorted(time, at, side="right") - points // 2
    stencil = np.clip(first, 0, time.size - points)[:, None] + np.arange(points)
    nodes = time[stencil]
    weights = np.ones(stencil.shape)
    for j in range(points):
        for m in range(points):
            if m != j:
                weights[:, j] *= (at - nodes[:, m]) / (nodes[:, j] - nodes[:, m])
    return np.asarray(np.einsum("qp,qpk->qk", weights, y[stencil]), dtype=np.float64)


def interpolate(time: Floats, y: Floats, at: Floats) -> tuple[Floats, Floats]:
    """Return the cubic's values at `at` and how far they may be off, both of shape (Q,).

    The doubt is the largest distance to the two parabolas that leave out one outer point, or a
    quarter of the distance to the chord: the parabolas see the third derivative, the chord the
    second, and for a sinusoid one of them is large wherever the cubic's own error is (down to
    six points a period).
    """
    # minimum and maximum: for a handful of instants np.clip costs as much as all the rest
    interval = np.minimum(np.maximum(time.searchsorted(at, side="right") - 1, 0), time.size - 2)
    first = np.minimum(np.maximum(interval - 1, 0), time.size - 4)
    (t0, t1, t2, t3), (y0, y1, y2, y3) = (
        (column[first], column[first + 1], column[first + 2], column[first + 3])
        for column in (time, y)
    )
    # Newton's divided differences, from the middle pair outwards.
    d12 = (y2 - y1) / (t2 - t1)
    d012 = (d12 - (y1 - y0) / (t1 - t0)) / (t2 - t0)
    d123 = ((y3 - y2) / (t3 - t2) - d12) / (t3 - t1)
    d0123 = (d123 - d012) / (t3 - t0)
    middle = (at - t1) * (at - t2)
    cubic = y1 + (at - t1) * d12 + middle * (d012 + (at - t0) * d0123)
    begin, end = time[interval], time[interval + 1]
    chord = y[interval] + (at - begin) / (end - begin) * (y[interval + 1] - y[interval])
    outer = np.maximum(np.abs(at - t0), np.abs(at - t3))
    return cubic, np.maximum(np.abs(middle * d0123) * outer, 0.25 * np.abs(cubic - chord))


def peaks(time: Floats, y: Floats, above: float) -> tuple[Floats, Floats, Floats]:
    """Return instants, interpolated heights and doubts of the local maxima higher than `above`."""
    inner = y[1:-1]
    top = np.flatnonzero((inner > above) & (inner >= y[:-2]) & (inner >= y[2:])) + 1
    if top.size == 0:
        return time[top], y[top], y[top]
    before, after = time[top] - time[top - 1], time[top + 1] - time[top]
    fall_l, fall_r = (y[top] - y[top - 1]) / before, (y[top] - y[top + 1]) / after
    curvature = fall_l + fall_r
    flat = curvature <= 0
    offset = np.where(flat, 0.0, (fall_l * after - fall_r * before) / np.where(flat, 1, curvature))
    at = time[top] + 0.5 * np.minimum(np.maximum(offset, -before), after)
    height, doubt = interpolate(time, y, at)
    return at, np.maximum(height, y[top]), doubt


def highest(time: Floats, y: Floats) -> float:
    """Return the waveform's maximum, a peak between points included; P is at least 4."""
    top = int(np.argmax(y))
    lo, hi = max(top - 3, 0), min(top + 4, time.size)
    _, height, _ = peaks(time[lo:hi], y[lo:hi], -np.inf)
    return float(max(y[top], height.max(initial=-np.inf)))


def _last_root(grid: Floats, f: Floats) -> float:
    """Return where `f` is last positive on `grid`, linear between its points."""
    positive = np.flatnonzero(f > 0)
    if positive.size == 0:
        return float(grid[0])
    i = int(positive[-1])
    if i == grid.size - 1:
        return float(grid[i])
    return float(grid[i] + (grid[i + 1] - grid[i]) * f[i] / (f[i] - f[i + 1]))


def _falls(time: Floats, y: Floats, level: float, since: float) -> Crossing:
    """Locate the fall through `level` between the instant `since` and the next point."""
    end = time[min(int(np.searchsorted(time, since, side="right")), time.size - 1)]
    grid = np.linspace(since, float(end), _GRID)
    value, doubt = interpolate(time, y, grid)
    at = _last_root(grid, value - level)
    early, late = _last_root(grid, value - doubt - level), _last_root(grid, value + doubt - level)
    return Crossing(at, max(at - early, late - at, float(np.spacing(abs(at)))))


def last_above(time: Floats, y: Floats, level: float) -> Crossing | None:
    """Find the last instant at which `y` is above `level`.

    Parameters
    ----------
    time, y : ndarray (P,)
        Record, P at least 4; s and any unit.
    level : float
        In the unit of `y`.

    Returns
    -------
    Crossing or None
        None if `y` is never above; the last point, without doubt, if `y` ends above. A later peak
        that reaches `level` only between points, or only within its doubt, is taken into account:
        in the value if the interpolated peak is above, in the uncertainty in any case.
    """
    above: NDArray[np.intp] = np.flatnonzero(y > level)
    last = int(above[-1]) if above.size else -1
    if last == time.size - 1:
        return Crossing(float(time[-1]), 0.0)
    lo = max(last - 3, 0)
    tail_t, tail_y = time[lo:], y[lo:]
    at, height, doubt = peaks(tail_t, tail_y, level - (1 - _NEAR) * abs(level))
    later = at > (time[last] if last >= 0 else -np.inf)
    at, height, doubt = at[later], height[later], doubt[later]

    def since(lean: int) -> float | None:
        reached = at[height + lean * doubt > level]
        if reached.size:
            return float(reached[-1])
        return float(time[last]) if last >= 0 else None

    start = since(0)
    if start is None:
        return None
    found = _falls(time, y, level, start)
    others = {since(lean) for lean in (-1, 1)} - {start, None}
    rivals = [_falls(time, y, level, other) for other in others if other is not None]
    spread = [abs(rival.time - found.time) + rival.uncertainty for rival in rivals]
    return Crossing(found.time, max([found.uncertainty, *spread]))


def first_above(time: Floats, y: Floats, level: float) -> Crossing | None:
    """Find the first instant at which `y` is above `level`; as `last_above`, time reversed."""
    found = last_above(-time[::-1], y[::-1], level)
    return None if found is None else Crossing(-found.time, found.uncertainty)
