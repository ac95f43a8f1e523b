"""Rise and settling time, overshoot and undershoot: one implementation for all signals.

A `Signal` is either a sampled record (`verification.measures.sampled_signal`) or an exact solution
(`verification.small_signal.exact_crossings`). `verification.measures.measure` has the definitions
and decides which readings are proven.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Protocol

import numpy as np

from spice_models.array_types import Bools, Floats, Indices
from spice_models.definitions import BAND_SHIFT, FRAGILE, LEVEL_SHIFT, RISE_LEVELS, SMALL_STEP
from verification.measures.crossings import Crossings

STILL = 1e-6  # of A: a smaller step has no direction; both sides of it count as undershoot


class Signal(Protocol):
    """Errors of N channels over time: distances from the targets."""

    @property
    def ends(self) -> Floats:
        """Errors (N,) where the signal ends or comes to rest."""

    def last_outside(self, levels: Floats) -> Crossings:
        """Find the last instants (J, N), from the start, with ``|error|`` above `levels` (J,).

        NaN for a channel that never is above.
        """

    def first_reached(self, rows: Indices, steps: Floats, levels: Floats) -> Crossings:
        """Find when ``1 + error / step`` first exceeds `levels` (J,), in channels `rows` (R,).

        Shape (J, R); NaN for a level that is never exceeded.
        """

    def highest(self, sign: float) -> Floats:
        """Return the maximum of ``sign * error`` of every channel, (N,)."""


@dataclass(frozen=True, slots=True)
class Reading:
    """A measured time.

    Attributes
    ----------
    value : float
        s.
    uncertainty : float
        Uncertainty of the crossings, s, without the error of the simulation.
    fragile : bool
        A small shift of the level or of the band changes the time: a peak just reaches, or just
        misses, the level.
    alternative : float or None
        The time with the level shifted by `LEVEL_SHIFT`, or the band by `BAND_SHIFT`, s; None if
        the reading is not fragile, or if the shifted level is not crossed.
    """

    value: float
    uncertainty: float
    fragile: bool = False
    alternative: float | None = None


@dataclass(frozen=True, slots=True)
class Readings:
    """Readings of one signal, one entry per channel."""

    finals: tuple[float, ...]  # last values
    rise_times: tuple[Reading | None, ...]  # None for a channel that does not reach both levels
    settling_times: tuple[Reading | None, ...]  # None for a channel that ends outside its band
    overshoots: tuple[float, ...]  # fractions of A
    undershoots: tuple[float, ...]  # fractions of A

    @property
    def settling_time(self) -> Reading | None:
        """Settling time of the last channel; None unless every channel has a settling time."""
        times = [reading for reading in self.settling_times if reading is not None]
        return latest(times) if len(times) == len(self.settling_times) else None


@dataclass(frozen=True, slots=True, eq=False)
class Step:
    """Values before the step and targets, (N,) each."""

    start: Floats
    target: Floats

    @property
    def sizes(self) -> Floats:
        """From start to target, (N,)."""
        return self.target - self.start

    @property
    def amplitude(self) -> float:
        """Step amplitude A of the network."""
        return float(np.abs(self.sizes).max(initial=0.0))

    def rising(self) -> Bools:
        """Mark the channels whose step is large enough for a rise time, (N,)."""
        sizes = np.abs(self.sizes)
        return np.asarray((sizes >= SMALL_STEP * self.amplitude) & (sizes > 0))


def read(signal: Signal, step: Step, finals: Floats, tolerance: float, lost: Bools) -> Readings:
    """Read a signal with last values `finals` (N,).

    `tolerance` is half the width of the settling band, in the unit of the signal; `lost` (N,)
    marks channels whose rise time has no meaning.
    """
    overshoots, undershoots = excursions(signal, step)
    return Readings(
        finals=tuple(finals.tolist()),
        rise_times=rise_times(signal, step.sizes, step.rising() & ~lost),
        settling_times=settling_times(signal, tolerance),
        overshoots=overshoots,
        undershoots=undershoots,
    )


def settling_times(signal: Signal, tolerance: float) -> tuple[Reading | None, ...]:
    """Return when each channel was last outside ``±tolerance``; None if it ends outside."""
    ends = np.abs(signal.ends)
    if ends.min() > tolerance:
        return (None,) * len(ends)
    levels = tolerance * np.array([1.0, 1.0 - BAND_SHIFT, 1.0 + BAND_SHIFT])
    at, doubt = signal.last_outside(levels)
    never = np.isnan(at)
    at, doubt = np.where(never, 0.0, at), np.where(never, 0.0, doubt)
    at[ends > levels[:, None]] = np.nan
    readings: list[Reading | None] = []
    for (value, *others), width in zip(at.T.tolist(), doubt[0].tolist(), strict=True):
        shifted = [None if math.isnan(other) else other for other in others]
        readings.append(None if math.isnan(value) else _reading(value, width, shifted))
    return tuple(readings)


def rise_times(signal: Signal, steps: Floats, selected: Bools) -> tuple[Reading | None, ...]:
    """Return the time from the first crossing of the lower level to that of the upper level.

    None for a channel that is not `selected` (N,) or does not reach both levels.
    """
    readings: list[Reading | None] = [None] * len(steps)
    rows = np.flatnonzero(selected)
    if rows.size == 0:
        return tuple(readings)
    (low, high), shift = RISE_LEVELS, LEVEL_SHIFT
    shifted = np.array([low, high, high - shift, high + shift, low - shift, low + shift])
    at, doubt = signal.first_reached(rows, steps[rows], shifted)
    widths = (doubt[0] + doubt[1]).tolist()
    for n, instants, width in zip(rows.tolist(), at.T.tolist(), widths, strict=True):
        begin, end, *ends = instants[:4]
        if math.isnan(begin) or math.isnan(end):
            continue
        others = [None if math.isnan(e) else e - begin for e in ends]
        others += [end - b for b in instants[4:] if not math.isnan(b)]
        readings[n] = _reading(end - begin, width, others)
    return tuple(readings)


def excursions(signal: Signal, step: Step) -> tuple[tuple[float, ...], tuple[float, ...]]:
    """Return overshoots and undershoots, fractions of A; 0 without a step."""
    amplitude, sizes = step.amplitude, step.sizes
    if amplitude == 0:
        return ((0.0,) * len(sizes),) * 2
    up, down = signal.highest(1.0), signal.highest(-1.0)
    ahead, behind = np.where(sizes < 0, (down, up), (up, down))
    away = behind - np.abs(sizes)  # beyond the start
    either = np.maximum(ahead, away)
    over = np.where(step.rising(), ahead, either)
    under = np.where(np.abs(sizes) > STILL * amplitude, away, either)
    over, under = np.maximum((over, under), 0.0) / amplitude
    return tuple(over.tolist()), tuple(under.tolist())


def latest(readings: list[Reading]) -> Reading:
    """Return the latest of several readings, fragile where a fragile reading could change it."""
    value = max(r.value for r in readings)
    doubt = max(r.value + r.uncertainty for r in readings) - value
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
