"""Rise time, settling time, overshoot and state of every channel of a transient.

Definitions, once for the whole tool, with the network's step amplitude
``A = max_n |target_n - start_n|``:

- settling time to x %: the last instant at which any channel is outside ``±x % A`` of its target;
- rise time: from 10 % to 90 % of a channel's own step, first crossings; not applicable where that
  step is under 5 % of A;
- overshoot: how far a channel goes beyond its target, as a fraction of A.

A settling time is given only where the record proves it: see `verification.settling`. The times
count from the record's first point.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from verification.crossings import highest
from verification.envelope import Envelope, envelope
from verification.readings import Reading, latest, rise
from verification.ringing import Mode, fit_modes
from verification.settling import ChannelState, Judgement, Ringing, judge
from verification.waveforms import Floats

Flags = NDArray[np.bool_]

__all__ = ["ChannelMeasure", "ChannelState", "Measurements", "Reading", "measure"]

_SMALL_STEP = 0.05  # of A: below, a channel has no rise time
_FEWEST_POINTS = 8
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
        before it clipped. None where nothing rings.
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
        Ringing fitted to the channels together, strongest first.
    """

    amplitude: float
    band: float
    channels: tuple[ChannelMeasure, ...]
    settling_time: Reading | None
    reason: str
    modes: tuple[Mode, ...]


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

    Raises
    ------
    ValueError
        Shapes that do not match, time that does not increase, a target or levels that are not
        usable: mistakes of the caller, not properties of a waveform.
    """
    _check(time, u, target, band, rise)
    start = u[0] if start is None else start
    start = np.where(np.isfinite(start), start, target)
    amplitude = float(np.abs(target - start).max())
    wrong = ~(np.abs(u) <= (np.finfo(np.float64).max if bound is None else bound))
    broken = np.flatnonzero(wrong.any(axis=1))
    sound = int(broken[0]) if broken.size else time.size
    cut = _cut(time, sound, wrong, expected_stop)
    t, v = time[:sound], u[:sound]
    if sound < _FEWEST_POINTS:
        ringing = Envelope(t[:1], np.zeros((1, u.shape[1])), None)
        modes: tuple[Mode, ...] = ()
    else:
        ringing = envelope(t, v)
        modes = fit_modes(t, v, ringing=ringing)
    record = _Record(t, v, target, start, amplitude, band, rise, ringing, modes, cut)
    lost = wrong[sound] if broken.size else np.zeros(target.size, dtype=bool)
    channels = tuple(_channel(record, n, bool(lost[n])) for n in range(target.size))
    settling, reason = network_settling_time(channels)
    return Measurements(amplitude, band, channels, settling, reason, modes)


@dataclass(frozen=True, slots=True, eq=False)
class _Record:
    """The sound part of a record and what is known of all channels together."""

    time: Floats
    u: Floats
    target: Floats
    start: Floats
    amplitude: float
    band: float
    rise: tuple[float, float]
    ringing: Envelope
    modes: tuple[Mode, ...]
    cut: str


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


def _cut(time: Floats, sound: int, wrong: Flags, expected_stop: float | None) -> str:
    """Say why the record cannot prove that anything settled, or nothing."""
    if sound < time.size:
        return f"channel {int(np.argmax(wrong[sound])) + 1} diverged at {float(time[sound])!r} s"
    if sound < _FEWEST_POINTS:
        return f"the record has {sound} points; at least {_FEWEST_POINTS} are needed"
    if expected_stop is not None and time[-1] < expected_stop * (1 - 1e-9):
        return f"the record ends at {float(time[-1])!r} s, before {expected_stop!r} s"
    return ""


def _judged(record: _Record, n: int, lost: bool, ring: Ringing) -> Judgement:
    """Judge channel `n`, also where the record is cut or there is no step."""
    if lost:
        return Judgement(ChannelState.DIVERGED, None, f"it left its physical range: {record.cut}")
    if record.time.size < _FEWEST_POINTS:
        return Judgement(ChannelState.NOT_SETTLED, None, record.cut)
    error = record.u[:, n] - record.target[n]
    # Without a step the largest excursion of any channel tells whether one comes back.
    scale = record.amplitude or float(np.abs(record.u - record.target).max())
    found = judge(record.time, error, record.band * scale, scale, ring)
    if record.cut and found.state is ChannelState.SETTLED:
        return Judgement(ChannelState.NOT_SETTLED, None, record.cut)
    if record.amplitude == 0 and found.state is ChannelState.SETTLED:
        reason = "no channel has a step (target equals start): a band in % of it has no width"
        return Judgement(ChannelState.SETTLED, None, reason)
    return found


def _channel(record: _Record, n: int, lost: bool) -> ChannelMeasure:
    """Measure channel `n`; `lost` if it is the one that left its physical range."""
    oscillating = [m for m in record.modes if m.frequency > 0]
    mode = max(oscillating, key=lambda m: m.channels[n], default=None)
    share = mode.channels[n] if mode is not None else 0.0
    mode = mode if share > _FAINT * record.amplitude else None
    env = record.ringing
    ring = Ringing(env.time, env.amplitude[:, n], env.period, mode, share)
    found = _judged(record, n, lost, ring)
    frequency = mode.frequency if mode is not None else None
    if found.state is ChannelState.CLIPPED:
        frequency = _cycle(record, n)
    rise_time, rise_reason = _rise_time(record, n, found.state)
    return ChannelMeasure(
        index=n,
        target=float(record.target[n]),
        final=float(record.u[-1, n]) if record.time.size else float(record.start[n]),
        rise_time=rise_time,
        settling_time=found.settling_time,
        overshoot=_overshoot(record, n),
        state=found.state,
        frequency=frequency,
        growth_rate=mode.growth_rate if mode is not None else None,
        reason=found.reason,
        rise_reason=rise_reason,
    )


def _cycle(record: _Record, n: int) -> float | None:
    """Return the frequency of channel `n`'s limit cycle, Hz, from the last fifth of the record."""
    first = int(np.searchsorted(record.time, record.time[0] + 0.8 * np.ptp(record.time)))
    modes = fit_modes(record.time[first:], record.u[first:, n : n + 1])
    lines = [m.frequency for m in modes if m.frequency > 0]
    period = record.ringing.period
    return lines[0] if lines else (1 / period if period else None)


