"""The state of one channel at the end of its record, and the proof of a settling time.

A record proves that a channel settled when, at its end, the channel

1. is inside the band, and has been for 5 % of its settling time and, while it rings, for three
   ringing periods, unless what rings is by now below half the band;
2. does not ring on: what ringing is left is below 5 % of the band, or fades (`_loss`);
3. does not drift out again: the limit extrapolated from its last three stretches is in the band.

Everything else is another state, with a reason that says what to do.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from enum import StrEnum

import numpy as np

from taction.system.array_types import Floats
from taction.verification.readings.readings import Reading
from taction.verification.readings.ringing import GOOD_FIT, RESOLVED, Mode, RecordRinging, saturates

_DWELL = 0.05  # of the settling time: the record must continue inside the band for that long
_DWELL_PERIODS = 3.0
_SAFE = 0.5  # of the band: a decaying ringing below it will not leave the band again
_QUIET = 0.05  # of the band: ringing below it is not judged
_STEADY = 0.1  # nepers over the record: a ringing that loses less has the amplitude that it had
_FLAT_TOP = 0.2  # of a period spent within 1 % of one extreme; 0.064 for a sinusoid
_ENDS = np.array([3.0, 2.0, 1.0, 0.0])  # of the last three stretches, counted from the last
_RUNAWAY = 10.0  # step amplitudes off target, and accelerating


class ChannelState(StrEnum):
    """How a channel's record ends; the best first."""

    SETTLED = "settled"
    UNDECIDED = "undecided"
    NOT_SETTLED = "not settled"
    OSCILLATING = "oscillating"
    CLIPPED = "clipped"
    DIVERGED = "diverged"


@dataclass(frozen=True, slots=True)
class Settlement:
    """State of a channel, with its settling time or the reason why it has none."""

    state: ChannelState
    settling_time: Reading | None
    reason: str


def _heading(time: Floats, error: Floats, period: float) -> tuple[float, float]:
    """Return the limit of an error (P,) beyond the record, and the ratio of its last two changes.

    The means of the last three stretches, each a tenth of the record in whole ringing periods, form
    a geometric series for an exponential approach (Aitken's extrapolation), continued for one more
    record at most, and for one stretch if a ringing period is longer than a stretch. The ratio is 0
    for a constant error and for alternating changes.
    """
    width = 0.1 * float(np.ptp(time))
    start = max(int(np.searchsorted(time, time[-1] - 3 * width)) - 1, 0)
    marked, end = time[start:], error[start:]
    area = np.append(0.0, np.cumsum((end[1:] + end[:-1]) * (0.5 * np.diff(marked))))
    furthest = 10.0 if width >= period else 1.0
    if 0 < period <= width:
        width = period * int(width / period)
    a, b, c, d = np.interp(marked[-1] - width * _ENDS, marked, area).tolist()
    first, second, third = (b - a) / width, (c - b) / width, (d - c) / width
    before, last = second - first, third - second
    if before * last <= 0:
        return third, 0.0
    ratio = last / before
    stretches = min(ratio / (1 - ratio), furthest) if ratio < 1 else furthest
    return third + last * stretches, ratio


def _swing(time: Floats, error: Floats, quiet: float) -> float:
    """Return twice the time between the last two extremes of opposite sign, s; 0 without two.

    So long is a period of a ringing that dies too soon for a line in the spectrum. The first
    extreme is the start, and one at the end may still grow.
    """
    seen = np.flatnonzero(np.abs(error) > quiet)
    runs = np.split(seen, np.flatnonzero(np.diff(np.sign(error[seen]))) + 1)
    places = [run[np.abs(error[run]).argmax()] for run in runs[1:]]
    extremes = [float(time[place]) for place in places if place < len(time) - 1]
    return 2.0 * (extremes[-1] - extremes[-2]) if len(extremes) > 1 else 0.0


def _flat_top(time: Floats, error: Floats, period: float) -> bool:
    """Tell whether the signal stays at an extreme in its last three periods, as at a supply."""
    first = int(np.searchsorted(time, time[-1] - 3 * period))
    e, weight = error[first:], np.gradient(time[first:])
    margin = 0.01 * (e.max() - e.min())
    top, bottom = weight[e > e.max() - margin].sum(), weight[e < e.min() + margin].sum()
    return bool(max(top, bottom) > _FLAT_TOP * weight.sum())


