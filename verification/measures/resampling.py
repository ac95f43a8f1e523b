"""Waveforms at other instants than their own."""

from __future__ import annotations

import numpy as np

from spice_models.array_types import Floats

CUBIC = 4  # nearest points: more would magnify rounding where steps grow from tiny ones
_ALIKE = 1e-6  # steps that differ by less, relative, are one
_SAME = 1e-9  # of a step: an instant that near to a point is that point


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
        Points in the stencil, even: 2 is the chord, 4 the cubic.

    Returns
    -------
    ndarray (Q, K)
        Values at `at`.
    """
    first = time.searchsorted(at, side="right") - points // 2
    first = np.minimum(np.maximum(first, 0), time.size - points)
    nodes = [time[first + j] for j in range(points)]
    away = [at - node for node in nodes]
    values: Floats = np.zeros((at.size, y.shape[1]))
    for j, node in enumerate(nodes):
        others = [m for m in range(points) if m != j]
        above, below = away[others[0]], node - nodes[others[0]]
        for m in others[1:]:
            above, below = above * away[m], below * (node - nodes[m])
        values += (above / below)[:, None] * y.take(first + j, axis=0)
    return values


def pace(time: Floats) -> float:
    """Return a record's usual step, s: the one that most of its steps are, or a typical one.

    A simulator under a maximum step takes smaller ones at the beginning and to meet the end.
    """
    steps = np.diff(time)
    mean = float(time[-1] - time[0]) / steps.size
    if float(np.ptp(steps)) < _ALIKE * mean:
        return mean
    median = float(np.median(steps))
    alike = steps[np.abs(steps - median) < _ALIKE * median]
    if 2 * alike.size > steps.size:
        return float(alike.mean())
    return min(median, mean)


def resample(
    time: Floats,
    y: Floats,
    step: float,
    usual: float,
    anchor: int,
    most: int,
    points: int,
) -> tuple[Floats, Floats]:
    """Return evenly spaced instants (Q,), one of them a point of the record, and samples (Q, K).

    Instants that are points of the record take them as they are; where all are, the samples are a
    view of the record's.

    Parameters
    ----------
    time, y : ndarray (P,), (P, K)
        Record, s and any unit.
    step : float
        Between instants, s.
    usual : float
        `pace` of the record, s; `step` is this times, or over, a whole number where points are
        to be met.
    anchor : int
        Index of the point, 0 to P - 1.
    most : int
        Instants up to the anchor, the last of those there is room for.
    points : int
        Of the interpolation between points.
    """
    origin, room = time[anchor], (1 + _SAME) / step
    before = min(int((origin - time[0]) * room), most - 1)
    k = np.arange(-before, int((time[-1] - origin) * room) + 1)
    at = np.minimum(np.maximum(origin + step * k, time[0]), time[-1])
    near = np.rint(k * (step / usual)).astype(np.intp) + anchor
    near = np.minimum(np.maximum(near, 0), time.size - 1)
    between = np.flatnonzero(np.abs(time[near] - at) > _SAME * step)
    if not between.size:
        return at, y[near[0] : near[-1] + 1 : max(round(step / usual), 1)]
    values = y.take(near, axis=0)
    values[between] = lagrange(time, y, at[between], points)
    return at, values