def _rise_time(record: _Record, n: int, state: ChannelState) -> tuple[Reading | None, str]:
    """Return channel `n`'s rise time, or why it has none."""
    step = float(record.target[n] - record.start[n])
    if abs(step) < _SMALL_STEP * record.amplitude or step == 0:
        return None, f"its own step {step!r} is under {_SMALL_STEP:.0%} of the network's"
    if (
        state not in (ChannelState.SETTLED, ChannelState.NOT_SETTLED)
        or record.time.size < _FEWEST_POINTS
    ):
        return None, f"the channel is {state.value}"
    found = rise(record.time, (record.u[:, n] - record.start[n]) / step, *record.rise)
    if found is None:
        reached = float(((record.u[:, n] - record.start[n]) / step).max())
        return None, f"it reaches {reached:.1%} of its step: simulate longer"
    return found, ""


def _overshoot(record: _Record, n: int) -> float:
    """Return how far channel `n` went beyond its target, fraction of A; 0 without a step."""
    if record.amplitude == 0 or record.time.size < _FEWEST_POINTS:
        return 0.0
    error = record.u[:, n] - record.target[n]
    step = float(record.target[n] - record.start[n])
    sides = (np.sign(step),) if step else (1.0, -1.0)
    beyond = max(highest(record.time, side * error) for side in sides)
    return max(beyond, 0.0) / record.amplitude


def network_settling_time(channels: tuple[ChannelMeasure, ...]) -> tuple[Reading | None, str]:
    """Return the last channel's settling time, or the reason of the first that has none."""
    readings = []
    for channel in channels:
        if channel.settling_time is None:
            return None, f"channel {channel.index + 1}: {channel.reason}"
        readings.append(channel.settling_time)
    return latest(readings), ""
