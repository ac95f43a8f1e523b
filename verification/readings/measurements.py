"""Measurements of a transient: of every channel and of the network."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

from taction.system.quantities import show, show_rate
from taction.system.reading_definitions import FAINT, READINGS, SMALL_STEP
from taction.verification.readings.mode_fit import Mode
from taction.verification.readings.readings import Reading, Readings, Step, largest
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
    readings : mapping of str to Reading or None
        Every reading of `READINGS`. A time is None for the reason `rise_reason` or `reason`; an
        excursion is 0 or more, over the finite part of the record, and 0 where A is 0.
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
    readings: Mapping[str, Reading | None]
    state: ChannelState
    frequency: float | None
    growth_rate: float | None
    rises: bool
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
        return _value(self.readings["overshoot"])

    @property
    def undershoot(self) -> float:
        """Undershoot, fraction of A."""
        return _value(self.readings["undershoot"])

    @property
    def fragile(self) -> dict[str, Reading]:
        """The readings that a small shift of their level changes, by name."""
        return {name: found for name, found in self.readings.items() if found and found.fragile}


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
    readings : mapping of str to Reading or None
        Readings of the network. It settles with its last channel: None unless every channel is
        settled. It rises with its slowest channel: None if a channel that rises has no rise time.
        Of the excursions the largest counts.
    reason : str
        Why there is no settling time; empty if there is.
    modes : tuple of Mode
        Ringing fitted to the channels together, strongest first; empty if `measure` fits no modes.
    """

    amplitude: float
    band: float
    channels: tuple[ChannelMeasure, ...]
    readings: Mapping[str, Reading | None]
    reason: str
    modes: tuple[Mode, ...]

    @property
    def settling_time(self) -> Reading | None:
        """Settling time of the network, s."""
        return self.readings["settling_time"]

    @property
    def rise_time(self) -> Reading | None:
        """Rise time of the network, s."""
        return self.readings["rise_time"]


def strongest(modes: tuple[Mode, ...], n: int, amplitude: float) -> Mode | None:
    """Return the oscillating mode with the largest share in channel `n`.

    None if all shares are at most `FAINT` of the step amplitude.
    """
    oscillating = [mode for mode in modes if mode.frequency > 0]
    mode = max(oscillating, key=lambda m: m.channels[n], default=None)
    return mode if mode is not None and mode.channels[n] > FAINT * amplitude else None


def channel_measure(
    n: int,
    final: float,
    step: Step,
    readings: Readings,
    settlement: Settlement,
    mode: Mode | None,
    short: str,
) -> ChannelMeasure:
    """Return the measurements of channel `n`, in which `mode` is the strongest ringing.

    `final` is its last value; `short` is why a channel whose step is large enough has no rise time
    in `readings`.
    """
    found = {name: of_channels[n] for name, of_channels in readings.items()}
    rise_reason = _no_rise(step, n, settlement.state) or ("" if found["rise_time"] else short)
    if rise_reason:
        found["rise_time"] = None
    found["settling_time"] = settlement.settling_time
    return ChannelMeasure(
        index=n,
        target=float(step.target[n]),
        final=final,
        readings=found,
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


def _value(reading: Reading | None) -> float:
    """Return the value of an excursion, which every channel has."""
    return 0.0 if reading is None else reading.value


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
