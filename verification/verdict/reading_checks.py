"""The checks of the readings: settling time, rise time and excursions."""

from __future__ import annotations

import math
from dataclasses import replace

from taction.system.quantities import show
from taction.system.reading_definitions import READINGS
from taction.verification.readings.readings import Reading
from taction.verification.verdict.checks import (
    Check,
    Evidence,
    Outcome,
    at_most,
    failed,
    joined,
    percent,
    undecided,
)


def settling_time(evidence: Evidence) -> Check:
    """Check when the last channel enters its band."""
    limits = evidence.checks.settling_time
    reading, maximum = evidence.measurements.settling_time, limits.max
    if evidence.growth:
        return failed("settling_time", f"it never settles: the board {evidence.growth}", maximum)
    if evidence.obstacle:
        return undecided("settling_time", "s", evidence.obstacle, maximum)
    band, static = f"±{100 * limits.band:g} % of the step amplitude", percent(evidence.static)
    if evidence.static - evidence.static_error > limits.band:
        reason = f"the equilibrium is {static} off the reference, outside {band}"
        return failed("settling_time", reason, maximum)
    if reading is None:
        return _unsettled(evidence)
    if short := evidence.too_short(limits.band - evidence.static):
        return undecided("settling_time", "s", short, maximum)
    check = _timed("settling_time", reading, maximum, f"to {band}")
    return _not_below(limits.min, check, reading, f"to {band}")


def _unsettled(evidence: Evidence) -> Check:
    """Judge a board that comes to rest inside the band, and whose record does not show when."""
    limits, reason = evidence.checks.settling_time, evidence.measurements.reason
    if evidence.unsteady and not evidence.steady.linear:
        return failed("settling_time", reason, limits.max)
    outside = evidence.at_end - evidence.error.steady_state - evidence.reference_error > limits.band
    if outside and limits.max is not None and evidence.end > limits.max:
        reason = f"{percent(evidence.at_end)} off the reference at {show(evidence.end, 's')}"
        return failed("settling_time", f"outside the band after the limit: {reason}", limits.max)
    short = evidence.too_short(0.5 * (limits.band - evidence.static))
    return undecided("settling_time", "s", joined(reason, short), limits.max)


def rise_time(evidence: Evidence) -> Check | None:
    """Check the rise time of one channel, by default the middle one."""
    limits = evidence.checks.rise_time
    if limits is None:
        return None
    channels = evidence.measurements.channels
    number = limits.channel or (len(channels) + 1) // 2
    obstacle = evidence.growth and f"the board {evidence.growth}"
    if obstacle := obstacle or evidence.obstacle:
        return undecided("rise_time", "s", obstacle, limits.max)
    if number > len(channels):
        reason = f"the scene has no channel {number}; it has {len(channels)} channels"
        return undecided("rise_time", "s", reason, limits.max)
    channel = channels[number - 1]
    if channel.rise_time is None:
        short = evidence.too_short(evidence.checks.steady_state.tolerance)
        reason = joined(f"channel {number}: {channel.rise_reason}", short)
        return undecided("rise_time", "s", reason, limits.max)
    text = f"10-90 % of channel {number}"
    check = _timed("rise_time", channel.rise_time, limits.max, text)
    return _not_below(limits.min, check, channel.rise_time, text)


def excursion(name: str, evidence: Evidence) -> Check | None:
    """Check an excursion, by `name`."""
    limits = getattr(evidence.checks, name)
    if limits is None:
        return None
    if evidence.growth:
        reason = f"no limit: the board {evidence.growth}"
        return Check(name, Outcome.FAIL, None, None, limits.max, None, "step", reason)
    if evidence.obstacle:
        return undecided(name, "step", evidence.obstacle, limits.max)
    reading = evidence.measurements.readings[name]
    value, error = 0.0 if reading is None else reading.value, evidence.error.readings[name]
    outcome, reason = at_most(value, error, limits.max), f"largest {name} of any channel"
    if evidence.unsteady and not evidence.steady.linear:
        outcome, reason = Outcome.FAIL, evidence.unsteady
    elif outcome is Outcome.PASS and (doubt := _later(evidence, value, limits.max)):
        outcome, reason = Outcome.INCONCLUSIVE, doubt
    return Check(name, outcome, value, error, limits.max, None, "step", reason)


def _later(evidence: Evidence, value: float, limit: float) -> str:
    """Return why an excursion after the record may exceed `limit`; empty if none can.

    After the record an output is at most so far from its target as its equilibrium and what the
    modes leave; and at most so far beyond the excursion `value` as it still moves.
    """
    if obstacle := evidence.disagreement:
        return obstacle
    room = max(limit - evidence.static, limit - value - evidence.apart)
    return evidence.too_short(room) or ("" if evidence.steady.linear else evidence.perhaps_ringing)


def _timed(name: str, reading: Reading, limit: float | None, text: str) -> Check:
    uncertainty = reading.uncertainty
    outcome, reason = Outcome.PASS, text
    if not math.isfinite(uncertainty):
        reason += "; no second solution confirms this time"
        return Check(name, Outcome.INCONCLUSIVE, reading.value, None, limit, None, "s", reason)
    if limit is not None:
        outcome = at_most(reading.value, uncertainty, limit)
        if outcome is Outcome.INCONCLUSIVE:
            reason += "; the limit is within the uncertainty"
    if reading.fragile and reading.alternative is not None:
        other = show(reading.alternative, "s")
        reason += f"; fragile: {other} with {READINGS[name].shifted}"
        if limit is not None and at_most(reading.alternative, uncertainty, limit) is not outcome:
            outcome = Outcome.INCONCLUSIVE
    return Check(name, outcome, reading.value, uncertainty, limit, None, "s", reason)


def _not_below(least: float | None, check: Check, reading: Reading, text: str) -> Check:
    """Return `check` with the lower limit `least`, if its upper limit is kept."""
    if least is None or check.outcome is not Outcome.PASS:
        return check
    values = [reading.value, reading.alternative or reading.value]
    lower, other = (at_most(-value, check.uncertainty or 0.0, -least) for value in values)
    lower = lower if lower is other else Outcome.INCONCLUSIVE  # fragile
    return replace(check, outcome=lower, reason=f"{text}; at least {show(least, 's')}")
