"""The table of checks, and the functions that judge.

The equations of the board decide: its poles say whether it is unstable, and its equilibrium where
it comes to rest. The record has to confirm both. Where it ends too early for that, the check is
inconclusive. A new check is one function and one entry in `CHECKS`, or an entry of another package.
"""

from __future__ import annotations

import math
from collections.abc import Iterable
from dataclasses import replace
from functools import partial

from taction.netlist_gen.scene import check_keys as keys
from taction.system.array_types import EPS
from taction.system.plugins import OpenTable
from taction.system.quantities import percent, show, show_pole
from taction.system.reading_definitions import EXCURSIONS, READINGS
from taction.verification.readings.measurements import ChannelMeasure
from taction.verification.readings.readings import Reading
from taction.verification.verdict.checks import (
    SPREAD,
    Check,
    CheckKind,
    Evidence,
    Outcome,
    at_most,
    doubtful,
    failed,
    joined,
    undecided,
)
from taction.verification.verdict.headroom import FULL, PartLoads, amount, describe, limited_text
from taction.verification.verdict.warnings import WELL_ABOVE


def settling_time(evidence: Evidence) -> Check:
    """Check when the last channel enters its band."""
    return replace(_settling(evidence), band=evidence.limits.settling_time.band)


def _settling(evidence: Evidence) -> Check:
    """Return the check of the settling time without its band."""
    limits = evidence.limits.settling_time
    reading, maximum = evidence.measurements.settling_time, limits.max
    if evidence.growth:
        return failed("settling_time", f"it never settles: the board {evidence.growth}", maximum)
    if evidence.obstacle:
        return undecided("settling_time", "s", evidence.obstacle, maximum)
    static, error, boards = evidence.resting
    band = f"±{100 * limits.band:g} % of the step amplitude"
    if static - error > limits.band:
        off = f"up to {percent(static)} off the reference in {SPREAD}"
        off = off if boards else f"{percent(static)} off the reference"
        reason = f"the equilibrium is {off}, outside {band}"
        return failed("settling_time", joined(reason, boards), maximum)
    if reading is None:
        return _unsettled(evidence)
    if short := evidence.too_short(limits.band - evidence.static):
        return undecided("settling_time", "s", short, maximum)
    check = _timed("settling_time", reading, maximum, f"to {band}")
    return _not_below(limits.min, check, reading, f"to {band}")


def _unsettled(evidence: Evidence) -> Check:
    """Judge a board that comes to rest inside the band, and whose record does not show when."""
    limits, reason = evidence.limits.settling_time, evidence.measurements.reason
    if evidence.unsteady and not evidence.steady.linear:
        return failed("settling_time", reason, limits.max)
    outside = evidence.at_end - evidence.error.steady_state - evidence.reference_error > limits.band
    if outside and limits.max is not None and evidence.end > limits.max:
        late = f"outside ±{100 * limits.band:g} % after {show(limits.max, 's')}, the limit"
        reason = f"{percent(evidence.at_end)} off the reference at {show(evidence.end, 's')}"
        return failed("settling_time", f"{late}: {reason}", limits.max)
    short = evidence.too_short(0.5 * (limits.band - evidence.static))
    return undecided("settling_time", "s", joined(reason, short), limits.max)


def rise_time(evidence: Evidence) -> Check | None:
    """Check the rise time of every channel that rises, or of one; the worst is reported.

    Of channels with the same outcome the slowest counts, or the fastest where all are too fast.
    """
    limits = evidence.limits.rise_time
    if limits is None:
        return None
    channels, number = evidence.measurements.channels, limits.channel
    obstacle = evidence.growth and f"the board {evidence.growth}"
    if obstacle := obstacle or evidence.obstacle:
        return undecided("rise_time", "s", obstacle, limits.max)
    if number is not None and number > len(channels):
        reason = f"the scene has no channel {number}; it has {len(channels)} channels"
        return undecided("rise_time", "s", reason, limits.max)
    if number is not None:
        return _rise(evidence, channels[number - 1], "")
    chosen = [channel for channel in channels if channel.rises] or channels
    order = sorted(chosen, key=lambda c: c.rise_time.value if c.rise_time else math.inf)
    which = [", the fastest", *[""] * len(order[2:]), ", the slowest"] if order[1:] else [""]
    every = [_rise(evidence, *each) for each in zip(order, which, strict=True)]
    outcome = max((check.outcome for check in every), key=SEVERITY.index)
    found = [check for check in every if check.outcome is outcome]
    too_fast = outcome is Outcome.FAIL and (found[-1].value or 0.0) < (limits.min or 0.0)
    return found[0 if too_fast else -1]


