"""The reproduction of the paper: every claim beside what taction finds, and the pictures."""

from __future__ import annotations

from itertools import chain

from taction.system.charts import Outcome
from taction.verification.evidence.paper.findings import ClaimOutcome
from taction.verification.evidence.paper.reproduce import Judged, Reproduction
from taction.verification.report.blocks import BOTH, Cell, Notes, Page, Section, Table
from taction.verification.report.texts import outcome_cell
from taction.verification.report.views.origin import origin_section

TITLE = "The paper, claim by claim"
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


def view(result: Reproduction) -> Page:
    """Return the page of the reproduction."""
    chapters = []
    columns = {
        "claim": lambda each: each.claim.claim,
        "verdict": _verdict,
        "place": lambda each: each.claim.place,
        "what was run": lambda each: each.finding.run,
        "printed": lambda each: each.claim.printed,
        "ours": lambda each: each.finding.ours,
    }
    for chapter in result.sections:
        table = Table.of(chapter.title, chapter.judged, columns)
        chapters.append(Section(chapter.title, (table,), media=BOTH))
        if chapter.pictures:
            charts = tuple(chain.from_iterable(chapter.pictures))
            chapters.append(Section(f"{chapter.title}: pictures", charts))
    names = ", ".join(claim.id for claim in result.left_out)
    left_out = Notes("", (names,)) if names else None
    return Page(
        title=TITLE,
        command="taction reproduce",
        outcome=result.outcome,
        summary=f"{summary(result)} {result.seconds:.0f} s.",
        lines=(f"{SOURCE}.",),
        sections=(
            *chapters,
            Section("Left out of a quick run", (left_out,), media=BOTH),
            Section("Unexpected", (_unexpected(result),), media=BOTH),
            origin_section(None),
        ),
    )


def summary(result: Reproduction) -> str:
    """Return the number of claims with each verdict."""
    outcomes = [each.finding.outcome for each in result.judged]
    counts = ", ".join(f"{o.value} {outcomes.count(o)}" for o in ClaimOutcome if o in outcomes)
    return f"{len(outcomes)} claims: {counts}."


def _verdict(each: Judged) -> Cell:
    text = each.finding.outcome.value
    if not each.as_expected:
        text += f" (expected: {each.claim.expected.value})"
    return outcome_cell(text, OUTCOMES[each.finding.outcome])


def _unexpected(result: Reproduction) -> Notes:
    lines = (
        f"{each.claim.id}: {each.finding.outcome.value}; expected: {each.claim.expected.value}."
        f" {each.finding.ours}"
        for each in result.judged
        if not each.as_expected
    )
    return Notes("", tuple(lines), "fail")
