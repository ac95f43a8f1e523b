"""Checks and their outcomes: each with its value, its uncertainty, its limit and a reason.

An undecided check is never a pass. A new check needs one function and one entry in `CHECKS`.
"""

from __future__ import annotations

import enum
import math
from collections.abc import Callable, Iterable
from dataclasses import dataclass, replace
from functools import partial

from netlist_gen.quantities import show
from netlist_gen.scene.scene import Checks
from spice_models.definitions import SHIFTED
from verification.measures.measurements import ChannelMeasure, Measurements
from verification.measures.readings import Reading
from verification.measures.settling import ChannelState
from verification.pipeline.agreement import Agreement
from verification.pipeline.step_error import StepError
from verification.small_signal.margin import Margin
from verification.small_signal.poles import Poles


class Outcome(enum.Enum):
    """The outcome of a check, or of a whole verification."""

    PASS = "pass"  # noqa: S105
    FAIL = "fail"
    INCONCLUSIVE = "inconclusive"


@dataclass(frozen=True, slots=True)
class Check:
    """One check.

    Attributes
    ----------
    value, uncertainty : float or None
        The measured value and the bound on its error, in `unit`.
    expected, tolerance : float or None
        The expected value and the accepted deviation, or the limit in `expected` alone.
    unit : str
        ``"s"``, ``"1/s"``, ``"step"`` (a fraction of the step amplitude) or ``"ratio"``.
    """

    name: str
    outcome: Outcome
    value: float | None
    uncertainty: float | None
    expected: float | None
    tolerance: float | None
    unit: str
    reason: str


@dataclass(frozen=True, slots=True)
class Evidence:
    """The input of the checks.

    `agreement` is None if only one engine ran, or if the board is unstable; `margin` is None if
    the scene asks for no stability margin; `reference_error` is a fraction of the step amplitude;
    `reference_problem` says why the reference solution cannot be used, or is empty;
    `contradiction` says which number of the board or the record differs from the reference's.
    """

    checks: Checks
    measurements: Measurements
    error: StepError
    agreement: Agreement | None
    poles: Poles
    margin: Margin | None
    reference_error: float
    reference_problem: str
    contradiction: str = ""


EXPLAINED = (
    3.0  # times the expected error of the steps: the steps do not explain a larger difference
)
NO_STEP = "nothing to check: with this strain and initial state no output has to move"
ROUNDING = "nothing to check: the step amplitude is below the error of the reference solution"
UNSTEADY = (ChannelState.OSCILLATING, ChannelState.CLIPPED, ChannelState.DIVERGED)


def run_checks(evidence: Evidence) -> tuple[Check, ...]:
    """Run every check of `CHECKS` that the scene asks for."""
    return tuple(check for make in CHECKS if (check := make(evidence)) is not None)


def overall(checks: Iterable[Check]) -> Outcome:
    """Fail if any check failed, else inconclusive if any is undecided, else pass."""
    outcomes = {check.outcome for check in checks}
    for worst in (Outcome.FAIL, Outcome.INCONCLUSIVE):
        if worst in outcomes:
            return worst
    return Outcome.PASS if outcomes else Outcome.INCONCLUSIVE


def at_most(value: float, uncertainty: float, limit: float) -> Outcome:
    """Compare with an upper limit; a difference within the uncertainty is inconclusive."""
    if not math.isfinite(value):
        return Outcome.INCONCLUSIVE
    if value + uncertainty <= limit:
        return Outcome.PASS
    return Outcome.FAIL if value - uncertainty > limit else Outcome.INCONCLUSIVE


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
            text += f", growth rate {first.growth_rate:+.4g} /s"
        parts.append(text)
    return "; ".join(parts)


def _nothing_moves(evidence: Evidence) -> str:
    """Return the reason why there is no step to check, or an empty text."""
    rounding = ROUNDING if evidence.reference_error >= 1.0 else ""
    return rounding if evidence.measurements.amplitude else NO_STEP


def _perhaps_ringing(measurements: Measurements) -> str:
    """Return both readings of an undecided channel, if all other channels have settled."""
    states = {channel.state: channel for channel in measurements.channels}
    if not states.keys() <= {ChannelState.SETTLED, ChannelState.UNDECIDED}:
        return ""
    unclear = states.get(ChannelState.UNDECIDED)
    return f"channel {unclear.index + 1}: {unclear.reason}" if unclear else ""


def _steady_state(evidence: Evidence) -> Check:
    limit = evidence.checks.steady_state.tolerance
    m = evidence.measurements
    value = max(abs(c.final - c.target) for c in m.channels) / m.amplitude if m.amplitude else 0.0
    uncertainty = evidence.error.steady_state + evidence.reference_error
    outcome, reason = at_most(value, uncertainty, limit), "largest |final - reference|"
    states = describe_states(m)
    if evidence.reference_problem:
        outcome, reason = Outcome.INCONCLUSIVE, evidence.reference_problem
    elif no_step := _nothing_moves(evidence):
        return _undecided("steady_state", "step", no_step, limit)
    elif any(c.state in UNSTEADY for c in m.channels):
        outcome, reason = Outcome.FAIL, f"no steady state: {states}"
    elif ringing := _perhaps_ringing(m):
        outcome, reason = Outcome.INCONCLUSIVE, ringing
    elif states:
        reason += f"; {states}"
    return Check("steady_state", outcome, value, uncertainty, 0.0, limit, "step", reason)