SEVERITY = (Outcome.PASS, Outcome.INCONCLUSIVE, Outcome.FAIL)


def _rise(evidence: Evidence, channel: ChannelMeasure, which: str) -> Check:
    """Judge the rise time of one channel; `which` says more of it."""
    limits, name = evidence.limits.rise_time or keys.RiseTimeCheck(), f"channel {channel.index + 1}"
    if channel.rise_time is None:
        short = evidence.too_short(evidence.limits.steady_state.tolerance)
        reason = joined(f"{name}: {channel.rise_reason}", short)
        return undecided("rise_time", "s", reason, limits.max)
    text = f"10-90 % of {name}{which}"
    check = _timed("rise_time", channel.rise_time, limits.max, text)
    return _not_below(limits.min, check, channel.rise_time, text)


def excursion(name: str, evidence: Evidence) -> Check | None:
    """Check an excursion, by `name`."""
    limits = getattr(evidence.limits, name)
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


UNSTATED = (
    "the voltage noise of op-amp {} is not given: set design.opamp.voltage_noise, such as"
    " '20nV/rtHz', or take a preset that has one (taction parts)"
)
NOISELESS = "op-amp {} is ideal and has no noise: only resistors and sensors count"
NO_CORNER = "1/f noise of op-amp {} not known (design.opamp.voltage_noise_corner), so left out"
NOISE_AGREES = 0.01  # of the noise: the largest difference of the two engines


def noise(evidence: Evidence) -> Check | None:
    """Compare the largest noise of any channel with the limit of the scene, if there is one."""
    found, limited = evidence.noise, evidence.limits.noise
    if found is None or limited is None:
        return None
    if found.unknown:
        return undecided("noise", "V", found.unknown, limited.max)
    value, error = found.largest, found.error[found.worst] + found.difference
    outcome = at_most(value, error, limited.max)
    reason = f"channel {found.worst + 1} at rest, rms {found.band}"
    if found.difference > NOISE_AGREES * value:
        outcome = Outcome.INCONCLUSIVE
        reason = joined(reason, f"ngspice differs by {percent(found.difference / value)}")
    elif outcome is Outcome.PASS and found.unstated:
        outcome = Outcome.INCONCLUSIVE
        reason = joined(reason, UNSTATED.format(", ".join(found.unstated)))
    if found.unknown_corners:
        reason = joined(reason, NO_CORNER.format(", ".join(found.unknown_corners)))
    if found.noiseless:
        reason = joined(reason, NOISELESS.format(", ".join(found.noiseless)))
    return Check("noise", outcome, value, error, limited.max, None, "V", reason)


def headroom(evidence: Evidence) -> Check | None:
    """Fail if the steady state is beyond a part; above `FULL` of a limit nothing is known."""
    parts = evidence.parts
    if parts.unknown:
        return undecided("headroom", "ratio", parts.unknown, FULL)
    if not parts.loads and not parts.simulated:
        return None
    if parts.simulated:
        return _limited(parts)
    worst, outcome = parts.loads[0], Outcome.PASS
    share, reason = worst.share, describe(worst)
    if parts.impossible:  # value and reason are of the same load
        outcome, worst = Outcome.FAIL, parts.impossible[0]
        share = worst.rest / worst.limit
        reason = (
            f"at rest the output {worst.quantity} of op-amp {worst.part} would be"
            f" {amount(worst, worst.rest)}, the limit is {amount(worst, worst.limit)}{parts.remedy}"
        )
    elif worst.is_above:
        outcome = Outcome.INCONCLUSIVE
        reason += f", and above {FULL:.0%} of a limit the small-signal board is not true"
        reason += parts.remedy
    error = worst.error / worst.limit
    return Check("headroom", outcome, share, error, FULL, None, "ratio", reason)


