"""Rise time, settling time, overshoot and state of every channel of a transient.

Definitions, once for the whole tool, with the network's step amplitude
``A = max_n |target_n - start_n|``:

- settling time to x %: the last instant at which any channel is outside ``±x % A`` of its target;
- rise time: from 10 % to 90 % of a channel's own step, first crossings; not applicable where that
  step is under 5 % of A;
- overshoot: how far a channel goes beyond its target, as a fraction of A.

A settling time is given only where the record proves it: see
`verification.measures.settling`. The times count from the record's first point.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from spice_models.array_types import Floats
from verification.measures.channel_readings import SMALL_STEP, Look, SoundPart, look, sound_part
from verification.measures.envelope import Envelope, envelope
from verification.measures.mode_fit import Mode, fit_modes
from verification.measures.settling import ChannelState, Drift, Judgement, Ringing, judge, silent
from verification.measures.times import Reading, latest

__all__ = ["ChannelMeasure", "ChannelState", "Measurements", "Reading", "measure"]

_FAINT = 1e-5  # of A: a mode below has no share in a channel


@dataclass(frozen=True, slots=True)
class ChannelMeasure:
    """What one channel did.

    Attributes
    ----------
    index : int
        Channel, from 0.
    target, final : float
        Reference steady state and last finite value, in the unit of the signals.
    rise_time : Reading or None
        s; `rise_reason` says why not.
    settling_time : Reading or None
        s; `reason` says why not.
    overshoot : float
        Fraction of A, 0 or more, over the finite part of the record; 0 where A is 0.
    state : ChannelState
        How the record ends.
    frequency, growth_rate : float or None
        Of the strongest ringing in this channel, Hz and 1/s; of a clipped channel the growth
        before it clipped. None where nothing rings, or where no modes were fitted.
    reason : str
        Why the channel is not settled; empty if it is.
    rise_reason : str
        Why there is no rise time; empty if there is.
    """

    index: int
    target: float
    final: float
    rise_time: Reading | None
    settling_time: Reading | None
    overshoot: float
    state: ChannelState
    frequency: float | None
    growth_rate: float | None
    reason: str
    rise_reason: str


@dataclass(frozen=True, slots=True)
class Measurements:
    """A transient measured.

    Attributes
    ----------
    amplitude : float
        Step amplitude A, in the unit of the signals.
    band : float
        Half width of the settling band, fraction of A.
    channels : tuple of ChannelMeasure
        In the order of the signals' columns.
    settling_time : Reading or None
        Of the network: the last channel's; None unless every channel is settled.
    reason : str
        Why there is no settling time; empty if there is.
    modes : tuple of Mode
        Ringing fitted to the channels together, strongest first; empty where `measure` was spared
        the fit.
    """

    amplitude: float
    band: float
    channels: tuple[ChannelMeasure, ...]
    settling_time: Reading | None
    reason: str
    modes: tuple[Mode, ...]

    @property
    def look(self) -> Look:
        """The readings alone."""
        return Look(
            finals=tuple(c.final for c in self.channels),
            rise_times=tuple(c.rise_time for c in self.channels),
            settling_times=tuple(c.settling_time for c in self.channels),
            overshoots=tuple(c.overshoot for c in self.channels),
        )


def measure(
    time: Floats,
    u: Floats,
    target: Floats,
    start: Floats | None = None,
    *,
    band: float = 0.01,
    rise: tuple[float, float] = (0.1, 0.9),
    bound: float | None = None,
    expected_stop: float | None = None,
    details: bool = True,
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
    rise : tuple of float
        Levels of the rise time, fractions of a channel's own step.
    bound : float, optional
        A magnitude that no channel can physically exceed, in the unit of `u`; what does has
        diverged.
    expected_stop : float, optional
        Instant up to which the record was to run, s; a shorter record settles nothing.
    details : bool
        False: modes are fitted only where a channel's state depends on them, not where every
        channel is silent at its end.

    Raises
    ------
    ValueError
        Shapes that do not match, time that does not increase, a target or levels that are not
        usable: mistakes of the caller, not properties of a waveform.
    """
    _check(time, u, target, band, rise)
    part = sound_part(time, u, target, start, bound, expected_stop)
    t, v, drift = part.time, u[: part.time.size], Drift(part.time, part.errors)
    ringing, modes = Envelope(t[:1], np.zeros((1, u.shape[1])), None), tuple[Mode, ...]()
    if part.readable:
        ringing = envelope(t, v)
        over = not part.cut and silent(drift, ringing.amplitude, band * part.amplitude)
        modes = () if over and not details else fit_modes(t, v, ringing=ringing)
    record = _Record(part, v, look(part, band, rise), drift, band, ringing, modes)
    channels = tuple(_channel(record, n) for n in range(target.size))
    settling, reason = network_settling_time(channels)
    return Measurements(part.amplitude, band, channels, settling, reason, modes)


