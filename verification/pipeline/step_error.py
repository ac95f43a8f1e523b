"""Bounds on the errors of a record's readings, from the readings of a better solution."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

from verification.measures.measurements import Measurements, summary
from verification.measures.readings import Reading, Readings


@dataclass(frozen=True, slots=True)
class StepError:
    """Bounds on the errors of the readings of a simulation.

    The times are in s, 0 where no channel has such a time; the others are fractions of the step
    amplitude. All are infinite if nothing is known. Of the rise times, the largest error counts;
    settling time and excursions are those of the network.
    """

    steady_state: float
    settling_time: float
    rise_time: float
    overshoot: float
    undershoot: float


def bounded(measured: Measurements, other: Readings | None, safety: float = 1.0) -> Measurements:
    """Return `measured` with uncertainties that hold for the true solution.

    The error of a reading is at most its difference to the `other` reading, and the uncertainty of
    that one. A reading that only one solution has is infinitely uncertain, and all readings are
    without another solution. A settling time jumps by half a ringing period when a peak moves
    through the edge of the band, and this difference counts, too. The differences count `safety`
    times.
    """
    nothing = (None,) * len(measured.channels)
    rises = nothing if other is None else other.rise_times
    settled = nothing if other is None else other.settling_times
    channels = [
        replace(
            c,
            rise_time=_bounded(c.rise_time, a, safety),
            settling_time=_bounded(c.settling_time, b, safety),
        )
        for c, a, b in zip(measured.channels, rises, settled, strict=True)
    ]
    errors = _excursion_errors(measured.readings, other, safety)
    return summary(measured.amplitude, measured.band, measured.modes, channels, errors)


def _bounded(reading: Reading | None, other: Reading | None, safety: float) -> Reading | None:
    if reading is None:
        return None
    if other is None:
        return replace(reading, uncertainty=math.inf)
    apart = safety * abs(reading.value - other.value)
    return replace(reading, uncertainty=apart + other.uncertainty)


def _excursion_errors(
    readings: Readings, other: Readings | None, safety: float
) -> tuple[float, float]:
    """Return bounds on the errors of the largest overshoot and undershoot."""
    if other is None:
        return math.inf, math.inf
    overshoot, undershoot = other.excursion_errors
    return (
        safety * abs(max(readings.overshoots) - max(other.overshoots)) + overshoot,
        safety * abs(max(readings.undershoots) - max(other.undershoots)) + undershoot,
    )


def step_error(measured: Measurements, end_error: float) -> StepError:
    """Return the errors of measurements whose uncertainties are bounds.

    Parameters
    ----------
    end_error : float
        Bound of the error of the record's end, V.
    """
    settling, rises = measured.settling_time, measured.readings.rise_times
    overshoot, undershoot = measured.excursion_errors
    return StepError(
        steady_state=end_error / (measured.amplitude or 1.0),
        settling_time=0.0 if settling is None else settling.uncertainty,
        rise_time=max((rise.uncertainty for rise in rises if rise is not None), default=0.0),
        overshoot=overshoot,
        undershoot=undershoot,
    )
