"""The table of checks, and the functions that judge.

The equations of the board decide, and the record has to confirm them. Where it ends too early for
that, the check is inconclusive. A new check is one function and one entry in `CHECKS`, or an entry
of another package.
"""

from __future__ import annotations

import math
from collections.abc import Callable
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
    SEVERITY,
    SPREAD,
    Check,
    CheckKind,
    Evidence,
    Outcome,
    at_most,
    doubtful,
    joined,
)
from taction.verification.verdict.headroom import FULL, describe

PASS, FAIL, UNDECIDED = Outcome.PASS, Outcome.FAIL, Outcome.INCONCLUSIVE
Make = Callable[..., Check]
"""A check with its name, unit and limit; takes the outcome, and the value with its error."""


def _unknown(evidence: Evidence, check: Make, what: str, outcome: Outcome = FAIL) -> Check | None:
    """Return the check of a board without this reading; None for a board that has it."""
    if evidence.growth:
        return check(outcome, reason=f"{what}the board {evidence.growth}")
    if evidence.obstacle:
        return check(UNDECIDED, reason=evidence.obstacle)
    return None


def steady_state(evidence: Evidence) -> Check:
    """Check how far the equilibrium is from the reference, and whether the record confirms it."""
    limit = evidence.limits.steady_state.tolerance
    check = partial(Check, "steady_state", expected=0.0, tolerance=limit, unit="step")
    if evidence.growth:
        reason = joined(f"no steady state: the board {evidence.growth}", evidence.unsteady)
        return check(FAIL, reason=reason)
    if evidence.obstacle:
        return check(UNDECIDED, expected=limit, tolerance=None, reason=evidence.obstacle)
    value, error, boards = evidence.resting
    outcome = at_most(value, error, limit)
    at_end = f"{percent(evidence.at_end)} at the record's end"
    reason = joined("largest |equilibrium - reference|", boards, at_end)
    if evidence.unsteady and not evidence.steady.linear:
        return check(FAIL, reason=f"no steady state: {evidence.unsteady}")
    if outcome is PASS and (doubt := unconfirmed(evidence)):
        outcome, reason = UNDECIDED, joined(reason, doubt)
    return check(outcome, value, error, reason=reason)


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


def settling_time(evidence: Evidence) -> Check:
    """Check when the last channel enters its band."""
    limits, reading = evidence.limits.settling_time, evidence.measurements.settling_time
    check = partial(Check, "settling_time", expected=limits.max, unit="s", band=limits.band)
    if unknown := _unknown(evidence, check, "it never settles: "):
        return unknown
    static, error, boards = evidence.resting
    band = f"±{100 * limits.band:g} % of the step amplitude"
    if static - error > limits.band:
        off = f"up to {percent(static)} off the reference in {SPREAD}"
        off = off if boards else f"{percent(static)} off the reference"
        return check(FAIL, reason=joined(f"the equilibrium is {off}, outside {band}", boards))
    if reading is None:
        return _unsettled(evidence, check)
    if short := evidence.too_short(limits.band - evidence.static):
        return check(UNDECIDED, reason=short)
    return _timed(check, "settling_time", limits, reading, f"to {band}")


def _unsettled(evidence: Evidence, check: Make) -> Check:
    """Judge a board that comes to rest inside the band, and whose record does not show when."""
    limits, reason = evidence.limits.settling_time, evidence.measurements.reason
    if evidence.unsteady and not evidence.steady.linear:
        return check(FAIL, reason=reason)
    outside = evidence.at_end - evidence.end_error - evidence.reference_error > limits.band
    if outside and limits.max is not None and evidence.end > limits.max:
        late = f"outside ±{100 * limits.band:g} % after {show(limits.max, 's')}, the limit"
        off = f"{percent(evidence.at_end)} off the reference at {show(evidence.end, 's')}"
        return check(FAIL, reason=f"{late}: {off}")
    short = evidence.too_short(0.5 * (limits.band - evidence.static))
    return check(UNDECIDED, reason=joined(reason, short))


