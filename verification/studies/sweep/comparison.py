"""Whether two engines agree at one point of a sweep."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

from taction.verification.verdict.checks import Outcome
from taction.verification.verdict.compare import Difference, compare, within_uncertainties
from taction.verification.verdict.record import ERROR, TRANSIENT_READINGS, Record

OPPOSITE = {Outcome.PASS.value, Outcome.FAIL.value}
APART = 2.0
"""Times both uncertainties: a larger difference of a reading is a disagreement. A bound holds for
at least 99 % of readings; the factor keeps the others from being disagreements."""
BOTH = "engines_agree"  # the check of ngspice's verdict that compares the waveforms


@dataclass(frozen=True, slots=True)
class Comparison:
    """Whether two engines agree at a point.

    Attributes
    ----------
    outcome : Outcome
        Inconclusive if an engine has no verdict, or if the difference cannot be judged.
    difference : float or None
        Largest difference of any output at any time, divided by the error that the run of ngspice
        was allowed (`wanted_error`); None for an unstable board, whose outputs grow.
    reason : str
        Why the engines do not agree; empty if they agree.
    """

    outcome: Outcome
    difference: float | None
    reason: str


def compare_point(ngspice: Record, statespace: Record) -> Comparison:
    """Compare the records of a point.

    The engines disagree if one passes a check that the other fails, if the waveforms differ by more
    than the scene allows, or if a reading differs by more than `APART` times its uncertainties. The
    readings of an unstable board depend on the length of its record and are not compared.
    """
    for record in (ngspice, statespace):
        if record.outcome == ERROR:
            first = record.reason.partition("\n")[0]
            return Comparison(Outcome.INCONCLUSIVE, None, f"no verdict by {record.engine}: {first}")
    attained, wanted = ngspice.value("attained_error"), ngspice.value("wanted_error")
    difference = attained / wanted if attained is not None and wanted else None
    groups = ["checks"] + ["figures"] * bool(ngspice.stable and statespace.stable)
    tolerance = within_uncertainties(APART)
    found = compare(ngspice, statespace, tolerance, groups=groups, figures=TRANSIENT_READINGS)
    judged = [*_waveforms(ngspice), *(pair for each in found for pair in _judged(each))]
    for outcome in (Outcome.FAIL, Outcome.INCONCLUSIVE):
        reasons = [reason for each, reason in judged if each is outcome]
        if reasons:
            return Comparison(outcome, difference, "; ".join(reasons))
    return Comparison(Outcome.PASS, difference, "")


def _waveforms(ngspice: Record) -> Iterator[tuple[Outcome, str]]:
    check = ngspice.check(BOTH)
    if check is not None and check.outcome is not Outcome.PASS:
        yield check.outcome, f"{BOTH}: {check.outcome.value}"


def _judged(found: Difference) -> Iterator[tuple[Outcome, str]]:
    """Yield whether a check or a reading contradicts the agreement of the engines, and how."""
    ours, theirs, name = found.first, found.second, found.name
    if found.group == "checks":
        if {ours, theirs} == OPPOSITE:
            yield Outcome.FAIL, f"{name}: {ours} by ngspice, {theirs} by the state-space engine"
    elif ours is None or theirs is None:
        owner = "the state-space engine" if ours is None else "ngspice"
        yield Outcome.INCONCLUSIVE, f"{name}: only {owner} has this reading"
    elif found.allowed is None:
        yield Outcome.INCONCLUSIVE, f"{name}: no second solution confirms this reading"
    elif found.beyond:
        values = f"{ours:.6g} by ngspice, {theirs:.6g} by the state-space engine"
        text = f"{name} ({found.unit}): {values}, uncertainty {found.allowed / APART:.2g}"
        yield Outcome.FAIL, text
