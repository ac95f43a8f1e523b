"""The part of a record in which every channel is within its physical range."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from taction.system.array_types import Bools, Floats
from taction.verification.readings.continuous_signal import ContinuousSignal, Curve
from taction.verification.readings.readings import Readings, Step, read, unread
from taction.verification.readings.sampled_signal import FEWEST_POINTS, Rest, SampledSignal


@dataclass(frozen=True, slots=True, eq=False)
class SoundPart:
    """The part of a record before any channel leaves its physical range."""

    signal: SampledSignal
    step: Step
    final: Floats  # last values (N,)
    lost: Bools  # channels that left their physical range (N,)
    cut: str  # why the record cannot prove that a channel settled; empty for a whole record

    @property
    def readable(self) -> bool:
        """Whether the points are enough to read a time."""
        return self.signal.time.size >= FEWEST_POINTS

    def scale(self) -> float:
        """Return the step amplitude; without a step the largest excursion of any channel."""
        return self.step.amplitude or float(np.abs(self.signal.errors).max())

    def read(self, band: float) -> Readings:
        """Read the record; without a step the band is in % of the largest excursion."""
        if not self.readable:
            return unread(len(self.final))
        return read(self.signal, self.step, band * self.scale(), self.lost)


def sound_part(
    time: Floats,
    u: Floats,
    target: Floats,
    start: Floats | None,
    bound: float | None,
    expected_stop: float | None,
    error: float = 0.0,
    rest: Rest | None = None,
    curve: Curve | None = None,
) -> SoundPart:
    """Cut a record where a channel leaves its physical range; parameters as `measures.measure`."""
    start = u[0] if start is None else start
    start = np.where(np.isfinite(start), start, target)
    limit = np.finfo(np.float64).max if bound is None else bound
    sound, lost = time.size, np.zeros(target.size, dtype=bool)
    if not (u.max() <= limit and u.min() >= -limit):  # also where a sample is not a number
        wrong = ~(np.abs(u) <= limit)
        sound = int(wrong.any(axis=1).argmax())
        lost = wrong[sound]
    cut = _cut(time, sound, lost, expected_stop)
    final = u[sound - 1] if sound else start
    errors = np.subtract(u[:sound].T, target[:, None], order="C")
    ends = None if cut or rest is None else replace(rest, values=rest.values - target)
    signal = SampledSignal(np.ascontiguousarray(time[:sound]), errors, error, ends)
    if curve is not None:
        signal = ContinuousSignal(
            signal.time, errors, error, ends, curve=lambda t, n: curve(t, n) - target[n]
        )
    return SoundPart(signal, Step(start, target), final, lost, cut)


def _cut(time: Floats, sound: int, lost: Bools, expected_stop: float | None) -> str:
    """Return why the record cannot prove that a channel settled; empty for a whole record."""
    if sound < time.size:
        return f"channel {int(np.argmax(lost)) + 1} diverged at {float(time[sound])!r} s"
    if sound < FEWEST_POINTS:
        return f"the record has {sound} points; at least {FEWEST_POINTS} are needed"
    if expected_stop is not None and time[-1] < expected_stop * (1 - 1e-9):
        return f"the record ends at {float(time[-1])!r} s, before {expected_stop!r} s"
    return ""
