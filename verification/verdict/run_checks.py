"""The table of checks, and the functions that judge.

The equations of the board decide: its poles say whether it is unstable, and its equilibrium where
it comes to rest. The record has to confirm both. Where it ends too early for that, the check is
inconclusive. A new check is one function and one entry in `CHECKS`, or an entry of another package.
"""

from __future__ import annotations

from dataclasses import replace
from functools import partial

import numpy as np

from taction.netlist_gen.scene import checks as keys
from taction.system.plugins import OpenTable
from taction.system.quantities import show, show_pole
from taction.system.reading_definitions import EXCURSIONS
from taction.verification.verdict.checks import (
    Check,
    CheckKind,
    Evidence,
    Outcome,
    at_most,
    doubtful,
    joined,
    percent,
    undecided,
)
from taction.verification.verdict.headroom_check import headroom
from taction.verification.verdict.noise_check import noise
from taction.verification.verdict.reading_checks import excursion, rise_time, settling_time

EXPLAINED = (
    3.0  # times the expected error of the steps: the steps do not explain a larger difference
)
EPS = float(np.finfo(np.float64).eps)
NO_BOUND = "the error of this value has no bound"


def run_checks(evidence: Evidence) -> tuple[Check, ...]:
    """Run every check of `CHECKS` that the scene asks for.

    A value without a bound of its error passes nothing: no error is exactly 0.
    """
    judged = (kind.judge(evidence) for kind in CHECKS.values())
    checks = (_bounded(check) for check in judged if check is not None)
    return tuple(_witnessed(check, evidence.unwitnessed) for check in checks)


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
    limit = evidence.checks.steady_state.tolerance
    if evidence.growth:
        reason = joined(f"no steady state: the board {evidence.growth}", evidence.unsteady)
        return Check("steady_state", Outcome.FAIL, None, None, 0.0, limit, "step", reason)
    if evidence.obstacle:
        return undecided("steady_state", "step", evidence.obstacle, limit)
    value, error = evidence.static, evidence.static_error
    outcome = at_most(value, error, limit)
    reason = f"largest |equilibrium - reference|; {percent(evidence.at_end)} at the record's end"
    if evidence.unsteady and not evidence.steady.linear:
        outcome, reason = Outcome.FAIL, f"no steady state: {evidence.unsteady}"
    elif outcome is Outcome.PASS and (doubt := _unconfirmed(evidence)):
        outcome, reason = Outcome.INCONCLUSIVE, joined(reason, doubt)
    return Check("steady_state", outcome, value, error, 0.0, limit, "step", reason)


def _unconfirmed(evidence: Evidence) -> str:
    """Return why the end of the record does not confirm the equilibrium; empty if it does."""
    limit = evidence.checks.steady_state.tolerance
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
    pole, required = evidence.poles.rightmost, evidence.checks.stability.margin
    text = f"rightmost pole {show_pole(pole)}"
    margin = evidence.margin

    def check(outcome: Outcome, reason: str) -> Check:
        if margin is None:
            rounding = evidence.poles.resolution
            return Check("stability", outcome, pole.real, rounding, 0.0, None, "1/s", reason)
        error = margin.uncertainty or None
        return Check("stability", outcome, margin.factor, error, required, None, "ratio", reason)

    if not evidence.poles.certain:
        doubt = doubtful(evidence.poles.resolution)
        return check(Outcome.INCONCLUSIVE, f"{text}; {doubt}")
    if evidence.growth:
        return check(Outcome.FAIL, f"{evidence.growth}: {text}")
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
