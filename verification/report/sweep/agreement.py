"""How far the two engines of a sweep agree."""

from __future__ import annotations

from collections import Counter
from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any

from rich.console import Console
from rich.markup import escape

from taction.netlist_gen.scene.keys import Value
from taction.verification.report.sweep.records import records
from taction.verification.report.tables import value_text
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


def print_summary(plan: Plan, found: AgreementSummary, console: Console) -> None:
    """Print how many points ngspice confirms, the largest difference, and every disagreement."""
    reasons = ", ".join(f"{found.chosen[why]} {WORDS[why]}" for why in WORDS if why in found.chosen)
    text = f"ngspice confirms {found.agree} of {found.points} points"
    console.print(f"{text} ({reasons})" if reasons else text)
    if found.largest_difference is not None and found.at is not None:
        place = _values_text(plan, found.at)
        text = f"largest difference of the engines: {found.largest_difference:.2g} of the error"
        console.print(f"{text} that the checks allow, at {place}")
    if found.disagree:
        points = "1 point" if found.disagree == 1 else f"{found.disagree} points"
        console.print(f"[bold red]THE ENGINES DISAGREE at {points}[/bold red]")
    if found.undecided:
        console.print(f"[yellow]{found.undecided} not decided[/yellow]")
    for record in found.listed:
        place = _values_text(plan, record["values"])
        console.print(f"  {record['agreement']} at {place}: {escape(record['disagreement'])}")


def _values_text(plan: Plan, values: Mapping[str, Value]) -> str:
    units = {axis.name: axis.key.unit for axis in plan.axes}
    texts = (f"{name} = {value_text(value, units[name])}" for name, value in values.items())
    return escape(", ".join(texts))
