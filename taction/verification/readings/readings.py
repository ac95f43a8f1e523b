"""The readings of a trace: one implementation for records and exact solutions.

A `Trace` is either a sampled record (`verification.readings.record`) or an exact solution
(`verification.readings.exact_measures`). `system.reading_definitions` has the definitions;
`verification.readings.measurements` decides which readings are proven.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from taction.system.array_types import Bools, Floats
from taction.system.reading_definitions import (
    BAND_SHIFT,
    EXCURSIONS,
    FRAGILE,
    LEVEL_SHIFT,
    READINGS,
    RISE_LEVELS,
    SMALL_STEP,
)
from taction.verification.readings.trace import Trace

STILL = 1e-6  # of A: a smaller step has no direction


@dataclass(frozen=True, slots=True)
class Reading:
    """A measured time, or a measured share of the step amplitude."""

    value: float  # in the unit of its kind in `READINGS`
    # Bound of the error of `value`: of what lies between the points and, where the signal has
    # bounds, of the trace. Infinite if the true trace may have no such reading.
    uncertainty: float
    # A small shift of the level or of the band changes the time: a peak just reaches, or just
    # misses, the level.
    fragile: bool = False
    # The time with the level shifted by `LEVEL_SHIFT`, or the band by `BAND_SHIFT`, s; None if the
    # reading is not fragile, or if the shifted level is not crossed.
    alternative: float | None = None


Readings = Mapping[str, tuple[Reading | None, ...]]
"""Readings of a trace by name, one entry per channel.

