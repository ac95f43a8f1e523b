"""Rise time, settling time, overshoot and state of every channel of a transient.

Definitions, once for the whole tool, with the network's step amplitude
``A = max_n |target_n - start_n|``:

- settling time to x %: the last instant at which any channel is outside ``±x % A`` of its target;
- rise time: from 10 % to 90 % of a channel's own step, first crossings; not applicable where that
  step is under 5 % of A;
- overshoot: how far a channel goes beyond its target, as a fraction of A.

The numbers stand in `spice_models.definitions`. A settling time is given only where the
record proves it: see `verification.measures.settling`. The times count from the record's first
point.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from spice_models.array_types import Floats
from spice_models.definitions import SETTLING_BAND
from verification.measures.envelope import Envelope, envelope
from verification.measures.measurements import (
    NO_STEP,
    ChannelMeasure,
    Measurements,
    channel_measure,
    strongest,
    summary,
)
from verification.measures.mode_fit import Mode, fit_modes
from verification.measures.readings import Readings
from verification.measures.sampled_signal import SoundPart, sound_part
from verification.measures.settling import (
    ChannelRinging,
    ChannelState,
    Drift,
    Settlement,
    prove,
    silent,
)


def measure(
    time: Floats,
    u: Floats,
    target: Floats,
    start: Floats | None = None,
    *,
    band: float = SETTLING_BAND,
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
        Shapes that do not match, time that does not increase, a target or a band that is not
        usable: mistakes of the caller, not properties of a waveform.
    """
    _check(time, u, target, band)
    part = sound_part(time, u, target, start, bound, expected_stop)
    t = part.signal.time
    v, drift = u[: t.size], Drift(t, part.signal.errors)
    ringing, modes = Envelope(t[:1], np.zeros((1, u.shape[1])), None), tuple[Mode, ...]()
    amplitude = part.step.amplitude
    if part.readable:
        ringing = envelope(t, v)
        over = not part.cut and silent(drift, ringing.amplitude, band * amplitude)
        modes = () if over and not details else fit_modes(t, v, ringing=ringing)
    record = _Record(part, v, part.read(band), drift, band, ringing, modes)
    return summary(amplitude, band, modes, [_channel(record, n) for n in range(target.size)])


def read_record(
    time: Floats,
    u: Floats,
    target: Floats,
    start: Floats | None = None,
    *,
    band: float = SETTLING_BAND,
    bound: float | None = None,
    expected_stop: float | None = None,
) -> Readings:
    """Read a transient without judging whether it settled; parameters and errors as `measure`.

    A settling time is when the channel was last outside its band. It is left out where `measure`
    never has one: in a record that is cut short, and without a step.
    """
    _check(time, u, target, band)
    part = sound_part(time, u, target, start, bound, expected_stop)
    found = part.read(band)
    if part.cut or part.step.amplitude == 0:
        found = replace(found, settling_times=(None,) * target.size)
    return found


@dataclass(frozen=True, slots=True, eq=False)
class _Record:
    """The sound part of a record and what is known of all channels together."""

    part: SoundPart
    u: Floats
    readings: Readings
    drift: Drift
    band: float
    ringing: Envelope
    modes: tuple[Mode, ...]


def _check(time: Floats, u: Floats, target: Floats, band: float) -> None:
    """Raise ValueError on arguments that no record could make right."""
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
    """Tell whether channel `n` settled, also where the record is cut or there is no step."""
    part = record.part
    if part.lost[n]:
        return Settlement(ChannelState.DIVERGED, None, f"it left its physical range: {part.cut}")
    if not part.readable:
        return Settlement(ChannelState.NOT_SETTLED, None, part.cut)
    # Without a step the largest excursion of any channel tells whether a channel comes back.
    scale = part.scale()
    found = prove(
        record.drift, n, record.readings.settling_times[n], record.band * scale, scale, ring
    )
    if part.cut and found.state is ChannelState.SETTLED:
        return Settlement(ChannelState.NOT_SETTLED, None, part.cut)
    if part.step.amplitude == 0 and found.state is ChannelState.SETTLED:
        return Settlement(ChannelState.SETTLED, None, NO_STEP)
    return found


def _channel(record: _Record, n: int) -> ChannelMeasure:
    """Measure channel `n`."""
    part, env = record.part, record.ringing
    mode = strongest(record.modes, n, part.step.amplitude)
    share = 0.0 if mode is None else mode.channels[n]
    ring = ChannelRinging(env.time, env.amplitude[:, n], env.period, mode, share)
    found = _settlement(record, n, ring)
    size, short = float(part.step.sizes[n]), part.cut
    if part.readable and size:
        reached = 1 + float((part.signal.errors[n] / size).max())
        short = f"it reaches {reached:.1%} of its step: simulate longer"
    measured = channel_measure(n, part.step, record.readings, found, mode, short)
    if found.state is ChannelState.CLIPPED:
        return replace(measured, frequency=_cycle(record, n))
    return measured


def _cycle(record: _Record, n: int) -> float | None:
    """Return the frequency of channel `n`'s limit cycle, Hz, from the last fifth of the record."""
    time = record.part.signal.time
    first = int(np.searchsorted(time, time[0] + 0.8 * np.ptp(time)))
    modes = fit_modes(time[first:], record.u[first:, n : n + 1])
    lines = [m.frequency for m in modes if m.frequency > 0]
    period = record.ringing.period
    return lines[0] if lines else (1 / period if period else None)
