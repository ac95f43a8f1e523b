"""Times read from a waveform: rise, settling, and how far each can be trusted."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from verification.crossings import first_above, last_above
from verification.waveforms import Floats

_KNIFE = 0.005  # of a channel's step: how far a level is moved to see whether a hair decides
_GRAZE = 0.05  # of the band: the same for the settling band
_FRAGILE = 0.1  # of the value: a change that makes a reading fragile


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


def settle(time: Floats, error: Floats, tolerance: float) -> Reading | None:
    """Return when `error` (P,) was last outside ``±tolerance``; None if it is outside at the end.

    Proves nothing about what follows the record; `judge` does.
    """
    if abs(error[-1]) > tolerance:
        return None
    outside = np.flatnonzero(np.abs(error) > tolerance * (1 + _GRAZE))
    first = min(max(int(outside[-1]) - 4 if outside.size else 0, 0), max(time.size - 8, 0))
    t, e = time[first:], error[first:]

    def last_outside(level: float) -> tuple[float, float] | None:
        if abs(e[-1]) > level:
            return None
        found = [c for c in (last_above(t, e, level), last_above(t, -e, level)) if c is not None]
        return max(found, default=(float(time[0]), 0.0))

    at = last_outside(tolerance)
    if at is None:
        return None
    others = [last_outside(tolerance * (1 + side)) for side in (-_GRAZE, _GRAZE)]
    begin = float(time[0])
    return reading(at[0] - begin, at[1], [None if o is None else o[0] - begin for o in others])


def rise(time: Floats, z: Floats, low: float, high: float) -> Reading | None:
    """Return the time from the first crossing of `low` to that of `high`, or None.

    Parameters
    ----------
    time : ndarray (P,)
        s, P at least 8.
    z : ndarray (P,)
        The channel in units of its own step, from 0 towards 1.
    low, high : float
        Levels, 0 to 1.
    """
    there = np.flatnonzero(z > high + _KNIFE)
    stop = max(int(there[0]) + 4, 8) if there.size else time.size
    t, z = time[:stop], z[:stop]
    begin, end = first_above(t, z, low), first_above(t, z, high)
    if begin is None or end is None:
        return None
    ends = [first_above(t, z, high + side) for side in (-_KNIFE, _KNIFE)]
    begins = [first_above(t, z, low + side) for side in (-_KNIFE, _KNIFE)]
    others = [None if e is None else e.time - begin.time for e in ends]
    others += [end.time - b.time for b in begins if b is not None]
    return reading(end.time - begin.time, end.uncertainty + begin.uncertainty, others)


def latest(readings: list[Reading]) -> Reading:
    """Return the latest of several readings, fragile where one of them could change it."""
    value = max(r.value for r in readings)
    doubt = max(r.value + r.uncertainty for r in readings) - value
    rivals = [[r.value, r.value if r.alternative is None else r.alternative] for r in readings]
    others: list[float | None] = [max(map(max, rivals)), max(map(min, rivals))]
    if any(r.fragile and r.alternative is None for r in readings):
        others.append(None)
    return reading(value, doubt, others)
