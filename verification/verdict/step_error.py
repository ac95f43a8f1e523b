"""Bounds on the errors of a record's readings, from the readings of a better solution."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

from taction.verification.readings.measurements import ChannelMeasure, Measurements, summary
from taction.verification.readings.readings import Reading, Readings


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
    channels = [_bounded_channel(c, other, safety) for c in measured.channels]
    return summary(measured.amplitude, measured.band, measured.modes, channels)


def _bounded_channel(
    channel: ChannelMeasure, other: Readings | None, safety: float
) -> ChannelMeasure:
    n = channel.index
    rise, settling = (
        (None, None) if other is None else (other.rise_times[n], other.settling_times[n])
    )
    over = under = math.inf
    if other is not None:
        over = safety * abs(channel.overshoot - other.overshoots[n]) + other.overshoot_errors[n]
        under = safety * abs(channel.undershoot - other.undershoots[n]) + other.undershoot_errors[n]
    return replace(
        channel,
        rise_time=_bounded(channel.rise_time, rise, safety),
        settling_time=_bounded(channel.settling_time, settling, safety),
        overshoot_error=over,
        undershoot_error=under,
    )


def _bounded(reading: Reading | None, other: Reading | None, safety: float) -> Reading | None:
    if reading is None:
        return None
    if other is None:
        return replace(reading, uncertainty=math.inf)
    apart = safety * abs(reading.value - other.value)
    return replace(reading, uncertainty=apart + other.uncertainty)


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
