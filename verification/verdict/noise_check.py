"""The check of the output noise."""

from __future__ import annotations

from taction.verification.verdict.checks import (
    Check,
    Evidence,
    Outcome,
    at_most,
    joined,
    percent,
    undecided,
)

NAME, UNIT = "noise", "V"
UNSTATED = (
    "the voltage noise of op-amp {} is not given: set design.opamp.voltage_noise, such as"
    " '20nV/rtHz', or take a preset that has one (taction models)"
)
NOISELESS = "op-amp {} is ideal and has no noise: only resistors and sensors count"
AGREE = 0.01  # of the noise: the largest difference of the two engines


def noise(evidence: Evidence) -> Check | None:
    """Compare the largest noise of any channel with the limit of the scene, if there is one."""
    found, limited = evidence.noise, evidence.checks.noise
    if found is None or limited is None:
        return None
    if found.unknown:
        return undecided(NAME, UNIT, found.unknown, limited.max)
    value, error = found.largest, found.error[found.worst] + found.difference
    outcome = at_most(value, error, limited.max)
    reason = f"channel {found.worst + 1} at rest, rms over all frequencies"
    if found.difference > AGREE * value:
        outcome = Outcome.INCONCLUSIVE
        reason = joined(reason, f"ngspice differs by {percent(found.difference / value)}")
    elif outcome is Outcome.PASS and found.unstated:
        outcome = Outcome.INCONCLUSIVE
        reason = joined(reason, UNSTATED.format(", ".join(found.unstated)))
    if found.noiseless:
        reason = joined(reason, NOISELESS.format(", ".join(found.noiseless)))
    return Check(NAME, outcome, value, error, limited.max, None, UNIT, reason)
