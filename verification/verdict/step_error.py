"""Bounds on the errors of a record's readings, from the readings of a better solution."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, replace

from taction.verification.readings.measurements import Measurements, summary
from taction.verification.readings.readings import Reading


@dataclass(frozen=True, slots=True)
class StepError:
    """Bounds on the errors of the readings of a simulation.

    All are infinite if nothing is known.

    Attributes
    ----------
    steady_state : float
        Of the record's end, fraction of the step amplitude.
    readings : mapping of str to float
        Of the readings of the network, in their units; 0 for a time that no channel has. Of the
        rise times, the largest error of any channel counts.
    """

    steady_state: float
    readings: Mapping[str, float]


def bounded(
    measured: Measurements, other: Measurements | None, safety: float = 1.0
) -> Measurements:
    """Return `measured` with uncertainties that hold for the true solution.

    The error of a reading is at most its difference to the reading of the better solution `other`,
    and the uncertainty of that one. A reading that only one solution has is infinitely uncertain,
    and all readings are without another solution. A settling time jumps by half a ringing period
    when a peak moves through the edge of the band, and this difference counts, too. The differences
    count `safety` times.
    """
    channels = []
    for n, channel in enumerate(measured.channels):
        better = {} if other is None else other.channels[n].readings
        known = {
            name: _bounded(reading, better.get(name), safety)
            for name, reading in channel.readings.items()
        }
        channels.append(replace(channel, readings=known))
    return summary(measured.amplitude, measured.band, measured.modes, channels)


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
    known = {name: found.uncertainty if found else 0.0 for name, found in measured.readings.items()}
    rises = (channel.rise_time for channel in measured.channels)
    known["rise_time"] = max((rise.uncertainty for rise in rises if rise is not None), default=0.0)
    return StepError(end_error / (measured.amplitude or 1.0), known)