None for a channel that ends outside its settling band, or does not reach both levels of its rise.
"""


@dataclass(frozen=True, eq=False)
class Step:
    """Values before the step and targets of the channels, (N,) each."""

    start: Floats
    target: Floats

    @cached_property
    def sizes(self) -> Floats:
        """From start to target, (N,)."""
        return self.target - self.start

    @cached_property
    def amplitude(self) -> float:
        """Step amplitude A of the network."""
        return float(np.abs(self.sizes).max(initial=0.0))

    @cached_property
    def rising(self) -> Bools:
        """Marks of the channels whose step is large enough for a rise time, (N,)."""
        sizes = np.abs(self.sizes)
        return np.asarray((sizes >= SMALL_STEP * self.amplitude) & (sizes > 0))


def read(trace: Trace, step: Step, tolerance: float, lost: Bools) -> Readings:
    """Read a trace.

    `tolerance` is half the width of the settling band, in the unit of the trace. `lost` (N,) marks
    channels whose rise time has no meaning.
    """
    shares, rises = excursions(trace, step), rise_times(trace, step.sizes, step.rising & ~lost)
    times = {"rise_time": rises, "settling_time": settling_times(trace, tolerance)}
    return {**times, **shares}


def unread(channels: int) -> Readings:
    """Return the readings of a trace with too few points: no times, excursions without a bound."""
    nothing = dict.fromkeys(READINGS, (None,) * channels)
    return nothing | dict.fromkeys(EXCURSIONS, (Reading(0.0, math.inf),) * channels)


def settling_times(trace: Trace, tolerance: float) -> tuple[Reading | None, ...]:
    """Return when each channel was last outside ``±tolerance``; None if it ends outside."""
    ends = np.abs(trace.ends)
    if np.all(ends > tolerance):
        return (None,) * len(ends)
    # The last two shift the trace by its bound.
    levels = tolerance * np.array([1.0, 1.0 - BAND_SHIFT, 1.0 + BAND_SHIFT, 1.0, 1.0])
    at, doubt = trace.last_outside(levels, np.array([0.0, 0.0, 0.0, -1.0, 1.0]))
    at = np.where(np.isnan(at), 0.0, at)
    at[:3][ends > levels[:3, None]] = np.nan
    at[4, ends + trace.end_bounds > tolerance] = np.inf
    # A crossing of the true trace lies between those of the shifted traces.
    late, early = at[4] + doubt[4] - at[0], at[0] - at[3] + doubt[3]
    width = np.fmax(np.fmax(late, early), doubt[0])
    readings: list[Reading | None] = []
    for (value, *others), doubted in zip(at[:3].T.tolist(), width.tolist(), strict=True):
        shifted = [None if math.isnan(other) else other for other in others]
        readings.append(None if math.isnan(value) else _reading(value, doubted, shifted))
    return tuple(readings)


def rise_times(trace: Trace, steps: Floats, selected: Bools) -> tuple[Reading | None, ...]:
    """Return the time from the first crossing of the lower level to that of the upper level.

    None for a channel that is not `selected` (N,) or does not reach both levels.
    """
    readings: list[Reading | None] = [None] * len(steps)
    rows = np.flatnonzero(selected)
    if rows.size == 0:
        return tuple(readings)
    (low, high), shift = RISE_LEVELS, LEVEL_SHIFT
    levels = [low, high, high - shift, high + shift, low - shift, low + shift, low, low, high, high]
    shifts = [0.0] * 6 + [1.0, -1.0] * 2  # the last four shift the trace by its bound
    at, doubt = trace.first_reached(rows, steps[rows], np.array(levels), np.array(shifts))
    rise = at[1] - at[0]
    (early_low, early_high), (late_low, late_high) = (at - doubt)[[6, 8]], (at + doubt)[[7, 9]]
    moved = np.maximum(late_high - early_low - rise, rise - (early_high - late_low))
    width = np.where(np.isnan(moved), np.inf, np.maximum(moved, doubt[0] + doubt[1]))
    for n, instants, doubted in zip(rows.tolist(), at[:6].T.tolist(), width.tolist(), strict=True):
        begin, end, *ends = instants[:4]
        if math.isnan(begin) or math.isnan(end):
            continue
        others = [None if math.isnan(e) else e - begin for e in ends]
        others += [end - b for b in instants[4:] if not math.isnan(b)]
        readings[n] = _reading(end - begin, doubted, others)
    return tuple(readings)


def excursions(trace: Trace, step: Step) -> Readings:
    """Return how far the channels go beyond target and start, fractions of A; 0 without a step."""
    A, sizes = step.amplitude, step.sizes
    if not A:
        return dict.fromkeys(EXCURSIONS, (Reading(0.0, 0.0),) * len(sizes))
    up, down = np.array(trace.highest(1.0)), np.array(trace.highest(-1.0))
    ahead, away = np.where(sizes < 0, (down, up), (up, down))  # heights and their doubts each
    away[0] -= np.abs(sizes)  # beyond the start
    either = np.maximum(ahead, away)
    over = np.where(step.rising, ahead, either)
    under = np.where(np.abs(sizes) > STILL * A, away, either)
    readings = (_from_zero(*(part / A)) for part in (over, under))
    return dict(zip(EXCURSIONS, readings, strict=True))


def _from_zero(values: Floats, doubts: Floats) -> tuple[Reading, ...]:
    """Return values of at least 0, with bounds of their errors of at least rounding."""
    low, value, high = (np.maximum(x, 0.0) for x in (values - doubts, values, values + doubts))
    errors = np.maximum(np.maximum(high - value, value - low), np.spacing(1.0 + value))
    return tuple(map(Reading, value.tolist(), errors.tolist()))


def largest(readings: Sequence[Reading]) -> Reading:
    """Return the largest of several readings, fragile where a fragile reading could change it.

    Examples
    --------
    >>> largest([Reading(0.5, 0.0625), Reading(0.25, 0.5)])
    Reading(value=0.5, uncertainty=0.25, fragile=False, alternative=None)
    """
    if len(readings) == 1:
        return readings[0]
    value = max(r.value for r in readings)
    highest, lowest = (max(r.value + s * r.uncertainty for r in readings) for s in (1.0, -1.0))
    doubt = max(highest - value, value - lowest)
    rivals = [[r.value, r.value if r.alternative is None else r.alternative] for r in readings]
    others: list[float | None] = [max(map(max, rivals)), max(map(min, rivals))]
    if any(r.fragile and r.alternative is None for r in readings):
        others.append(None)
    return _reading(value, doubt, others)


def _reading(value: float, uncertainty: float, others: list[float | None]) -> Reading:
    """Build a reading; `others` are its values at the shifted levels (None: no crossing)."""
    limit = max(FRAGILE * abs(value), uncertainty)
    far = [o for o in others if o is not None and abs(o - value) > limit]
    fragile = bool(far) or None in others
    alternative = max(far, key=lambda o: abs(o - value)) if far else None
    return Reading(value, uncertainty, fragile, alternative)
