"""Comparison of the records of two engines at one point of a sweep."""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass
from typing import Any

from taction.verification.studies.figures import FIGURES, TRANSIENT_READINGS
from taction.verification.studies.sweep.store import ERROR
from taction.verification.verdict.checks import Outcome

OPPOSITE = {Outcome.PASS.value, Outcome.FAIL.value}
APART = 2.0
"""Times both uncertainties: a larger difference of a reading is a disagreement. A bound holds for
at least 99 % of readings; the factor keeps the others from being disagreements."""
BOTH = "engines_agree"  # the check of ngspice's verdict that compares the waveforms

Record = dict[str, Any]


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


def compare(ngspice: Record, statespace: Record) -> Comparison:
    """Compare the records of a point (`taction.verification.studies.sweep.point`).

    The engines disagree if one passes a check that the other fails, if the waveforms differ by more
    than the scene allows, or if a reading differs by more than `APART` times its uncertainties.
    """
    for record in (ngspice, statespace):
        if record["outcome"] == ERROR:
            first = record["reason"].partition("\n")[0]
            return Comparison(
                Outcome.INCONCLUSIVE, None, f"no verdict by {record['engine']}: {first}"
            )
    difference = None
    if ngspice["attained_error"] is not None:
        difference = ngspice["attained_error"] / ngspice["wanted_error"]
    found = [*_checks(ngspice, statespace), *_readings(ngspice, statespace)]
    for outcome in (Outcome.FAIL, Outcome.INCONCLUSIVE):
        reasons = [reason for each, reason in found if each is outcome]
        if reasons:
            return Comparison(outcome, difference, "; ".join(reasons))
    return Comparison(Outcome.PASS, difference, "")


def _checks(ngspice: Record, statespace: Record) -> Iterator[tuple[Outcome, str]]:
    ours = {check["name"]: check["outcome"] for check in ngspice["checks"]}
    theirs = {check["name"]: check["outcome"] for check in statespace["checks"]}
    for name in ours.keys() & theirs.keys():
        if {ours[name], theirs[name]} == OPPOSITE:
            text = f"{name}: {ours[name]} by ngspice, {theirs[name]} by the state-space engine"
            yield Outcome.FAIL, text
    if ours.get(BOTH, Outcome.PASS.value) != Outcome.PASS.value:
        yield Outcome(ours[BOTH]), f"{BOTH}: {ours[BOTH]}"


def _readings(ngspice: Record, statespace: Record) -> Iterator[tuple[Outcome, str]]:
    """Compare the readings of a stable board; those of a growing record depend on its length."""
    if not (ngspice["stable"] and statespace["stable"]):
        return
    for name in TRANSIENT_READINGS:
        ours, theirs = ngspice["readings"][name], statespace["readings"][name]
        if ours is None or theirs is None:
            if ours is not theirs:
                owner = "the state-space engine" if ours is None else "ngspice"
                yield Outcome.INCONCLUSIVE, f"{name}: only {owner} has this reading"
            continue
        uncertainty = _uncertainty(ours) + _uncertainty(theirs)
        if not math.isfinite(uncertainty):
            yield Outcome.INCONCLUSIVE, f"{name}: no second solution confirms this reading"
        elif _apart(ours, theirs) > APART * uncertainty:
            values = (
                f"{ours['value']:.6g} by ngspice, {theirs['value']:.6g} by the state-space engine"
            )
            unit = FIGURES[name].unit
            yield Outcome.FAIL, f"{name} ({unit}): {values}, uncertainty {uncertainty:.2g}"


def _uncertainty(reading: dict[str, float | None]) -> float:
    """Return the uncertainty; infinite where no second solution confirms the reading."""
    return math.inf if reading["uncertainty"] is None else reading["uncertainty"]


def _apart(a: dict[str, float | None], b: dict[str, float | None]) -> float:
    """Return the distance of two readings; of a fragile reading either value counts."""
    pairs = [
        (x[name], y["value"]) for x, y in ((a, b), (b, a)) for name in ("value", "alternative")
    ]
    return min(abs(x - y) for x, y in pairs if x is not None and y is not None)
