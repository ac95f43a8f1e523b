"""What a record shows by itself: readings of every channel, with nothing judged.

`verification.measures.measure` has the definitions and decides which of these readings a record
proves.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from spice_models.array_types import Bools, Floats
from verification.measures.crossings import highest
from verification.measures.times import Reading, latest, rises, settles

FEWEST_POINTS = 8
STILL = 1e-9  # of A: a channel's own step below has no direction
SMALL_STEP = 0.05  # of A: below, a channel has no rise time


@dataclass(frozen=True, slots=True, eq=False)
class SoundPart:
    """The part of a record before anything left its physical range.

    Attributes
    ----------
    time : ndarray (P,)
        s.
    errors : ndarray (N, P)
        Distances to the targets, a row a channel.
    target, start, final : ndarray (N,)
        Reference steady state, value before the step and last value.
    amplitude : float
        Step amplitude A.
    lost : ndarray (N,)
        Which channels left their physical range.
    cut : str
        Why the record cannot prove that anything settled, or empty.
    """

    time: Floats
    errors: Floats
    target: Floats
    start: Floats
    final: Floats
    amplitude: float
    lost: Bools
    cut: str

    @property
    def readable(self) -> bool:
        """Whether there are points enough to read a time from."""
        return self.time.size >= FEWEST_POINTS


@dataclass(frozen=True, slots=True)
class Look:
    """Readings of one record.

    Attributes
    ----------
    finals : tuple of float
        Last sound value of each channel.
    rise_times, settling_times : tuple of (Reading or None)
        Of each channel, s; None where it does not reach the levels, or ends outside its band.
    overshoots : tuple of float
        Fractions of A.
    """

    finals: tuple[float, ...]
    rise_times: tuple[Reading | None, ...]
    settling_times: tuple[Reading | None, ...]
    overshoots: tuple[float, ...]

    @property
    def settling_time(self) -> Reading | None:
        """The last channel's settling time; None unless every channel has one."""
        found = [reading for reading in self.settling_times if reading is not None]
        return latest(found) if len(found) == len(self.settling_times) else None


def sound_part(
    time: Floats,
    u: Floats,
    target: Floats,
    start: Floats | None,
    bound: float | None,
    expected_stop: float | None,
) -> SoundPart:
    """Cut a record where a channel leaves its physical range; parameters as `measures.measure`."""
    start = u[0] if start is None else start
    start = np.where(np.isfinite(start), start, target)
    limit = np.finfo(np.float64).max if bound is None else bound
    sound, lost = time.size, np.zeros(target.size, dtype=bool)
    if not (u.max() <= limit and u.min() >= -limit):  # also where one is not a number
        wrong = ~(np.abs(u) <= limit)
        sound = int(wrong.any(axis=1).argmax())
        lost = wrong[sound]
    cut = _cut(time, sound, lost, expected_stop)
    final = u[sound - 1] if sound else start
    errors = np.subtract(u[:sound].T, target[:, None], order="C")
    amplitude = float(np.abs(target - start).max())
    time = np.ascontiguousarray(time[:sound])
    return SoundPart(time, errors, target, start, final, amplitude, lost, cut)


def _cut(time: Floats, sound: int, lost: Bools, expected_stop: float | None) -> str:
    """Say why the record cannot prove that anything settled, or nothing."""
    if sound < time.size:
        return f"channel {int(np.argmax(lost)) + 1} diverged at {float(time[sound])!r} s"
    if sound < FEWEST_POINTS:
        return f"the record has {sound} points; at least {FEWEST_POINTS} are needed"
    if expected_stop is not None and time[-1] < expected_stop * (1 - 1e-9):
        return f"the record ends at {float(time[-1])!r} s, before {expected_stop!r} s"
    return ""


def look(part: SoundPart, band: float, levels: tuple[float, float]) -> Look:
    """Read what is there; without a step the band is in % of the largest excursion."""
    channels = part.target.size
    if not part.readable:
        nothing = (None,) * channels
        return Look(tuple(part.final.tolist()), nothing, nothing, (0.0,) * channels)
    amplitude, steps = part.amplitude, part.target - part.start
    scale = amplitude or float(np.abs(part.errors).max())
    wanted = rising(part) & ~part.lost
    return Look(
        finals=tuple(part.final.tolist()),
        rise_times=tuple(rises(part.time, part.errors, np.where(wanted, steps, 0.0), *levels)),
        settling_times=tuple(settles(part.time, part.errors, band * scale)),
        overshoots=_overshoots(part, steps, amplitude),
    )


def rising(part: SoundPart) -> Bools:
    """Tell which channels have a step large enough for a rise time, (N,)."""
    steps = np.abs(part.target - part.start)
    return np.asarray((steps >= SMALL_STEP * part.amplitude) & (steps > 0))


def _overshoots(part: SoundPart, steps: Floats, amplitude: float) -> tuple[float, ...]:
    """Return how far channels go beyond their targets, fractions of A; 0 without a step."""
    if amplitude == 0:
        return (0.0,) * len(steps)
    side = np.where(steps < 0, -1.0, 1.0)
    top = highest(part.time, part.errors, side)
    # A channel without a step of its own, but for rounding, may leave its target either way.
    still = np.abs(steps) <= STILL * amplitude
    if still.any():
        top[still] = np.maximum(top[still], highest(part.time, part.errors[still], -side[still]))
    return tuple((np.maximum(top, 0.0) / amplitude).tolist())
