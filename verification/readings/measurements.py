"""Measurements of a transient: of every channel and of the network."""

from __future__ import annotations

from dataclasses import dataclass

from taction.system.reading_definitions import FAINT, SMALL_STEP
from taction.verification.readings.mode_fit import Mode
from taction.verification.readings.readings import Reading, Readings, Step, largest_error, latest
from taction.verification.readings.settling import ChannelState, Settlement

NO_STEP = "no channel has a step (target equals start): a band in % of it has no width"


@dataclass(frozen=True, slots=True)
class ChannelMeasure:
    """Measurements of one channel.

    Attributes
    ----------
    index : int
        Channel, from 0.
    target, final : float
        Reference steady state and last finite value, in the unit of the signals.
    rise_time, settling_time : Reading or None
        s; None for the reason `rise_reason` or `reason`.
    overshoot, undershoot : float
        Fractions of A, 0 or more, over the finite part of the record; 0 where A is 0.
    overshoot_error, undershoot_error : float
        Bounds of their errors, fractions of A.
    state : ChannelState
        State at the end of the record.
    frequency, growth_rate : float or None
        Of the strongest ringing in this channel, Hz and 1/s; for a clipped channel, the growth
        before it clipped. None if the channel does not ring, or if no modes were fitted.
    rises : bool
        Whether the channel's own step is large enough for a rise time.
    reason, rise_reason : str
        Why the settling time, or the rise time, is missing; empty if it is given.
    """

    index: int
    target: float
    final: float
    rise_time: Reading | None
    settling_time: Reading | None
    overshoot: float
    undershoot: float
    overshoot_error: float
    undershoot_error: float
    state: ChannelState
    frequency: float | None
    growth_rate: float | None
    rises: bool
    reason: str
    rise_reason: str


@dataclass(frozen=True, slots=True)
class Measurements:
    """Measurements of a transient.

    Attributes
    ----------
    amplitude : float
        Step amplitude A, in the unit of the signals.
    band : float
        Half width of the settling band, fraction of A.
    channels : tuple of ChannelMeasure
        In the order of the signals' columns.
    settling_time : Reading or None
        Settling time of the last channel; None unless every channel is settled.
    reason : str
        Why there is no settling time; empty if there is.
    modes : tuple of Mode
        Ringing fitted to the channels together, strongest first; empty if `measure` fits no modes.
    """

    amplitude: float
    band: float
    channels: tuple[ChannelMeasure, ...]
    settling_time: Reading | None
    reason: str
    modes: tuple[Mode, ...]

    @property
    def rise_time(self) -> Reading | None:
        """Rise time of the slowest channel; None if a channel that rises has none."""
        found = [channel.rise_time for channel in self.channels if channel.rises]
        known = [reading for reading in found if reading is not None]
        return latest(known) if known and len(known) == len(found) else None

    @property
    def excursion_errors(self) -> tuple[float, float]:
        """Bounds of the errors of the largest overshoot and undershoot, fractions of A."""
        found = self.readings
        return (
            largest_error(found.overshoots, found.overshoot_errors),
            largest_error(found.undershoots, found.undershoot_errors),
        )

    @property
    def readings(self) -> Readings:
        """Readings without states and reasons."""
        return Readings(
            finals=tuple(c.final for c in self.channels),
            rise_times=tuple(c.rise_time for c in self.channels),
            settling_times=tuple(c.settling_time for c in self.channels),
            overshoots=tuple(c.overshoot for c in self.channels),
            undershoots=tuple(c.undershoot for c in self.channels),
            overshoot_errors=tuple(c.overshoot_error for c in self.channels),
            undershoot_errors=tuple(c.undershoot_error for c in self.channels),
        )


def strongest(modes: tuple[Mode, ...], n: int, amplitude: float) -> Mode | None:
    """Return the oscillating mode with the largest share in channel `n`.

    None if all shares are at most `FAINT` of the step amplitude.
    """
    oscillating = [mode for mode in modes if mode.frequency > 0]
    mode = max(oscillating, key=lambda m: m.channels[n], default=None)
    return mode if mode is not None and mode.channels[n] > FAINT * amplitude else None


def channel_measure(
    n: int, step: Step, readings: Readings, settlement: Settlement, mode: Mode | None, short: str
) -> ChannelMeasure:
    """Return the measurements of channel `n`, in which `mode` is the strongest ringing.

    `short` is why a channel whose step is large enough has no rise time in `readings`.
    """
    rise_reason = _no_rise(step, n, settlement.state) or ("" if readings.rise_times[n] else short)
    return ChannelMeasure(
        index=n,
        target=float(step.target[n]),
        final=readings.finals[n],
        rise_time=None if rise_reason else readings.rise_times[n],
        settling_time=settlement.settling_time,
        overshoot=readings.overshoots[n],
        undershoot=readings.undershoots[n],
        overshoot_error=readings.overshoot_errors[n],
        undershoot_error=readings.undershoot_errors[n],
        state=settlement.state,
        frequency=None if mode is None else mode.frequency,
        growth_rate=None if mode is None else mode.growth_rate,
        rises=bool(step.rising()[n]),
        reason=settlement.reason,
        rise_reason=rise_reason,
    )


def _no_rise(step: Step, n: int, state: ChannelState) -> str:
    """Return why the rise time of channel `n` has no meaning; empty if it has a meaning."""
    if not step.rising()[n]:
        size = float(step.sizes[n])
        return f"the channel's own step {size!r} is under {SMALL_STEP:.0%} of the network's step"
    if state not in (ChannelState.SETTLED, ChannelState.NOT_SETTLED):
        return f"the channel is {state.value}"
    return ""


def summary(
    amplitude: float,
    band: float,
    modes: tuple[Mode, ...],
    channels: list[ChannelMeasure],
) -> Measurements:
    """Return the measurements of the network, which settles with its last channel."""
    reason = next(
        (f"channel {c.index + 1}: {c.reason}" for c in channels if c.settling_time is None), ""
    )
    times = [c.settling_time for c in channels if c.settling_time is not None]
    settling_time = None if reason else latest(times)
    return Measurements(amplitude, band, tuple(channels), settling_time, reason, modes)