def _limited(parts: PartLoads) -> Check:
    """Return the check of a board whose simulated op-amps have their limits.

    What these need says more than the load of another limit: the value is left out.
    """
    worst = parts.simulated[0]
    reason = f"{limited_text(worst)}; op-amp {worst.part} at {show(worst.at, 's', 3)}"
    reason += "; the simulated op-amps have slew rate and swing"
    if any(load.quantity == "current" for load in parts.simulated):
        reason += " and largest output current"
    if not (parts.loads and parts.loads[0].is_above):
        reason = "; ".join((reason, *map(describe, parts.loads[:1])))
        return Check("headroom", Outcome.PASS, None, None, FULL, None, "ratio", reason)
    other = parts.loads[0]
    share, error = other.share, other.error / other.limit
    reason = f"{describe(other)}; {reason}"  # the value is that of the other load
    return Check("headroom", Outcome.INCONCLUSIVE, share, error, FULL, None, "ratio", reason)


EXPLAINED = (
    3.0  # times the expected error of the steps: the steps do not explain a larger difference
)
NO_BOUND = "the error of this value has no bound"


def run_checks(evidence: Evidence) -> tuple[Check, ...]:
    """Run every check of `CHECKS` that the scene asks for.

    A value without a bound of its error passes nothing: no error is exactly 0.
    """
    judged = (kind.judge(evidence) for kind in CHECKS.values())
    checks = (_bounded(check) for check in judged if check is not None)
    return tuple(_witnessed(check, evidence.unwitnessed) for check in checks)


def could_be_finer(evidence: Evidence, checks: Iterable[Check]) -> bool:
    """Whether an error decides a check, or is near to a limit, and a better solution has less."""
    undecided = any(c.outcome is Outcome.INCONCLUSIVE and c.uncertainty for c in checks)
    limits = ((getattr(evidence.limits, name), name) for name in EXCURSIONS)
    near = any(c and c.max < WELL_ABOVE * evidence.error.readings[name] for c, name in limits)
    smaller = evidence.forever or (evidence.recording is not None and evidence.recording.is_stepped)
    return smaller and (undecided or near)


def _witnessed(check: Check, missing: str) -> Check:
    """Return a check as inconclusive if `missing` says that there is no state-space witness."""
    if not missing:
        return check
    return replace(check, outcome=Outcome.INCONCLUSIVE, reason=joined(missing, check.reason))


def _bounded(check: Check) -> Check:
    if check.outcome is not Outcome.PASS or check.uncertainty != 0.0:
        return check
    return replace(check, outcome=Outcome.INCONCLUSIVE, reason=joined(check.reason, NO_BOUND))


def _steady_state(evidence: Evidence) -> Check:
    limit = evidence.limits.steady_state.tolerance
    if evidence.growth:
        reason = joined(f"no steady state: the board {evidence.growth}", evidence.unsteady)
        return Check("steady_state", Outcome.FAIL, None, None, 0.0, limit, "step", reason)
    if evidence.obstacle:
        return undecided("steady_state", "step", evidence.obstacle, limit)
    value, error, boards = evidence.resting
    outcome, at_end = (
        at_most(value, error, limit),
        f"{percent(evidence.at_end)} at the record's end",
    )
    reason = joined("largest |equilibrium - reference|", boards, at_end)
    if evidence.unsteady and not evidence.steady.linear:
        outcome, reason = Outcome.FAIL, f"no steady state: {evidence.unsteady}"
    elif outcome is Outcome.PASS and (doubt := unconfirmed(evidence)):
        outcome, reason = Outcome.INCONCLUSIVE, joined(reason, doubt)
    return Check("steady_state", outcome, value, error, 0.0, limit, "step", reason)


def unconfirmed(evidence: Evidence) -> str:
    """Return why the end of the record does not confirm the equilibrium; empty if it does."""
    limit = evidence.limits.steady_state.tolerance
    if evidence.forever:
        return ""
    if obstacle := evidence.disagreement or evidence.too_short(limit):
        return obstacle
    allowed = evidence.left + min(evidence.wanted, limit) + evidence.static_error
    if evidence.steady.estimated:  # what is left may be more; a record within the limit confirms
        allowed = max(allowed, limit - evidence.static)
    if evidence.apart > allowed:
        apart, expected = percent(evidence.apart), percent(allowed)
        return f"the record ends {apart} from the equilibrium, modes and steps leave {expected}"
    return "" if evidence.steady.linear else evidence.perhaps_ringing


