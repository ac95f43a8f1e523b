"""The checks of a verification: what is known by the equations decides, a record confirms.

The poles tell whether a board is unstable, and the equilibrium where it comes to rest. Neither
depends on what a record happens to show. A record that ends before a check can be decided leaves it
inconclusive. A new check needs one function and one entry in `CHECKS`.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import replace
from functools import partial

from netlist_gen.quantities import show
from spice_models.definitions import SHIFTED
from verification.measures.readings import Reading
from verification.pipeline.checks import MAYBE, Check, Evidence, Outcome, at_most

EXPLAINED = (
    3.0  # times the expected error of the steps: the steps do not explain a larger difference
)


def run_checks(evidence: Evidence) -> tuple[Check, ...]:
    """Run every check of `CHECKS` that the scene asks for."""
    return tuple(check for make in CHECKS if (check := make(evidence)) is not None)


def _steady_state(evidence: Evidence) -> Check:
    limit = evidence.checks.steady_state.tolerance
    if evidence.growth:
        reason = _joined(f"no steady state: the board {evidence.growth}", evidence.unsteady)
        return Check("steady_state", Outcome.FAIL, None, None, 0.0, limit, "step", reason)
    if evidence.obstacle:
        return _undecided("steady_state", "step", evidence.obstacle, limit)
    value, error = evidence.static, evidence.static_error
    outcome = at_most(value, error, limit)
    reason = f"largest |equilibrium - reference|; {_share(evidence.at_end)} at the record's end"
    if evidence.unsteady and not evidence.steady.linear:
        outcome, reason = Outcome.FAIL, f"no steady state: {evidence.unsteady}"
    elif outcome is Outcome.PASS and (doubt := _unconfirmed(evidence)):
        outcome, reason = Outcome.INCONCLUSIVE, _joined(reason, doubt)
    return Check("steady_state", outcome, value, error, 0.0, limit, "step", reason)


def _unconfirmed(evidence: Evidence) -> str:
    """Return why the end of the record does not confirm the equilibrium; empty if it does."""
    limit = evidence.checks.steady_state.tolerance
    if evidence.forever:
        return ""
    if obstacle := _contradiction(evidence) or evidence.too_short(limit):
        return obstacle
    allowed = evidence.left + min(evidence.wanted, limit) + evidence.static_error
    if evidence.steady.estimated:  # what is left may be more; a record within the limit confirms
        allowed = max(allowed, limit - evidence.static)
    if evidence.apart > allowed:
        apart, expected = _share(evidence.apart), _share(allowed)
        return f"the record ends {apart} from the equilibrium, modes and steps leave {expected}"
    return "" if evidence.steady.linear else evidence.perhaps_ringing


def _contradiction(evidence: Evidence) -> str:
    """Return how the transient contradicts stable poles, or an empty text."""
    states = evidence.unsteady
    return f"the poles are stable, the transient is not: {states}" if states else ""


def _settling_time(evidence: Evidence) -> Check:
    limits = evidence.checks.settling_time
    reading, maximum = evidence.measurements.settling_time, limits.max
    if evidence.growth:
        return _failed("settling_time", f"it never settles: the board {evidence.growth}", maximum)
    if evidence.obstacle:
        return _undecided("settling_time", "s", evidence.obstacle, maximum)
    band, static = f"±{100 * limits.band:g} % of the step amplitude", _share(evidence.static)
    if evidence.static - evidence.static_error > limits.band:
        reason = f"the equilibrium is {static} off the reference, outside {band}"
        return _failed("settling_time", reason, maximum)
    if reading is None:
        return _unsettled(evidence)
    if short := evidence.too_short(limits.band - evidence.static):
        return _undecided("settling_time", "s", short, maximum)
    check = _timed("settling_time", reading, maximum, f"to {band}")
    return _not_below(limits.min, check, reading, f"to {band}")


def _unsettled(evidence: Evidence) -> Check:
    """Judge a board that comes to rest inside the band, and whose record does not show when."""
    limits, reason = evidence.checks.settling_time, evidence.measurements.reason
    if evidence.unsteady and not evidence.steady.linear:
        return _failed("settling_time", reason, limits.max)
    outside = evidence.at_end - evidence.error.steady_state - evidence.reference_error > limits.band
    if outside and limits.max is not None and evidence.end > limits.max:
        reason = f"{_share(evidence.at_end)} off the reference at {show(evidence.end, 's')}"
        return _failed("settling_time", f"outside the band after the limit: {reason}", limits.max)
    short = evidence.too_short(0.5 * (limits.band - evidence.static))
    return _undecided("settling_time", "s", _joined(reason, short), limits.max)


def _rise_time(evidence: Evidence) -> Check | None:
    limits = evidence.checks.rise_time
    if limits is None:
        return None
    channels = evidence.measurements.channels
    number = limits.channel or (len(channels) + 1) // 2
    obstacle = evidence.growth and f"the board {evidence.growth}"
    if obstacle := obstacle or evidence.obstacle:
        return _undecided("rise_time", "s", obstacle, limits.max)
    if number > len(channels):
        reason = f"the scene has no channel {number}; it has {len(channels)} channels"
        return _undecided("rise_time", "s", reason, limits.max)
    channel = channels[number - 1]
    if channel.rise_time is None:
        short = evidence.too_short(evidence.checks.steady_state.tolerance)
        reason = _joined(f"channel {number}: {channel.rise_reason}", short)
        return _undecided("rise_time", "s", reason, limits.max)
    text = f"10-90 % of channel {number}"
    check = _timed("rise_time", channel.rise_time, limits.max, text)
    return _not_below(limits.min, check, channel.rise_time, text)


def _excursion(name: str, evidence: Evidence) -> Check | None:
    """Check the overshoot or the undershoot, by `name`."""
    limits = getattr(evidence.checks, name)
    if limits is None:
        return None
    if evidence.growth:
        reason = f"no limit: the board {evidence.growth}"
        return Check(name, Outcome.FAIL, None, None, limits.max, None, "step", reason)
    if evidence.obstacle:
        return _undecided(name, "step", evidence.obstacle, limits.max)
    value = max(getattr(channel, name) for channel in evidence.measurements.channels)
    error = getattr(evidence.error, name)
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
    if obstacle := _contradiction(evidence):
        return obstacle
    room = max(limit - evidence.static, limit - value - evidence.apart)
    return evidence.too_short(room) or ("" if evidence.steady.linear else evidence.perhaps_ringing)


def _stability(evidence: Evidence) -> Check:
    pole, required = evidence.poles.rightmost, evidence.checks.stability.margin
    text = f"rightmost pole {pole.real:+.4g} {pole.imag:+.4g}j /s"
    margin = evidence.margin

    def check(outcome: Outcome, reason: str) -> Check:
        if margin is None:
            rounding = evidence.poles.resolution
            return Check("stability", outcome, pole.real, rounding, 0.0, None, "1/s", reason)
        error = margin.uncertainty or None
        return Check("stability", outcome, margin.factor, error, required, None, "ratio", reason)

    if not evidence.poles.certain:
        doubt = MAYBE.format(evidence.poles.resolution)
        return check(Outcome.INCONCLUSIVE, f"{text}; {doubt}")
    if evidence.growth:
        return check(Outcome.FAIL, f"{evidence.growth}: {text}")
    if contradiction := _contradiction(evidence):
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
    limit, amplitude = agreement.limit, m.amplitude or 1.0
    if evidence.no_step:
        return _undecided("engines_agree", "step", evidence.no_step, limit)
    if agreement.reason:
        reason = f"the state-space engine has no result: {agreement.reason}"
        return _undecided("engines_agree", "step", reason, limit)
    value, steps = agreement.difference / amplitude, agreement.step_error / amplitude
    doubt = agreement.doubt / amplitude
    outcome = at_most(value, doubt, limit)
    reason = "largest difference to the state-space engine"
    if outcome is Outcome.FAIL and value <= EXPLAINED * steps:
        outcome = Outcome.INCONCLUSIVE
        reason += f"; the time steps explain it (expected error {steps:.2g}): use smaller steps"
    elif outcome is Outcome.FAIL:
        reason += f"; channel {agreement.channel + 1} at {show(agreement.time, 's')}"
    return Check("engines_agree", outcome, value, doubt, limit, None, "step", reason)


def _same_problem(evidence: Evidence) -> Check | None:
    """Fail if the board and the record are of another problem than the reference; else no check."""
    reason = evidence.contradiction
    if not reason:
        return None
    return Check("same_problem", Outcome.FAIL, None, None, None, None, "step", reason)


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
        reason += f"; fragile: {other} with {SHIFTED[name.removesuffix('_time')]}"
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


def _failed(name: str, reason: str, limit: float | None) -> Check:
    return Check(name, Outcome.FAIL, None, None, limit, None, "s", reason)


def _undecided(name: str, unit: str, reason: str, limit: float | None) -> Check:
    return Check(name, Outcome.INCONCLUSIVE, None, None, limit, None, unit, reason)


def _joined(*texts: str) -> str:
    return "; ".join(filter(None, texts))


def _share(share: float) -> str:
    return f"{100 * share:.3g} %"


CHECKS: tuple[Callable[[Evidence], Check | None], ...] = (
    _steady_state,
    _settling_time,
    _rise_time,
    partial(_excursion, "overshoot"),
    partial(_excursion, "undershoot"),
    _stability,
    _engines_agree,
    _same_problem,
)