def _timed(
    check: Make,
    name: str,
    limits: keys.SettlingTimeCheck | keys.RiseTimeCheck,
    reading: Reading,
    text: str,
) -> Check:
    """Judge a time by its limits; a fragile one must keep them with both of its values."""
    value, error, other = reading.value, reading.uncertainty, reading.alternative
    if not math.isfinite(error):
        return check(UNDECIDED, value, reason=f"{text}; no second solution confirms this time")
    outcome, reason = PASS, text
    if limits.max is not None:
        outcome = at_most(value, error, limits.max)
        reason += "; the limit is within the uncertainty" * (outcome is UNDECIDED)
    if reading.fragile and other is not None:
        reason += f"; fragile: {show(other, 's')} with {READINGS[name].shifted}"
        if limits.max is not None and at_most(other, error, limits.max) is not outcome:
            outcome = UNDECIDED
    if outcome is PASS and limits.min is not None:
        found = {at_most(-each, error, -limits.min) for each in (value, other or value)}
        outcome = UNDECIDED if len(found) > 1 else found.pop()
        reason = f"{text}; at least {show(limits.min, 's')}"
    return check(outcome, value, error, reason=reason)


def rise_time(evidence: Evidence) -> Check | None:
    """Check the rise time of every channel that rises, or of one; the worst is reported."""
    limits = evidence.limits.rise_time
    if limits is None:
        return None
    channels, number = evidence.measurements.channels, limits.channel
    check = partial(Check, "rise_time", expected=limits.max, unit="s")
    if unknown := _unknown(evidence, check, "", UNDECIDED):
        return unknown
    if number is not None and number > len(channels):
        reason = f"the scene has no channel {number}; it has {len(channels)} channels"
        return check(UNDECIDED, reason=reason)

    def judged(channel: ChannelMeasure, which: str) -> Check:
        name = f"channel {channel.index + 1}"
        if channel.rise_time is None:
            short = evidence.too_short(evidence.limits.steady_state.tolerance)
            return check(UNDECIDED, reason=joined(f"{name}: {channel.rise_reason}", short))
        return _timed(check, "rise_time", limits, channel.rise_time, f"10-90 % of {name}{which}")

    if number is not None:
        return judged(channels[number - 1], "")
    chosen = [channel for channel in channels if channel.rises] or channels
    order = sorted(chosen, key=lambda c: c.rise_time.value if c.rise_time else math.inf)
    which = [", the fastest", *[""] * len(order[2:]), ", the slowest"] if order[1:] else [""]
    every = [judged(*each) for each in zip(order, which, strict=True)]
    outcome = max((check.outcome for check in every), key=SEVERITY.index)
    found = [check for check in every if check.outcome is outcome]
    too_fast = outcome is FAIL and (found[-1].value or 0.0) < (limits.min or 0.0)
    return found[0 if too_fast else -1]


def excursion(name: str, evidence: Evidence) -> Check | None:
    """Check an excursion, by `name`."""
    if (limits := getattr(evidence.limits, name)) is None:
        return None
    check = partial(Check, name, expected=limits.max, unit="step")
    if unknown := _unknown(evidence, check, "no limit: "):
        return unknown
    reading = evidence.measurements.readings[name]
    value, error = (0.0, 0.0) if reading is None else (reading.value, reading.uncertainty)
    outcome, reason = at_most(value, error, limits.max), f"largest {name} of any channel"
    if evidence.unsteady and not evidence.steady.linear:
        largest = (value, error) if outcome is FAIL else (None, None)
        return check(FAIL, *largest, reason=evidence.unsteady)
    if outcome is PASS and (doubt := _later(evidence, value, limits.max)):
        outcome, reason = UNDECIDED, doubt
    return check(outcome, value, error, reason=reason)


def _later(evidence: Evidence, value: float, limit: float) -> str:
    """Return why an excursion after the record may exceed `limit`; empty if none can.

    After the record an output is at most so far from its target as its equilibrium and what the
    modes leave; and at most so far beyond the excursion `value` as it still moves.
    """
    if obstacle := evidence.disagreement:
        return obstacle
    room = max(limit - evidence.static, limit - value - evidence.apart)
    return evidence.too_short(room) or ("" if evidence.steady.linear else evidence.perhaps_ringing)


