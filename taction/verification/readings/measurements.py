"""Measurements of a transient: of every channel and of the network.

`system.reading_definitions` defines the readings. Only the part of a record in which every channel
is within its physical range is read. A settling time is given only if the record proves it: see
`taction.verification.readings.settling`. Times count from the first point of the record.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from taction.system.array_types import Bools, Floats
from taction.system.quantities import show, show_rate
from taction.system.reading_definitions import FAINT, READINGS, SETTLING_BAND, SMALL_STEP
from taction.verification.readings.readings import (
    Reading,
    Readings,
    Step,
    largest,
    read,
    settling_times,
    unread,
)
from taction.verification.readings.record import FEWEST_POINTS, Curve, RecordTrace, Rest
from taction.verification.readings.ringing import Mode, RecordRinging, find_ringing
from taction.verification.readings.settling import ChannelState, Settlement, prove

NO_STEP = "no channel has a step (target equals start): a band in % of it has no width"
STILL = Settlement(ChannelState.SETTLED, None, NO_STEP)


@dataclass(frozen=True, slots=True)
class ChannelMeasure:
    """Measurements of one channel."""

    index: int  # channel, from 0
    # `target`, `final`: reference steady state and last finite value, in the unit of the signals.
    target: float
    final: float
    # Every reading of `READINGS`. A time is None for the reason `rise_reason` or `reason`; an
    # excursion is 0 or more, over the finite part of the record, and 0 where A is 0.
    readings: Mapping[str, Reading | None]
    state: ChannelState  # state at the end of the record
    # `frequency`, `growth_rate`: of the strongest ringing in this channel, Hz and 1/s; for a
    # clipped channel, the growth before it clipped. None if the channel does not ring, or if no
    # modes were fitted.
    frequency: float | None
    growth_rate: float | None
    rises: bool  # whether the channel's own step is large enough for a rise time
    # `reason`, `rise_reason`: why the settling time, or the rise time, is missing; empty if it is
    # given.
    reason: str
    rise_reason: str

    @property
    def settling_time(self) -> Reading | None:
        """Settling time, s."""
        return self.readings["settling_time"]

    @property
    def rise_time(self) -> Reading | None:
        """Rise time, s."""
        return self.readings["rise_time"]

    @property
    def overshoot(self) -> float:
        """Overshoot, fraction of A."""
        found = self.readings["overshoot"]
        return found.value if found else 0.0

    @property
    def fragile(self) -> dict[str, Reading]:
        """The readings that a small shift of their level changes, by name."""
        return {name: found for name, found in self.readings.items() if found and found.fragile}


@dataclass(frozen=True, slots=True)
class Measurements:
    """Measurements of a transient."""

    amplitude: float  # step amplitude A, in the unit of the signals
    band: float  # half width of the settling band, fraction of A
    channels: tuple[ChannelMeasure, ...]  # in the order of the signals' columns
    # Readings of the network. It settles with its last channel: None unless every channel is
    # settled. It rises with its slowest channel: None if a channel that rises has no rise time. Of
    # the excursions the largest counts.
    readings: Mapping[str, Reading | None]
    reason: str  # why there is no settling time; empty if there is
    # Ringing fitted to the channels together, strongest first; empty if `measure` fits no modes.
    modes: tuple[Mode, ...]

    @property
    def settling_time(self) -> Reading | None:
        """Settling time of the network, s."""
        return self.readings["settling_time"]

    @property
    def rise_time(self) -> Reading | None:
        """Rise time of the network, s."""
        return self.readings["rise_time"]


def channel_measure(
    n: int,
    final: float,
    step: Step,
    readings: Readings,
    settlement: Settlement,
    modes: Sequence[Mode],
    short: str,
) -> ChannelMeasure:
    """Return the measurements of channel `n`, in which it rings as the strongest of `modes`.

    `final` is its last value; `short` is why a channel whose step is large enough has no rise time
    in `readings`. A share of at most `FAINT` of the step amplitude is no ringing.
    """
    found = {name: of_channels[n] for name, of_channels in readings.items()}
    rise_reason = _no_rise(step, n, settlement.state) or ("" if found["rise_time"] else short)
    if rise_reason:
        found["rise_time"] = None
    found["settling_time"] = settlement.settling_time
    ringing = [mode for mode in modes if mode.frequency > 0]
    mode = max(ringing, key=lambda each: each.channels[n], default=None)
    if mode is not None and not mode.channels[n] > FAINT * step.amplitude:
        mode = None
    return ChannelMeasure(
        index=n,
        target=float(step.target[n]),
        final=final,
        readings=found,
        state=settlement.state,
        frequency=None if mode is None else mode.frequency,
        growth_rate=None if mode is None else mode.growth_rate,
        rises=bool(step.rising[n]),
        reason=settlement.reason,
        rise_reason=rise_reason,
    )


def _no_rise(step: Step, n: int, state: ChannelState) -> str:
    """Return why the rise time of channel `n` has no meaning; empty if it has a meaning."""
    if not step.rising[n]:
        size = float(step.sizes[n])
        return f"the channel's own step {size!r} is under {SMALL_STEP:.0%} of the network's step"
    if state not in (ChannelState.SETTLED, ChannelState.NOT_SETTLED):
        return f"the channel is {state.value}"
    return ""


def summary(
    amplitude: float,
    band: float,
    modes: tuple[Mode, ...],
    channels: Sequence[ChannelMeasure],
) -> Measurements:
    """Return the measurements of the network."""
    reason = next(
        (f"channel {c.index + 1}: {c.reason}" for c in channels if c.settling_time is None), ""
    )
    readings = {name: _of_network(name, channels) for name in READINGS}
    return Measurements(amplitude, band, tuple(channels), readings, reason, modes)


def _of_network(name: str, channels: Sequence[ChannelMeasure]) -> Reading | None:
    """Return the largest reading of any channel; None if one that should have it has none."""
    counted = [c.readings[name] for c in channels if c.rises or name != "rise_time"]
    known = [reading for reading in counted if reading is not None]
    return largest(known) if known and len(known) == len(counted) else None


def describe_states(measurements: Measurements) -> str:
    """Name the channels that have not settled, with the frequency and growth rate of ringing."""
    groups: dict[ChannelState, list[ChannelMeasure]] = {}
    for channel in measurements.channels:
        groups.setdefault(channel.state, []).append(channel)
    parts = []
    for state, channels in groups.items():
        if state is ChannelState.SETTLED:
            continue
        where = "channel " + ", ".join(str(channel.index + 1) for channel in channels)
        if len(channels) == len(measurements.channels) > 1:
            where = "every channel"
        text = f"{where} {state.value}"
        first = channels[0]
        if first.frequency is not None:
            text += f" at {show(first.frequency, 'Hz')}"
        if first.growth_rate is not None:
            text += f", growth rate {show_rate(first.growth_rate)}"
        parts.append(text)
    return "; ".join(parts)


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
    grows: bool = False,
) -> Measurements:
    """Measure a transient against its reference steady state.

    `time` (P,): strictly increasing, s; need not be uniform.
    `u` (P, N): channels.
    `target` (N,): reference steady state, finite, in the unit of `u`.
    `start` (N,): value before the step; the first point by default.
    `band`: half width of the settling band, fraction of A.
    `bound`: largest magnitude that a channel can physically have, in the unit of `u`; a channel
      that exceeds the bound has diverged.
    `expected_stop`: expected end of the record, s; a shorter record proves no settling time.
    `error`: bound of the error of ``u - target``, in the unit of `u`; the uncertainties of the
      readings include it.
    `rest`: where the channels come to rest, which over- and undershoots include.
    `curve`: channels (Q,) at instants (Q,), also between the points; without it they are
      interpolated.
    `grows`: of an unstable board, whose rises and excursions depend on the end of the record: they
      are not read.
    ValueError: shapes that do not match, time that does not increase, a target or a band that is
      not usable: mistakes of the caller, not properties of a waveform.
    """
    _check(time, u, target, band)
    start = u[0] if start is None else start
    step = Step(np.where(np.isfinite(start), start, target), target)
    sound, lost = _sound(u, np.finfo(np.float64).max if bound is None else bound)
    cut = _cut(time, sound, lost, expected_stop)
    final = u[sound - 1] if sound else step.start
    time, u = time[:sound], u[:sound]
    errors = np.subtract(u.T, target[:, None], order="C")
    # Without a step the band is a fraction of the largest excursion of any channel.
    scale = step.amplitude or float(np.abs(errors).max(initial=0.0))
    readings, ringing = unread(target.size), RecordRinging.none(time, target.size)
    if sound >= FEWEST_POINTS:
        ends = None if cut or rest is None else replace(rest, values=rest.values - target)
        between = None if curve is None else (lambda t, n: curve(t, n) - target[n])
        trace = RecordTrace(time, errors, error, ends, between)
        if grows:
            readings = {**readings, "settling_time": settling_times(trace, band * scale)}
        else:
            readings = read(trace, step, band * scale, lost)
        ringing = find_ringing(time, u)
    record = _Record(time, errors, final, lost, cut, step, band * scale, scale, readings, ringing)
    channels = [record.channel(n) for n in range(target.size)]
    return summary(step.amplitude, band, record.modes, channels)


@dataclass(frozen=True, slots=True, eq=False)
class _Record:
    """The sound part of a record, which may be cut, with its readings and its ringing."""

    time: Floats
    errors: Floats
    final: Floats
    lost: Bools  # channels that leave their physical range at its end
    cut: str  # why it proves no settling time; empty for a whole record
    step: Step
    tolerance: float  # half width of the settling band
    scale: float
    readings: Readings
    ringing: RecordRinging

    @property
    def modes(self) -> tuple[Mode, ...]:
        """The fitted mode, if there is one."""
        return () if self.ringing.mode is None else (self.ringing.mode,)

    def settlement(self, n: int) -> Settlement:
        """Return the state of channel `n`, also of a record that is cut or has no step."""
        if self.lost[n]:
            reason = f"the channel left its physical range: {self.cut}"
            return Settlement(ChannelState.DIVERGED, None, reason)
        found = Settlement(ChannelState.NOT_SETTLED, None, self.cut)
        if self.time.size >= FEWEST_POINTS:
            at, ringing = self.readings["settling_time"][n], self.ringing.of(n)
            proven = prove(self.time, self.errors[n], at, self.tolerance, self.scale, ringing)
            if proven.state is not ChannelState.SETTLED:
                found = proven
            elif not self.cut:
                found = proven if self.step.amplitude else STILL
        return found

    def channel(self, n: int) -> ChannelMeasure:
        """Measure channel `n`."""
        found, short, final, step = self.settlement(n), self.cut, float(self.final[n]), self.step
        if self.time.size >= FEWEST_POINTS and step.sizes[n]:
            reached = 1 + float((self.errors[n] / step.sizes[n]).max())
            short = f"the channel reaches {reached:.1%} of its step: simulate longer"
        measured = channel_measure(n, final, step, self.readings, found, self.modes, short)
        if found.state is ChannelState.CLIPPED and self.ringing.period:
            return replace(measured, frequency=1.0 / self.ringing.period)
        return measured


def _sound(u: Floats, limit: float) -> tuple[int, Bools]:
    """Return how many points (P, N) are within a limit, and which channels then leave it, (N,)."""
    if u.max() <= limit and u.min() >= -limit:  # not where a sample is not a number
        return len(u), np.zeros(u.shape[1], dtype=np.bool_)
    wrong = ~(np.abs(u) <= limit)
    sound = int(wrong.any(axis=1).argmax())
    return sound, wrong[sound]


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
