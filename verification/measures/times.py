"""Times read from a waveform: rise, settling, and how far each can be trusted."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from spice_models.array_types import Floats
from verification.measures.crossings import first_crossings, last_crossings

_KNIFE = 0.005  # of a channel's step: how far a level is moved to see whether a hair decides
_GRAZE = 0.05  # of the band: the same for the settling band
_FRAGILE = 0.1  # of the value: a change that makes a reading fragile
_GLIMPSE = 1024  # points in which a rise is looked for first


@dataclass(frozen=True, slots=True)
class Reading:
    """A measured time.

    Attributes
    ----------
    value : float
        s.
    uncertainty : float
        From the shape between the points, s; the simulation's own error is not in it.
    fragile : bool
        A hair decides: a peak just reaches, or just misses, the level or the band.
    alternative : float or None
        What a fragile reading would be had the hair fallen to the other side, s; None if it is
        not fragile, or if there is no crossing on the other side.
    """

    value: float
    uncertainty: float
    fragile: bool = False
    alternative: float | None = None


def reading(value: float, uncertainty: float, others: list[float | None]) -> Reading:
    """Build a reading; `others` are its values with the level moved by a hair (None: no value)."""
    limit = max(_FRAGILE * abs(value), uncertainty)
    far = [o for o in others if o is not None and abs(o - value) > limit]
    fragile = bool(far) or None in others
    alternative = max(far, key=lambda o: abs(o - value)) if far else None
    return Reading(value, uncertainty, fragile, alternative)


def settles(time: Floats, errors: Floats, tolerance: float) -> list[Reading | None]:
    """Return when each channel was last outside ``±tolerance``; None if it is outside at the end.

    Proves nothing about what follows the record; `judge` does.

    Parameters
    ----------
    time : ndarray (P,)
        s, P at least 8.
    errors : ndarray (N, P)
        Distances to the targets.
    tolerance : float
        In the unit of `errors`.
    """
    if np.abs(errors[:, -1]).min() > tolerance:
        return [None] * len(errors)
    levels = np.repeat(tolerance * np.array([[1.0], [1 - _GRAZE], [1 + _GRAZE]]), len(errors), 1)
    widest = levels[-1, 0]
    # Only what follows the last point clearly outside, with the four points that a cubic needs.
    outside = (errors > widest) | (errors < -widest)
    last = np.where(outside.any(axis=1), time.size - 1 - outside[:, ::-1].argmax(axis=1), 0)
    first = np.minimum(np.maximum(last - 4, 0), time.size - 8)
    begin = int(first.min())
    tail = errors[:, begin:]
    at, doubt = last_crossings(time[begin:], tail, levels, first - begin, mirrored=True)
    channels = len(errors)
    above, below = at[:, :channels], at[:, channels:]
    at = np.fmax(above, below)
    doubt = np.where(at == below, doubt[:, channels:], doubt[:, :channels])
    at -= time[0]
    never = np.isnan(at)  # it was never outside
    at[never], doubt[never] = 0.0, 0.0
    at[np.abs(errors[:, -1]) > levels] = np.nan  # it is still outside
    found: list[Reading | None] = []
    for (value, *others), width in zip(at.T.tolist(), doubt[0].tolist(), strict=True):
        moved = [None if math.isnan(other) else other for other in others]
        found.append(None if math.isnan(value) else reading(value, width, moved))
    return found


def rises(
    time: Floats, errors: Floats, steps: Floats, low: float, high: float
) -> list[Reading | None]:
    """Return the time from each channel's first crossing of `low` to that of `high`, or None.

    Parameters
    ----------
    time : ndarray (P,)
        s, P at least 8.
    errors : ndarray (N, P)
        Distances to the targets.
    steps : ndarray (N,)
        From the starts to the targets, in the unit of `errors`; 0 where no time is wanted.
    low, high : float
        Levels, 0 to 1, fractions of the steps.
    """
    rows = np.flatnonzero(steps)
    found: list[Reading | None] = [None] * len(errors)
    if rows.size == 0:
        return found
    steps = steps[rows]
    # Only what precedes the first point clearly above, with the points that a cubic needs.
    clear, up = ((high + _KNIFE - 1) * steps)[:, None], (steps > 0)[:, None]
    size = 0
    while size < time.size:
        size = min(max(_GLIMPSE, 8 * size), time.size)
        above = (errors[:, :size][rows] > clear) == up
        reached = above.any(axis=1)
        if reached.all():
            break
    stop = np.where(reached, np.maximum(above.argmax(axis=1) + 4, 8), time.size)
    stop = np.minimum(stop, time.size)
    head = int(stop.max())
    z = 1 + errors[:, :head][rows] / steps[:, None]
    levels = np.array([low, high, high - _KNIFE, high + _KNIFE, low - _KNIFE, low + _KNIFE])
    at, doubt = first_crossings(time[:head], z, np.repeat(levels[:, None], len(z), axis=1), stop)
    widths = (doubt[0] + doubt[1]).tolist()
    for n, instants, width in zip(rows.tolist(), at.T.tolist(), widths, strict=True):
        begin, end, *ends = instants[:4]
        if math.isnan(begin) or math.isnan(end):
            continue
        others = [None if math.isnan(e) else e - begin for e in ends]
        others += [end - b for b in instants[4:] if not math.isnan(b)]
        found[n] = reading(end - begin, width, others)
    return found


def latest(readings: list[Reading]) -> Reading:
    """Return the latest of several readings, fragile where one of them could change it."""
    value = max(r.value for r in readings)
    doubt = max(r.value + r.uncertainty for r in readings) - value
    rivals = [[r.value, r.value if r.alternative is None else r.alternative] for r in readings]
    others: list[float | None] = [max(map(max, rivals)), max(map(min, rivals))]
    if any(r.fragile and r.alternative is None for r in readings):
        others.append(None)
    return reading(value, doubt, others)
