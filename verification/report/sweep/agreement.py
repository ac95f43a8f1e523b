"""How far the two engines of a sweep agree."""

from __future__ import annotations

from collections import Counter
from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any

from taction.netlist_gen.scene.keys import Value
from taction.verification.report.sweep.records import records
from taction.verification.studies.store import Store
from taction.verification.studies.sweep.hybrid import BOUNDARY, EXTREME, SAMPLE
from taction.verification.studies.sweep.plan import Plan
from taction.verification.verdict.checks import Outcome

LINES = 20  # points that are listed
WORDS = {
    BOUNDARY: "next to the stability boundary",
    EXTREME: "with an extreme reading",
    SAMPLE: "of the random sample",
}


@dataclass(frozen=True, slots=True)
class AgreementSummary:
    """How many points have results of both engines, and how far these agree.

    Attributes
    ----------
    points, agree, disagree, undecided : int
        Points with results of both engines, and how many of them have which agreement.
    chosen : mapping of str to int
        Points that a hybrid sweep confirms, by the reason.
    largest_difference : float or None
        Largest difference of any output at any time and point, divided by the error that the run of
        ngspice was allowed.
    at : dict of str to float, int, str or bool, or None
        The values of that point, by the names of the axes.
    listed : list of dict
        Records of ngspice at points without agreement, disagreements first, at most `LINES`.
    """

    points: int
    agree: int
    disagree: int
    undecided: int
    chosen: Mapping[str, int]
    largest_difference: float | None
    at: dict[str, Value] | None
    listed: list[dict[str, Any]] = field(repr=False)


def summarise(plan: Plan, store: Store) -> AgreementSummary:
    """Return the agreement of the stored points of `plan`."""
    outcomes: Counter[str] = Counter()
    chosen: Counter[str] = Counter()
    listed: dict[str, list[dict[str, Any]]] = {"fail": [], "inconclusive": []}
    largest, at = None, None
    for record in records(plan, store):
        outcome = record["agreement"]
        if outcome is None or record["engine"] != "ngspice":
            continue
        outcomes[outcome] += 1
        if record["chosen"] is not None:
            chosen[record["chosen"]] += 1
        if outcome in listed and len(listed[outcome]) < LINES:
            listed[outcome].append(record)
        difference = record["difference"]
        if difference is not None and (largest is None or difference > largest):
            largest, at = difference, record["values"]
    return AgreementSummary(
        points=outcomes.total(),
        agree=outcomes[Outcome.PASS.value],
        disagree=outcomes[Outcome.FAIL.value],
        undecided=outcomes[Outcome.INCONCLUSIVE.value],
        chosen=dict(chosen),
        largest_difference=largest,
        at=at,
        listed=[*listed["fail"], *listed["inconclusive"]][:LINES],
    )
