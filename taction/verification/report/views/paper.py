"""The reproduction of the paper: every claim beside what taction finds, and the pictures."""

from __future__ import annotations

from taction.system.charts import Outcome
from taction.verification.evidence.paper.findings import ClaimOutcome, Finding
from taction.verification.evidence.paper.reproduce import Reproduction
from taction.verification.report.blocks import BOTH, Cell, Notes, Page, Section, Table
from taction.verification.report.texts import outcome_cell
from taction.verification.report.views.origin import origin_section

SOURCE = (
    "Y. C. Pati, P. S. Krishnaprasad and M. C. Peckerar, Neural network solutions to problems in"
    " early taction"
)
OUTCOMES: dict[ClaimOutcome, Outcome] = {
    ClaimOutcome.HOLDS: "pass",
    ClaimOutcome.FITTED: "pass",
    ClaimOutcome.CONDITION: "inconclusive",
    ClaimOutcome.FAILS: "fail",
    ClaimOutcome.NOT_RUN: "error",
}
COLUMNS = {
    "claim": lambda each: each.claim.claim,
    "verdict": lambda each: _verdict(each),
    "place": lambda each: each.claim.place,
    "what was run": lambda each: each.run,
    "printed": lambda each: each.claim.printed,
    "ours": lambda each: each.ours,
}


def view(result: Reproduction) -> Page:
    """Return the page of the reproduction."""
    chapters = []
    for chapter in result.sections:
        table = Table.of(chapter.title, chapter.findings, COLUMNS)
        chapters.append(Section(chapter.title, (table,), media=BOTH))
        if chapter.charts:
            chapters.append(Section(f"{chapter.title}: pictures", chapter.charts))
    unexpected = tuple(
        f"{each.claim.id}: {each.outcome.value}; expected: {each.claim.expected.value}. {each.ours}"
        for each in result.findings
        if not each.as_expected
    )
    left_out = Notes("", (", ".join(result.omitted),)) if result.omitted else None
    return Page(
        title="The paper, claim by claim",
        command="taction reproduce",
        outcome=result.outcome,
        summary=f"{summary(result)} {result.seconds:.0f} s.",
        lines=(f"{SOURCE}.",),
        sections=(
            *chapters,
            Section("Left out of a quick run", (left_out,), media=BOTH),
            Section("Unexpected", (Notes("", unexpected, "fail"),), media=BOTH),
            origin_section(None),
        ),
    )


def summary(result: Reproduction) -> str:
    """Return the number of claims with each verdict."""
    outcomes = [each.outcome for each in result.findings]
    counts = ", ".join(f"{o.value} {outcomes.count(o)}" for o in ClaimOutcome if o in outcomes)
    return f"{len(outcomes)} claims: {counts}."


def _verdict(each: Finding) -> Cell:
    text = each.outcome.value
    if not each.as_expected:
        text += f" (expected: {each.claim.expected.value})"
    return outcome_cell(text, OUTCOMES[each.outcome])
