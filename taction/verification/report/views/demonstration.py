"""The demonstration: each board with its sentences, its outputs and its checks."""

from __future__ import annotations

from taction.verification.evidence.demonstration import Demonstration, DemonstrationStep
from taction.verification.report.blocks import BOTH, DRAWN, Block, Notes, Page, Section, Table
from taction.verification.report.texts import outcome_cell
from taction.verification.report.views.answer import answer_text
from taction.verification.report.views.checks import decisive_text
from taction.verification.report.views.origin import origin_section
from taction.verification.report.views.waveforms import outputs_chart, stress_chart

TITLE = "Seven sensors, one board"
NEXT = (
    "Your own board: taction new board.toml, then taction verify board.toml --report board.html,"
    " then taction explore board.toml."
)


def view(found: Demonstration) -> Page:
    """Return the page of the demonstration."""
    told = "as told" if found.outcome == "pass" else "NOT as told"
    return Page(
        title=TITLE,
        command="taction demo",
        outcome=found.outcome if found.outcome == "fail" else "pass",
        summary=f"Three boards, {told}, in {found.seconds:.0f} s.",
        sections=(
            *(
                part
                for number, step in enumerate(found.steps, 1)
                for part in _sections(number, step)
            ),
            Section("Next", (Notes("", (NEXT,)),), media=BOTH),
            origin_section(None),
        ),
    )


def _sections(number: int, step: DemonstrationStep) -> tuple[Section, ...]:
    verdict = step.verdict
    title = f"{number}. {step.title}"
    table = Table.of(
        "",
        (step,),
        {
            "board": lambda each: each.title,
            "outcome": lambda each: outcome_cell(each.verdict.outcome.value),
            "because": lambda each: decisive_text(each.verdict.checks, each.verdict.outcome.value),
        },
    )

    answers = (answer_text(verdict.answer),) if number == 1 else ()

    def charts() -> tuple[Block, ...]:
        pressures = number == 1
        return (outputs_chart(verdict), *((stress_chart(verdict),) if pressures else ()))

    return (
        Section(title, (Notes("", (step.text, *answers)), table), media=BOTH),
        Section(f"{title}: outputs", charts, media=DRAWN),
    )