def glance(
    time: Floats,
    u: Floats,
    target: Floats,
    start: Floats | None = None,
    *,
    band: float = 0.01,
    rise: tuple[float, float] = (0.1, 0.9),
    bound: float | None = None,
    expected_stop: float | None = None,
) -> Look:
    """Read a transient without judging whether it settled; parameters and errors as `measure`.

    A settling time is when the channel was last outside its band. It is left out where `measure`
    never has one: in a record that is cut short, and without a step.
    """
    _check(time, u, target, band, rise)
    part = sound_part(time, u, target, start, bound, expected_stop)
    seen = look(part, band, rise)
    if part.cut or part.amplitude == 0:
        seen = replace(seen, settling_times=(None,) * target.size)
    return seen


@dataclass(frozen=True, slots=True, eq=False)
class _Record:
    """The sound part of a record and what is known of all channels together."""

    part: SoundPart
    u: Floats
    seen: Look
    drift: Drift
    band: float
    ringing: Envelope
    modes: tuple[Mode, ...]


def _check(time: Floats, u: Floats, target: Floats, band: float, rise: tuple[float, float]) -> None:
    """Raise ValueError on arguments that no record could make right."""
    mistakes = (
        (time.ndim != 1 or time.size < 1, "time must have the shape (P,), P at least 1"),
        (u.shape != (*time.shape, *target.shape), "u must have the shape (P, N) of time, target"),
        (not np.isfinite(target).all(), "the target must be finite"),
        (not np.all(np.diff(time) > 0), "time must increase strictly"),
        (not 0 < band < 1, "the band must be between 0 and 1"),
        (not 0 <= rise[0] < rise[1] <= 1, "the rise levels must be increasing, in 0 to 1"),
    )
    for wrong, text in mistakes:
        if wrong:
            raise ValueError(text)


def _judged(record: _Record, n: int, ring: Ringing) -> Judgement:
    """Judge channel `n`, also where the record is cut or there is no step."""
    part = record.part
    if part.lost[n]:
        return Judgement(ChannelState.DIVERGED, None, f"it left its physical range: {part.cut}")
    if not part.readable:
        return Judgement(ChannelState.NOT_SETTLED, None, part.cut)
    # Without a step the largest excursion of any channel tells whether one comes back.
    scale = part.amplitude or float(np.abs(part.errors).max())
    settling = record.seen.settling_times[n]
    found = judge(record.drift, n, settling, record.band * scale, scale, ring)
    if part.cut and found.state is ChannelState.SETTLED:
        return Judgement(ChannelState.NOT_SETTLED, None, part.cut)
    if part.amplitude == 0 and found.state is ChannelState.SETTLED:
        reason = "no channel has a step (target equals start): a band in % of it has no width"
        return Judgement(ChannelState.SETTLED, None, reason)
    return found


def _channel(record: _Record, n: int) -> ChannelMeasure:
    """Measure channel `n`."""
    part, seen, env = record.part, record.seen, record.ringing
    oscillating = [m for m in record.modes if m.frequency > 0]
    mode = max(oscillating, key=lambda m: m.channels[n], default=None)
    share = mode.channels[n] if mode is not None else 0.0
    mode = mode if share > _FAINT * part.amplitude else None
    ring = Ringing(env.time, env.amplitude[:, n], env.period, mode, share)
    found = _judged(record, n, ring)
    frequency = mode.frequency if mode is not None else None
    if found.state is ChannelState.CLIPPED:
        frequency = _cycle(record, n)
    rise_reason = _no_rise(record, n, found.state)
    return ChannelMeasure(
        index=n,
        target=float(part.target[n]),
        final=seen.finals[n],
        rise_time=None if rise_reason else seen.rise_times[n],
        settling_time=found.settling_time,
        overshoot=seen.overshoots[n],
        state=found.state,
        frequency=frequency,
        growth_rate=mode.growth_rate if mode is not None else None,
        reason=found.reason,
        rise_reason=rise_reason,
    )


def _cycle(record: _Record, n: int) -> float | None:
    """Return the frequency of channel `n`'s limit cycle, Hz, from the last fifth of the record."""
    time = record.part.time
    first = int(np.searchsorted(time, time[0] + 0.8 * np.ptp(time)))
    modes = fit_modes(time[first:], record.u[first:, n : n + 1])
    lines = [m.frequency for m in modes if m.frequency > 0]
    period = record.ringing.period
    return lines[0] if lines else (1 / period if period else None)


def _no_rise(record: _Record, n: int, state: ChannelState) -> str:
    """Say why channel `n` has no rise time, or nothing."""
    part = record.part
    step = float(part.target[n] - part.start[n])
    if abs(step) < SMALL_STEP * part.amplitude or step == 0:
        return f"its own step {step!r} is under {SMALL_STEP:.0%} of the network's"
    if state not in (ChannelState.SETTLED, ChannelState.NOT_SETTLED) or not part.readable:
        return f"the channel is {state.value}"
    if record.seen.rise_times[n] is None:
        reached = 1 + float((part.errors[n] / step).max())
        return f"it reaches {reached:.1%} of its step: simulate longer"
    return ""


def network_settling_time(channels: tuple[ChannelMeasure, ...]) -> tuple[Reading | None, str]:
    """Return the last channel's settling time, or the reason of the first that has none."""
    readings = []
    for channel in channels:
        if channel.settling_time is None:
            return None, f"channel {channel.index + 1}: {channel.reason}"
        readings.append(channel.settling_time)
    return latest(readings), ""
