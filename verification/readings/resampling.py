"""Interpolation and resampling of waveforms."""

from __future__ import annotations

import numpy as np

from taction.system.array_types import Floats

CUBIC = 4  # points: more would magnify rounding where the steps grow from tiny steps
_EQUAL_STEPS = 1e-6  # relative difference of steps that count as equal
_SAME_INSTANT = 1e-9  # of a step: distance of instants that count as equal


def lagrange(time: Floats, y: Floats, at: Floats, points: int) -> Floats:
    """Interpolate by the polynomial through the nearest points.

    Parameters
    ----------
    time : ndarray (P,)
        Strictly increasing, s; P is at least `points`.
    y : ndarray (P, K)
        Samples.
    at : ndarray (Q,)
        Instants inside the record, s.
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


def typical_step(time: Floats) -> float:
    """Return the step that most steps of a record are equal to, else a typical step, s.

    A simulator with a maximum step takes smaller steps at the beginning and at the end.
    """
    steps = np.diff(time)
    mean = float(time[-1] - time[0]) / steps.size
    if float(np.ptp(steps)) < _EQUAL_STEPS * mean:
        return mean
    median = float(np.median(steps))
    equal = steps[np.abs(steps - median) < _EQUAL_STEPS * median]
    if 2 * equal.size > steps.size:
        return float(equal.mean())
    return min(median, mean)


def resample(
    time: Floats, y: Floats, step: float, typical: float, anchor: int, most: int, points: int
) -> tuple[Floats, Floats]:
    """Return evenly spaced instants (Q,) that contain one point of the record, and samples (Q, K).

    Instants at points of the record take the samples unchanged; if all instants are such points,
    the result is a view of the record.

    Parameters
    ----------
    time, y : ndarray (P,), (P, K)
        Record, s and any unit.
    step : float
        Between instants, s.
    typical : float
        `typical_step` of the record, s; a multiple or a whole fraction of it as `step` makes the
        instants coincide with points.
    anchor : int
        Index of the point that the instants contain, 0 to P - 1.
    most : int
        Largest number of instants up to the anchor.
    points : int
        Points of the interpolation.
    """
    origin, room = time[anchor], (1 + _SAME_INSTANT) / step
    before = min(int((origin - time[0]) * room), most - 1)
    k = np.arange(-before, int((time[-1] - origin) * room) + 1)
    at = np.minimum(np.maximum(origin + step * k, time[0]), time[-1])
    near = np.rint(k * (step / typical)).astype(np.intp) + anchor
    near = np.minimum(np.maximum(near, 0), time.size - 1)
    between = np.flatnonzero(np.abs(time[near] - at) > _SAME_INSTANT * step)
    if not between.size:
        return at, y[near[0] : near[-1] + 1 : max(round(step / typical), 1)]
    values = y.take(near, axis=0)
    values[between] = lagrange(time, y, at[between], points)
    return at, values
