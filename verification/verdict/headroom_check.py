"""The check that no op-amp has to do more than its data sheet allows."""

from __future__ import annotations

from taction.verification.verdict.checks import Check, Evidence, Outcome, undecided
from taction.verification.verdict.headroom import FULL
from taction.verification.verdict.part_limits import NAME, PartLoads, amount, describe


def headroom(evidence: Evidence) -> Check | None:
    """Fail if the steady state is beyond a part; above `FULL` of a limit nothing is known."""
    parts = evidence.parts
    if parts.unknown:
        return undecided(NAME, "ratio", parts.unknown, FULL)
    if not parts.loads and not parts.simulated:
        return None
    if parts.simulated:
        return _limited(parts)
    worst, outcome = parts.loads[0], Outcome.PASS
    reason = describe(worst)
    if parts.impossible:
        outcome, load = Outcome.FAIL, parts.impossible[0]
        rest = amount(load, load.rest)
        reason = (
            f"at rest the output {load.quantity} of op-amp {load.part} would be {rest}; the limit"
            f" is {amount(load, load.limit)}{parts.remedy}"
        )
    elif worst.is_above:
        outcome = Outcome.INCONCLUSIVE
        reason += f", and above {FULL:.0%} of a limit the small-signal board is not true"
        reason += parts.remedy
    error = worst.error / worst.limit
    return Check(NAME, outcome, worst.share, error, FULL, None, "ratio", reason)


def _limited(parts: PartLoads) -> Check:
    """Return the check of a board whose simulated op-amps have their limits."""
    would = describe(parts.simulated[0]).replace(" reaches ", " would reach ")
    reason = f"{would}; the simulated op-amps have slew rate and swing"
    if any(load.quantity == "current" for load in parts.simulated):
        reason += " and largest output current"
    if not parts.loads:
        return Check(NAME, Outcome.PASS, None, None, FULL, None, "ratio", reason)
    worst = parts.loads[0]
    outcome = Outcome.INCONCLUSIVE if worst.is_above else Outcome.PASS
    error = worst.error / worst.limit
    reason += f"; {describe(worst)}"
    return Check(NAME, outcome, worst.share, error, FULL, None, "ratio", reason)
