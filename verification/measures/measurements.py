"""What is measured on a transient: of every channel and of the network."""

from __future__ import annotations

from dataclasses import dataclass

from spice_models.definitions import FAINT, SMALL_STEP
from verification.measures.mode_fit import Mode
from verification.measures.readings import Reading, Readings, Step, latest
from verification.measures.settling import ChannelState, Settlement

NO_STEP = "no channel has a step (target equals start): a band in % of it has no width"


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
    def readings(self) -> Readings:
        """The readings alone."""
        return Readings(
            finals=tuple(c.final for c in self.channels),
            rise_times=tuple(c.rise_time for c in self.channels),
            settling_times=tuple(c.settling_time for c in self.channels),
            overshoots=tuple(c.overshoot for c in self.channels),
        )


def strongest(modes: tuple[Mode, ...], n: int, amplitude: float) -> Mode | None:
    """Return the oscillating mode with the largest share in channel `n`, None where all are faint.

    Parameters
    ----------
    amplitude : float
        Step amplitude, in the unit of the modes.
    """
    oscillating = [mode for mode in modes if mode.frequency > 0]
    mode = max(oscillating, key=lambda m: m.channels[n], default=None)
    return mode if mode is not None and mode.channels[n] > FAINT * amplitude else None


def channel_measure(
    n: int, step: Step, readings: Readings, found: Settlement, mode: Mode | None, short: str
) -> ChannelMeasure:
    """Put together what is known of channel `n`.

    Parameters
    ----------
    mode : Mode or None
        The strongest ringing in the channel.
    short : str
        Why a channel whose step is large enough has no rise time in `readings`.
    """
    rise_reason = _no_rise(step, n, found.state) or ("" if readings.rise_times[n] else short)
    return ChannelMeasure(
        index=n,
        target=float(step.target[n]),
        final=readings.finals[n],
        rise_time=None if rise_reason else readings.rise_times[n],
        settling_time=found.settling_time,
        overshoot=readings.overshoots[n],
        state=found.state,
        frequency=None if mode is None else mode.frequency,
        growth_rate=None if mode is None else mode.growth_rate,
        reason=found.reason,
        rise_reason=rise_reason,
    )


def _no_rise(step: Step, n: int, state: ChannelState) -> str:
    """Say why the rise time of channel `n` has no meaning, or nothing."""
    if not step.rising()[n]:
        return f"its own step {float(step.sizes[n])!r} is under {SMALL_STEP:.0%} of the network's"
    if state not in (ChannelState.SETTLED, ChannelState.NOT_SETTLED):
        return f"the channel is {state.value}"
    return ""


def summary(
    amplitude: float, band: float, modes: tuple[Mode, ...], channels: list[ChannelMeasure]
) -> Measurements:
    """Put channels together: the network settles with its last channel, or says why it does not."""
    times = [channel.settling_time for channel in channels]
    reason = next(
        (f"channel {c.index + 1}: {c.reason}" for c in channels if c.settling_time is None), ""
    )
    settling = None if reason else latest([time for time in times if time is not None])
    return Measurements(amplitude, band, tuple(channels), settling, reason, modes)
