"""The simulation's own error: two runs at different steps, measured alike and extrapolated."""

from __future__ import annotations

import math
from dataclasses import dataclass

from spice_models.definitions import SMALL_STEP
from verification.measures.measurements import Measurements
from verification.measures.readings import Reading, Readings

LATER = 0.05  # of a settling time: how much later the second run's may be without a judgement


@dataclass(frozen=True, slots=True)
class StepError:
    """The simulation's own error, from two runs at different steps.

    `steady_state` and `overshoot` are fractions of the step amplitude, the times are in s.
    """

    steady_state: float
    settling_time: float
    rise_time: float
    overshoot: float


def undecided(fine: Measurements, coarse: Readings) -> bool:
    """Tell whether the second run must be judged before its readings count.

    So it is where it shows a time that the first run has none of, which a record that proves
    nothing would show as well, and where it settles so much later that its record may not prove it.
    """
    settled, second = fine.settling_time, coarse.settling_time
    if settled is None or second is None:
        more = second is not None
    else:
        more = second.value > (1 + LATER) * settled.value
    rises = zip((c.rise_time for c in fine.channels), coarse.rise_times, strict=True)
    return more or any(a is None and b is not None for a, b in rises)


def simulation_error(
    fine: Measurements, coarse: Readings | None, share: float, rounding: float = 0.0
) -> StepError:
    """Estimate the error of every measure of `fine` (Richardson's extrapolation).

    A settling time jumps by half a ringing period when a peak moves through the edge of the band,
    so its whole difference counts, not the extrapolated part.

    Parameters
    ----------
    fine, coarse : Measurements and Readings
        The same transient at a step and at a larger one; without a second run of an engine that
        has no step, the error is that of rounding.
    share : float
        The finer run's part of a difference: ``1/(r^p - 1)`` for a step ratio r and an order p.
    rounding : float
        What rounding left in the finer run, V. A level that moves by a fraction of itself moves
        its crossing by no more of the time.

    Returns
    -------
    StepError
        Infinite where only one of the two has the measure.
    """
    if coarse is None:
        level = rounding / (fine.amplitude or 1.0) if share == 0 else math.inf
        rise = max(_moved(time, level / SMALL_STEP) for time in fine.readings.rise_times)
        return StepError(level, _moved(fine.settling_time, level / fine.band), rise, level)
    own = fine.readings
    rises = zip(own.rise_times, coarse.rise_times, strict=True)
    return StepError(
        steady_state=share * _furthest(own.finals, coarse.finals) / (fine.amplitude or 1.0),
        settling_time=_apart(fine.settling_time, coarse.settling_time),
        rise_time=share * max(_apart(a, b) for a, b in rises),
        overshoot=share * _furthest(own.overshoots, coarse.overshoots),
    )


def _moved(time: Reading | None, share: float) -> float:
    """Return how far a reading moves with its level, s."""
    return share * (time.value if time is not None else 0.0) if share < 1 else math.inf


def _furthest(a: tuple[float, ...], b: tuple[float, ...]) -> float:
    """Return the largest difference of any channel."""
    return max(abs(x - y) for x, y in zip(a, b, strict=True))


def _apart(a: Reading | None, b: Reading | None) -> float:
    """Return how far two readings are apart, taking the nearer of a fragile one's two values."""
    if a is None or b is None:
        return 0.0 if a is b else math.inf
    values = [b.value] if b.alternative is None else [b.value, b.alternative]
    return min(abs(a.value - value) for value in values)