def _loss(ring: RecordRinging) -> tuple[float, float, float]:
    """Return the least and the most nepers that the ringing loses, and what is a loss at all."""
    mode = ring.mode
    if mode is not None and mode.residual < GOOD_FIT:  # over its stretch, within two sigma
        length, doubt = mode.stop - mode.start, 2 * mode.growth_sigma
        return length * (-mode.growth_rate - doubt), length * (-mode.growth_rate + doubt), RESOLVED
    half = ring.amplitude[-max(ring.amplitude.size // 2, 1) :]
    if half.size < 2:  # nothing is known: the dwell must prove that the channel settled
        return math.inf, math.inf, 0.0
    log = np.log(np.maximum(half, np.finfo(np.float64).tiny))
    lost, doubt = float(log[0] - log[-1]), float(np.abs(np.diff(log, 2)).sum()) / half.size
    return lost - doubt, lost + doubt, _STEADY


def _left(ring: RecordRinging, end: float) -> tuple[float, float]:
    """Return the ringing's amplitude at `end` and its period (0 and 0 without ringing).

    The last window lies before the end: a good fit of a decaying mode continues its amplitude.
    """
    last, mode, period = float(ring.amplitude[-1]), ring.mode, ring.period or 0.0
    if mode is None or mode.residual > GOOD_FIT or not mode.decays:
        return last, period
    fitted = mode.channels[0] * math.exp(mode.growth_rate * (end - mode.stop))
    return max(last * math.exp(mode.growth_rate * (end - ring.time[-1])), fitted), period


def sustained(
    time: Floats, error: Floats, tolerance: float, ring: RecordRinging
) -> ChannelState | None:
    """Return OSCILLATING or CLIPPED if the channel rings on, UNDECIDED if it may, else None."""
    if ring.period is None or ring.amplitude[-1] <= _QUIET * tolerance:
        return None
    if saturates(ring.amplitude):
        return ChannelState.CLIPPED
    least, most, clear = _loss(ring)
    if least > clear or most > _STEADY:
        return None if least > clear else ChannelState.UNDECIDED
    return ChannelState.CLIPPED if _flat_top(time, error, ring.period) else ChannelState.OSCILLATING


def prove(
    time: Floats,
    error: Floats,
    found: Reading | None,
    tolerance: float,
    step: float,
    ring: RecordRinging,
) -> Settlement:
    """Tell whether a channel settled, and why not.

    `time`, `error` (P,): instants, s, and finite distances to the target; P is at least 8.
    `found`: when it was last outside its band; None if it ends outside.
    `tolerance`: half width of the settling band, in the unit of `error`.
    `step`: the network's step amplitude, in the same unit.
    `ring`: the channel's ringing.
    """
    state = sustained(time, error, tolerance, ring)
    if state is ChannelState.UNDECIDED:
        return Settlement(state, None, _either(ring, found))
    if state is not None:
        how = "at a constant amplitude" if state is ChannelState.CLIPPED else "and does not decay"
        return Settlement(state, None, f"it oscillates {how}: it never settles")
    left, period = _left(ring, float(time[-1]))
    period = period or _swing(time, error, _QUIET * tolerance)
    limit, ratio = _heading(time, error, period)
    if found is None:
        return _outside(float(error[-1]), tolerance, step, ring.mode, left, limit, ratio)
    if abs(limit) > tolerance and left < tolerance:
        reason = f"inside the band at the end but drifting towards {limit:.4g} off target"
        return Settlement(ChannelState.NOT_SETTLED, None, reason + ": simulate longer")
    dwell = float(time[-1] - time[0]) - found.value
    need = _DWELL * found.value
    if left > _SAFE * tolerance:
        need = max(need, period * _DWELL_PERIODS)
    if dwell < need:
        reason = f"inside the band for the last {dwell:.4g} s only, {need:.4g} s would prove it"
        return Settlement(ChannelState.NOT_SETTLED, None, reason + ": simulate longer")
    return Settlement(ChannelState.SETTLED, found, "")


def _either(ring: RecordRinging, found: Reading | None) -> str:
    """Give both readings of a ringing whose loss is not established."""
    least, most, _ = _loss(ring)
    settles = "it settles later" if found is None else f"the settling time is {found.value:.4g} s"
    return f"the ringing loses {least:.2g} to {most:.2g} nepers over the record: if it decays, \
{settles}; if it does not, it never settles: simulate longer"


def _outside(
    last: float,
    tolerance: float,
    step: float,
    mode: Mode | None,
    left: float,
    limit: float,
    ratio: float,
) -> Settlement:
    """Return the state of a channel that ends outside its band and does not oscillate."""
    off = f"{last:.4g} off target ({abs(last) / step:.3%} of the step)"
    if ratio >= 1 and abs(last) > _RUNAWAY * step:
        return Settlement(ChannelState.DIVERGED, None, f"{off} at the end, and accelerating")
    if left > _QUIET * tolerance and mode is not None and mode.decays:
        longer = math.log(max(left / tolerance, 2.0)) / -mode.growth_rate
        reason = f"still ringing at {mode.frequency:.4g} Hz with {left:.4g}, which decays"
        reason += f": simulate {longer:.2g} s longer"
    elif abs(limit) <= tolerance:
        reason = f"{off} at the end, still moving towards it: simulate longer"
    elif abs(limit - last) < tolerance:
        reason = f"at rest {off}: the reference and the circuit disagree"
    else:
        reason = f"{off} at the end and moving towards {limit:.4g} off target: simulate longer"
    return Settlement(ChannelState.NOT_SETTLED, None, reason)