def stability(evidence: Evidence) -> Check:
    """Check the rightmost pole, and the margin where the scene asks for one."""
    poles, margin, required = evidence.poles, evidence.margin, evidence.limits.stability.margin
    pole, none = poles.rightmost, not len(poles.poles)
    text = "the board has no poles" if none else f"rightmost pole {show_pole(pole)}"
    check: Make = partial(Check, "stability", expected=0.0, unit="1/s")
    value, error = (None, None) if none else (pole.real, poles.resolution)
    if margin is not None:
        check = partial(Check, "stability", expected=required, unit="ratio")
        value, error = margin.factor, margin.uncertainty or (None if margin.factor else 0.0)
    outcome, reason = PASS, text
    if poles.stable is None:
        outcome, reason = UNDECIDED, f"{text}; {doubtful(poles)}"
    elif evidence.growth:
        outcome, reason = FAIL, f"{evidence.growth}; {text}"
    elif contradiction := evidence.disagreement:
        outcome, reason = UNDECIDED, f"{contradiction} ({text})"
    elif margin is not None and margin.doubt:
        outcome, reason = UNDECIDED, f"{text}; {margin.text}, but {margin.doubt}"
    elif margin is not None:
        outcome = at_most(-margin.factor, margin.uncertainty, -required)
        reason = f"{text}; {margin.text}"
    return check(outcome, value, error, reason=reason)


REMEDY = "; a smaller unit_voltage lowers it"
LIMITS = {"slope": "slew rate counts", "voltage": "clips", "current": "limits its current"}
"""What the limit of a simulated op-amp does."""


def headroom(evidence: Evidence) -> Check | None:
    """Fail if the steady state is beyond a part; above `FULL` of a limit nothing is known."""
    parts, check = evidence.parts, partial(Check, "headroom", expected=FULL, unit="ratio")
    if parts.unknown:
        return check(UNDECIDED, reason=parts.unknown)
    if not parts.loads and not parts.simulated:
        return None
    outcome, value, error, reason = PASS, None, None, ""
    if parts.loads:
        worst = parts.loads[0]
        outcome, reason = UNDECIDED if worst.is_above else PASS, describe(worst)
        if worst.is_above or not parts.simulated:
            value, error = worst.share, worst.error / worst.limit
    if parts.simulated:
        first = parts.simulated[0]
        peak, limit = (show(value, first.unit, 3) for value in (first.peak, first.limit))
        limited = f"{LIMITS[first.quantity]}, as simulated: would need {peak} of {limit}; op-amp"
        limited += f" {first.part} at {show(first.at, 's', 3)}; op-amps have slew rate and swing"
        if any(load.quantity == "current" for load in parts.simulated):
            limited += " and largest output current"
        reason = joined(*((limited, reason) if outcome is PASS else (reason, limited)))
    elif parts.impossible:  # value and reason are of the same load
        worst = parts.impossible[0]
        outcome, value, error = FAIL, worst.rest / worst.limit, worst.error / worst.limit
        rest, limit = (show(value, worst.unit, 3) for value in (worst.rest, worst.limit))
        reason = f"at rest the output {worst.quantity} of op-amp {worst.part} would be {rest}"
        reason += f", the limit is {limit}{REMEDY}"
    elif outcome is UNDECIDED:
        reason += f", and above {FULL:.0%} of a limit the small-signal board is not true{REMEDY}"
    return check(outcome, value, error, reason=reason)


NOISE_AGREES = 0.01  # of the noise: the largest difference of the two engines