def _stability(evidence: Evidence) -> Check:
    pole, required = evidence.poles.rightmost, evidence.limits.stability.margin
    none = not len(evidence.poles.poles)
    text = "the board has no poles" if none else f"rightmost pole {show_pole(pole)}"
    margin = evidence.margin

    def check(outcome: Outcome, reason: str) -> Check:
        if margin is None and none:
            return Check("stability", outcome, None, None, 0.0, None, "1/s", reason)
        if margin is None:
            rounding = evidence.poles.resolution
            return Check("stability", outcome, pole.real, rounding, 0.0, None, "1/s", reason)
        error = margin.uncertainty or None
        return Check("stability", outcome, margin.factor, error, required, None, "ratio", reason)

    if not evidence.poles.certain:
        return check(Outcome.INCONCLUSIVE, f"{text}; {doubtful(evidence.poles)}")
    if evidence.growth:
        return check(Outcome.FAIL, f"{evidence.growth}; {text}")
    if contradiction := evidence.disagreement:
        return check(Outcome.INCONCLUSIVE, f"{contradiction} ({text})")
    if margin is None:
        return check(Outcome.PASS, text)
    if margin.doubt:
        return check(Outcome.INCONCLUSIVE, f"{text}; {margin.text}, but {margin.doubt}")
    outcome = at_most(-margin.factor, margin.uncertainty, -required)
    return check(outcome, f"{text}; {margin.text}")


def _engines_agree(evidence: Evidence) -> Check | None:
    agreement, m = evidence.agreement, evidence.measurements
    if agreement is None:
        return None
    limit, scale = agreement.limit, agreement.unit if evidence.no_step else m.amplitude
    if agreement.reason:
        reason = f"the state-space engine has no result: {agreement.reason}"
        return undecided("engines_agree", "step", reason, limit)
    value, steps = agreement.difference / scale, agreement.step_error / scale
    doubt = max(agreement.doubt / scale, EPS)  # two engines that stay at 0 V differ by nothing
    outcome = at_most(value, doubt, limit)
    reason = "largest difference to the state-space engine"
    if evidence.no_step:
        reason = "nothing moves by either engine: largest difference, in unit voltages U0"
    if outcome is Outcome.FAIL and value <= EXPLAINED * steps:
        outcome = Outcome.INCONCLUSIVE
        reason += f"; the time steps explain it (expected error {steps:.2g}): use smaller steps"
    elif outcome is Outcome.FAIL:
        reason += f"; channel {agreement.channel + 1} at {show(agreement.time, 's')}"
    accuracy = None if evidence.recording is None else evidence.recording.accuracy
    missed = accuracy is not None and accuracy.missed
    if outcome is Outcome.PASS and accuracy is not None and missed:
        outcome = Outcome.INCONCLUSIVE
        reason += (
            f"; the error of the record may be {percent(accuracy.achieved or 0.0)} of the step,"
        )
        reason += (
            f" {percent(accuracy.wanted)} allowed: allow a larger analysis.error, or more points"
        )
    return Check("engines_agree", outcome, value, doubt, limit, None, "step", reason)


def _same_problem(evidence: Evidence) -> Check | None:
    """Fail if the board and the record are of another problem than the reference; else no check."""
    reason = evidence.contradiction
    if not reason:
        return None
    return Check("same_problem", Outcome.FAIL, None, None, None, None, "step", reason)


OWN = {
    "steady_state": CheckKind(_steady_state, keys.SteadyStateCheck),
    "settling_time": CheckKind(settling_time, keys.SettlingTimeCheck),
    "rise_time": CheckKind(rise_time, keys.RiseTimeCheck),
    **{name: CheckKind(partial(excursion, name), keys.ExcursionCheck) for name in EXCURSIONS},
    "stability": CheckKind(_stability, keys.StabilityCheck),
    "headroom": CheckKind(headroom),
    "noise": CheckKind(noise, keys.NoiseCheck),
    "engines_agree": CheckKind(_engines_agree, keys.EnginesAgreeCheck),
    "same_problem": CheckKind(_same_problem),
}
CHECKS = OpenTable("taction.checks", OWN, CheckKind)
"""All kinds of checks, in the order of the verdict."""
