"""The readings and the state of every channel of a transient.

`system.reading_definitions` defines the readings. Only the part of a record in which every channel
is within its physical range is read. A settling time is given only if the record proves it: see
`taction.verification.readings.settling`. Times count from the first point of the record.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from taction.system.array_types import Bools, Floats
from taction.system.reading_definitions import SETTLING_BAND
from taction.verification.readings.envelope import Envelope, envelope
from taction.verification.readings.measurements import (
    NO_STEP,
    ChannelMeasure,
    Measurements,
    channel_measure,
    strongest,
    summary,
)
from taction.verification.readings.mode_fit import Mode, fit_modes
from taction.verification.readings.readings import Readings, Step, read, unread
from taction.verification.readings.settling import (
    ChannelRinging,
    ChannelState,
    Drift,
    Settlement,
    prove,
)
from taction.verification.readings.signals import (
    FEWEST_POINTS,
    ContinuousSignal,
    Curve,
    Rest,
    SampledSignal,
)


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
    """Cut a record where a channel leaves its physical range; parameters as `measure`."""
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


def measure(
    time: Floats,
    u: Floats,
    target: Floats,
    start: Floats | None = None,
    *,
    band: float = SETTLING_BAND,
    bound: float | None = None,
    expected_stop: float | None = None,
    error: float = 0.0,
    rest: Rest | None = None,
    curve: Curve | None = None,
) -> Measurements:
    """Measure a transient against its reference steady state.

    Parameters
    ----------
    time : ndarray (P,)
        Strictly increasing, s; need not be uniform.
    u : ndarray (P, N)
        Channels.
    target : ndarray (N,)
        Reference steady state, finite, in the unit of `u`.
    start : ndarray (N,), optional
        Value before the step; the first point by default.
    band : float
        Half width of the settling band, fraction of A.
    bound : float, optional
        Largest magnitude that a channel can physically have, in the unit of `u`; a channel that
        exceeds the bound has diverged.
    expected_stop : float, optional
        Expected end of the record, s; a shorter record proves no settling time.
    error : float
        Bound of the error of ``u - target``, in the unit of `u`; the uncertainties of the readings
        include it.
    rest : Rest, optional
        Where the channels come to rest, which over- and undershoots include.
    curve : callable, optional
        Channels (Q,) at instants (Q,), also between the points; without it they are interpolated.

    Raises
    ------
    ValueError
        Shapes that do not match, time that does not increase, a target or a band that is not
        usable: mistakes of the caller, not properties of a waveform.
    """
    _check(time, u, target, band)
    part = sound_part(time, u, target, start, bound, expected_stop, error, rest, curve)
    t = part.signal.time
    v, drift = u[: t.size], Drift(t, part.signal.errors)
    ringing, modes = Envelope(t[:1], np.zeros((1, u.shape[1])), None), tuple[Mode, ...]()
    amplitude = part.step.amplitude
    if part.readable:
        ringing = envelope(t, v)
        modes = fit_modes(t, v, ringing=ringing)
    record = _Record(part, v, part.read(band), drift, band, ringing, modes)
    channels = [_channel(record, n) for n in range(target.size)]
    return summary(amplitude, band, modes, channels)


@dataclass(frozen=True, slots=True, eq=False)
class _Record:
    """The sound part of a record and the results that all channels share."""

    part: SoundPart
    u: Floats
    readings: Readings
    drift: Drift
    band: float
    ringing: Envelope
    modes: tuple[Mode, ...]


def _check(time: Floats, u: Floats, target: Floats, band: float) -> None:
    """Raise ValueError for arguments that are not usable."""
    mistakes = (
        (time.ndim != 1 or time.size < 1, "time must have the shape (P,), P at least 1"),
        (u.shape != (*time.shape, *target.shape), "u must have the shape (P, N) of time, target"),
        (not np.isfinite(target).all(), "the target must be finite"),
        (not np.all(np.diff(time) > 0), "time must increase strictly"),
        (not 0 < band < 1, "the band must be between 0 and 1"),
    )
    for wrong, text in mistakes:
        if wrong:
            raise ValueError(text)


def _settlement(record: _Record, n: int, ring: ChannelRinging) -> Settlement:
    """Return the state of channel `n`, also for a record that is cut or has no step."""
    part = record.part
    if part.lost[n]:
        reason = f"the channel left its physical range: {part.cut}"
        return Settlement(ChannelState.DIVERGED, None, reason)
    if not part.readable:
        return Settlement(ChannelState.NOT_SETTLED, None, part.cut)
    # Without a step the band is a fraction of the largest excursion of any channel.
    scale = part.scale()
    settling_time = record.readings["settling_time"][n]
    settlement = prove(record.drift, n, settling_time, record.band * scale, scale, ring)
    if part.cut and settlement.state is ChannelState.SETTLED:
        return Settlement(ChannelState.NOT_SETTLED, None, part.cut)
    if part.step.amplitude == 0 and settlement.state is ChannelState.SETTLED:
        return Settlement(ChannelState.SETTLED, None, NO_STEP)
    return settlement


def _channel(record: _Record, n: int) -> ChannelMeasure:
    """Measure channel `n`."""
    part, env = record.part, record.ringing
    mode = strongest(record.modes, n, part.step.amplitude)
    share = 0.0 if mode is None else mode.channels[n]
    ring = ChannelRinging(env.time, env.amplitude[:, n], env.period, mode, share)
    settlement = _settlement(record, n, ring)
    size, short = float(part.step.sizes[n]), part.cut
    if part.readable and size:
        reached = 1 + float((part.signal.errors[n] / size).max())
        short = f"the channel reaches {reached:.1%} of its step: simulate longer"
    final = float(part.final[n])
    measured = channel_measure(n, final, part.step, record.readings, settlement, mode, short)
    if settlement.state is ChannelState.CLIPPED:
        return replace(measured, frequency=_limit_cycle_frequency(record, n))
    return measured


def _limit_cycle_frequency(record: _Record, n: int) -> float | None:
    """Return the frequency of channel `n`'s limit cycle, Hz, from the last fifth of the record."""
    time = record.part.signal.time
    first = int(np.searchsorted(time, time[0] + 0.8 * np.ptp(time)))
    modes = fit_modes(time[first:], record.u[first:, n : n + 1])
    lines = [m.frequency for m in modes if m.frequency > 0]
    period = record.ringing.period
    return lines[0] if lines else (1 / period if period else None)