def noise(evidence: Evidence) -> Check | None:
    """Compare the largest noise of any channel with the limit of the scene, if there is one."""
    found, limited = evidence.noise, evidence.limits.noise
    if found is None or limited is None:
        return None
    check = partial(Check, "noise", expected=limited.max, unit="V")
    if found.unknown:
        return check(UNDECIDED, reason=found.unknown)
    value, error = found.largest, found.error[found.worst] + found.difference
    outcome = at_most(value, error, limited.max)
    reason = f"channel {found.worst + 1} at rest, rms {found.band}"
    if found.difference > NOISE_AGREES * value:
        outcome = UNDECIDED
        reason = joined(reason, f"ngspice differs by {percent(found.difference / value)}")
    elif outcome is PASS and found.lacking:
        outcome, reason = UNDECIDED, joined(reason, found.lacking)
    return check(outcome, value, error, reason=joined(reason, *found.notes))


EXPLAINED = 3.0  # times the expected error of the steps: they explain no larger difference


def engines_agree(evidence: Evidence) -> Check | None:
    """Compare the outputs of ngspice with those of the state-space engine."""
    agreement, run = evidence.agreement, evidence.run
    if agreement is None:
        return None
    limit = agreement.limit
    scale = agreement.unit if evidence.no_step else evidence.measurements.amplitude
    check = partial(Check, "engines_agree", expected=limit, unit="step")
    if agreement.reason:
        reason = f"the state-space engine has no result: {agreement.reason}"
        return check(UNDECIDED, reason=reason)
    value, steps = agreement.difference / scale, agreement.step_error / scale
    doubt = max(agreement.doubt / scale, EPS)  # two engines that stay at 0 V differ by nothing
    outcome = at_most(value, doubt, limit)
    reason = "largest difference to the state-space engine"
    if evidence.no_step:
        reason = "nothing moves by either engine: largest difference, in unit voltages U0"
    if outcome is FAIL and value <= EXPLAINED * steps:
        outcome = UNDECIDED
        reason += f"; the time steps explain it (expected error {steps:.2g}): use smaller steps"
    elif outcome is FAIL:
        time, channel = agreement.largest
        reason += f"; channel {channel + 1} at {show(time, 's')}"
    elif outcome is PASS and run is not None and run.accuracy.missed:
        outcome, accuracy = UNDECIDED, run.accuracy
        reason += (
            f"; the error of the record may be {percent(accuracy.achieved or 0.0)} of the step,"
            f" {percent(accuracy.wanted)} allowed: allow a larger analysis.error, or more points"
        )
    return check(outcome, value, doubt, reason=reason)


def same_problem(evidence: Evidence) -> Check | None:
    """Fail if the board and the record are of another problem than the reference; else no check."""
    reason = evidence.contradiction
    return Check("same_problem", FAIL, unit="step", reason=reason) if reason else None


NO_BOUND = "the error of this value has no bound"


def run_checks(evidence: Evidence) -> tuple[Check, ...]:
    """Run every check of `CHECKS` that the scene asks for.

    A value without a bound of its error passes nothing: no error is exactly 0. Without one of the
    two witnesses nothing is decided.
    """
    checks = []
    for kind in CHECKS.values():
        if (check := kind.judge(evidence)) is not None:
            unbounded = check.outcome is PASS and check.uncertainty == 0.0
            reason = joined(check.reason, NO_BOUND if unbounded else "")
            if unbounded or evidence.unwitnessed:
                reason = joined(evidence.unwitnessed, reason)
                check = replace(check, outcome=UNDECIDED, reason=reason)
            checks.append(check)
    return tuple(checks)


OWN = {
    "steady_state": CheckKind(steady_state, keys.SteadyStateCheck),
    "settling_time": CheckKind(settling_time, keys.SettlingTimeCheck),
    "rise_time": CheckKind(rise_time, keys.RiseTimeCheck),
    **{name: CheckKind(partial(excursion, name), keys.ExcursionCheck) for name in EXCURSIONS},
    "stability": CheckKind(stability, keys.StabilityCheck),
    "headroom": CheckKind(headroom),
    "noise": CheckKind(noise, keys.NoiseCheck),
    "engines_agree": CheckKind(engines_agree, keys.EnginesAgreeCheck),
    "same_problem": CheckKind(same_problem),
}
CHECKS = OpenTable("taction.checks", OWN, CheckKind)
"""All kinds of checks, in the order of the verdict."""
