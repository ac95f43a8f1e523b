"""The states of channels in words."""

from __future__ import annotations

from taction.system.quantities import show, show_rate
from taction.verification.readings.measurements import ChannelMeasure, Measurements
from taction.verification.readings.settling import ChannelState


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