def _settling_time(evidence: Evidence) -> Check:
    limits = evidence.checks.settling_time
    reading = evidence.measurements.settling_time
    band = f"to ±{100 * limits.band:g} % of the step amplitude"
    obstacle = evidence.reference_problem or _nothing_moves(evidence)
    if obstacle := obstacle or _perhaps_ringing(evidence.measurements):
        return _undecided("settling_time", "s", obstacle, limits.max)
    if reading is None:
        reason = evidence.measurements.reason
        return Check("settling_time", Outcome.FAIL, None, None, limits.max, None, "s", reason)
    check = _timed("settling_time", reading, evidence.error.settling_time, limits.max, band)
    return _not_below(limits.min, check, reading, band)


def _rise_time(evidence: Evidence) -> Check | None:
    limits = evidence.checks.rise_time
    if limits is None:
        return None
    if evidence.reference_problem:
        return _undecided("rise_time", "s", evidence.reference_problem, limits.max)
    channels = evidence.measurements.channels
    number = limits.channel or (len(channels) + 1) // 2
    if number > len(channels):
        reason = f"the scene has no channel {number}; it has {len(channels)} channels"
        return _undecided("rise_time", "s", reason, limits.max)
    channel = channels[number - 1]
    if channel.rise_time is None:
        return _undecided("rise_time", "s", f"channel {number}: {channel.rise_reason}", limits.max)
    text = f"10-90 % of channel {number}"
    check = _timed("rise_time", channel.rise_time, evidence.error.rise_time, limits.max, text)
    return _not_below(limits.min, check, channel.rise_time, text)


def _excursion(name: str, evidence: Evidence) -> Check | None:
    """Check the overshoot or the undershoot, by `name`."""
    limits = getattr(evidence.checks, name)
    if limits is None:
        return None
    if evidence.reference_problem:
        return _undecided(name, "step", evidence.reference_problem, limits.max)
    value = max(getattr(channel, name) for channel in evidence.measurements.channels)
    error = getattr(evidence.error, name)
    outcome = at_most(value, error, limits.max)
    reason = f"largest {name} of any channel"
    if any(channel.state in UNSTEADY for channel in evidence.measurements.channels):
        outcome, reason = Outcome.FAIL, describe_states(evidence.measurements)
    elif outcome is Outcome.PASS and (ringing := _perhaps_ringing(evidence.measurements)):
        outcome, reason = Outcome.INCONCLUSIVE, ringing
    return Check(name, outcome, value, error, limits.max, None, "step", reason)


def _stability(evidence: Evidence) -> Check:
    pole, required = evidence.poles.rightmost, evidence.checks.stability.margin
    text = f"rightmost pole {pole.real:+.4g} {pole.imag:+.4g}j /s"
    margin = evidence.margin

    def check(outcome: Outcome, reason: str) -> Check:
        if margin is None:
            return Check("stability", outcome, pole.real, None, 0.0, None, "1/s", reason)
        error = margin.uncertainty or None
        return Check("stability", outcome, margin.factor, error, required, None, "ratio", reason)

    if abs(pole.real) <= (rounding := evidence.poles.resolution):
        text += f", known to ±{rounding:.1g} /s: the board may be stable or unstable"
        return check(Outcome.INCONCLUSIVE, text)
    if not evidence.poles.stable:
        ringing = show(abs(pole.imag) / (2 * math.pi), "Hz")
        verb = f"oscillates at {ringing}" if pole.imag else "runs away"
        return check(Outcome.FAIL, f"{verb}, growth rate {pole.real:+.4g} /s: {text}")
    if any(channel.state in UNSTEADY for channel in evidence.measurements.channels):
        states = describe_states(evidence.measurements)
        reason = f"the poles are stable ({text}), the transient is not: {states}"
        return check(Outcome.INCONCLUSIVE, reason)
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
    limit, amplitude = evidence.checks.engines_agree.limit, m.amplitude or 1.0
    if agreement.reason:
        reason = f"the state-space engine has no result: {agreement.reason}"
        return _undecided("engines_agree", "step", reason, limit)
    value, steps = agreement.difference / amplitude, agreement.step_error / amplitude
    outcome = at_most(value, 0.0, limit)
    reason = "largest difference to the state-space engine"
    if outcome is Outcome.FAIL and value <= EXPLAINED * steps:
        outcome = Outcome.INCONCLUSIVE
        reason += f"; the time steps explain it (expected error {steps:.2g}): use smaller steps"
    elif outcome is Outcome.FAIL:
        reason += f"; channel {agreement.channel + 1} at {show(agreement.time, 's')}"
    return Check("engines_agree", outcome, value, None, limit, None, "step", reason)


def _same_problem(evidence: Evidence) -> Check | None:
    """Fail if the board and the record are of another problem than the reference; else no check."""
    reason = evidence.contradiction
    if not reason:
        return None
    return Check("same_problem", Outcome.FAIL, None, None, None, None, "step", reason)


def _timed(name: str, reading: Reading, error: float, limit: float | None, text: str) -> Check:
    uncertainty = reading.uncertainty + error
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


def _undecided(name: str, unit: str, reason: str, limit: float | None) -> Check:
    return Check(name, Outcome.INCONCLUSIVE, None, None, limit, None, unit, reason)


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
