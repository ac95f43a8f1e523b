"""The simulation's own error: two runs at different steps, measured alike and extrapolated."""

from __future__ import annotations

import math
from collections.abc import Iterable
from dataclasses import dataclass

from verification.measures import Measurements
from verification.readings import Reading


@dataclass(frozen=True, slots=True)
class StepError:
    """The simulation's own error, from two runs at different steps.

    `steady_state` and `overshoot` are fractions of the step amplitude, the times are in s.
    """

    steady_state: float
    settling_time: float
    rise_time: float
    overshoot: float


def simulation_error(fine: Measurements, coarse: Measurements | None, share: float) -> StepError:
    """Estimate the error of every measure of `fine` (Richardson's extrapolation).

    A settling time jumps by half a ringing period when a peak moves through the edge of the band,
    so its whole difference counts, not the extrapolated part.

    Parameters
    ----------
    fine, coarse : Measurements
        The same transient at a step and at a larger one; without a second run the error is 0 as
        far as the step goes, because there is none.
    share : float
        The finer run's part of a difference: ``1/(r^p - 1)`` for a step ratio r and an order p.

    Returns
    -------
    StepError
        Infinite where only one of the two has the measure.
    """
    if coarse is None:
        unknown = 0.0 if share == 0 else math.inf
        return StepError(unknown, unknown, unknown, unknown)
    pairs = list(zip(fine.channels, coarse.channels, strict=True))
    amplitude = fine.amplitude or 1.0
    return StepError(
        steady_state=share * max(abs(a.final - b.final) for a, b in pairs) / amplitude,
        settling_time=_apart(fine.settling_time, coarse.settling_time),
        rise_time=share * _largest(_apart(a.rise_time, b.rise_time) for a, b in pairs),
        overshoot=share
        * _largest(abs((a.overshoot or 0.0) - (b.overshoot or 0.0)) for a, b in pairs),
    )


def _apart(a: Reading | None, b: Reading | None) -> float:
    """Return how far two readings are apart, taking the nearer of a fragile one's two values."""
    if a is None or b is None:
        return 0.0 if a is b else math.inf
    values = [b.value] if b.alternative is None else [b.value, b.alternative]
    return min(abs(a.value - value) for value in values)


def _largest(values: Iterable[float]) -> float:
    return max(values, default=0.0)
