"""The error of the readings of a simulation, from the readings of a second solution."""

from __future__ import annotations

import math
from dataclasses import dataclass

from spice_models.definitions import SMALL_STEP
from verification.measures.measurements import Measurements
from verification.measures.readings import Reading, Readings

LATER = 0.05  # of a settling time: a second time later than this is measured in full


@dataclass(frozen=True, slots=True)
class StepError:
    """The error of the readings of a simulation.

    The times are in s, the others fractions of the step amplitude.
    """

    steady_state: float
    settling_time: float
    rise_time: float
    overshoot: float
    undershoot: float


def undecided(fine: Measurements, coarse: Readings) -> bool:
    """Return whether the second solution must be measured in full before its readings count.

    That is so if only the second solution has a settling or rise time, or if its settling time is
    much later: its readings alone do not show whether the channel has settled.
    """
    settled, second = fine.settling_time, coarse.settling_time
    if settled is None or second is None:
        later = second is not None
    else:
        later = second.value > (1 + LATER) * settled.value
    rises = zip((c.rise_time for c in fine.channels), coarse.rise_times, strict=True)
    return later or any(a is None and b is not None for a, b in rises)


def simulation_error(
    fine: Measurements, coarse: Readings | None, share: float, rounding: float = 0.0
) -> StepError:
    """Estimate the error of every measure of `fine` (Richardson's extrapolation).

    A settling time jumps by half a ringing period when a peak moves through the edge of the band,
    so its whole difference counts, not the extrapolated part.

    Parameters
    ----------
    fine, coarse : Measurements and Readings
        The record, and a second solution (exact, or at larger steps). Without a second solution
        the error is that of rounding if `share` is 0, else infinite.
    share : float
        Part of a difference that is the error of `fine`: 1 if `coarse` is exact, ``1/(r^p - 1)``
        for a step ratio r and an order p.
    rounding : float
        Rounding error of `fine`, V. A relative shift of a level moves its crossing by at most the
        same fraction of the time.

    Returns
    -------
    StepError
        Infinite for a reading that only one of the two has.
    """
    if coarse is None:
        level = rounding / (fine.amplitude or 1.0) if share == 0 else math.inf
        rise = max(_moved(time, level / SMALL_STEP) for time in fine.readings.rise_times)
        return StepError(level, _moved(fine.settling_time, level / fine.band), rise, level, level)
    readings = fine.readings
    rises = zip(readings.rise_times, coarse.rise_times, strict=True)
    return StepError(
        steady_state=share * _furthest(readings.finals, coarse.finals) / (fine.amplitude or 1.0),
        settling_time=_apart(fine.settling_time, coarse.settling_time),
        rise_time=share * max(_apart(a, b) for a, b in rises),
        overshoot=share * _furthest(readings.overshoots, coarse.overshoots),
        undershoot=share * _furthest(readings.undershoots, coarse.undershoots),
    )


def _moved(time: Reading | None, share: float) -> float:
    """Return the shift of a reading whose level moves by `share` of itself, s."""
    return share * (time.value if time is not None else 0.0) if share < 1 else math.inf


def _furthest(a: tuple[float, ...], b: tuple[float, ...]) -> float:
    """Return the largest difference of any channel."""
    return max(abs(x - y) for x, y in zip(a, b, strict=True))


def _apart(a: Reading | None, b: Reading | None) -> float:
    """Return the difference of two readings, s; the nearer value of a fragile `b` counts."""
    if a is None or b is None:
        return 0.0 if a is b else math.inf
    values = [b.value] if b.alternative is None else [b.value, b.alternative]
    return min(abs(a.value - value) for value in values)
