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


COLUMNS = {
    "board": lambda step: step.title,
    "outcome": lambda step: outcome_cell(step.verdict.outcome.value),
    "because": lambda step: decisive_text(step.verdict.checks, step.verdict.outcome.value),
}


def view(found: Demonstration) -> Page:
    """Return the page of the demonstration."""
    told = "as told" if found.outcome == "pass" else "NOT as told"
    steps = [part for number, step in enumerate(found.steps, 1) for part in _sections(number, step)]
    return Page(
        title=TITLE,
        command="taction demo",
        outcome=found.outcome if found.outcome == "fail" else "pass",
        summary=f"Three boards, {told}, in {found.seconds:.0f} s.",
        sections=(
            *steps,
            Section("Next", (Notes("", (NEXT,)),), media=BOTH),
            origin_section(None),
        ),
    )


def _sections(number: int, step: DemonstrationStep) -> tuple[Section, Section]:
    """Return the sentences and checks of a board, and its outputs; of the first also the answer."""
    verdict, title, first = step.verdict, f"{number}. {step.title}", number == 1
    answers = (answer_text(verdict.answer),) if first else ()

    def charts() -> tuple[Block, ...]:
        return (outputs_chart(verdict), *((stress_chart(verdict),) if first else ()))

    told = Notes("", (step.text, *answers)), Table.of("", (step,), COLUMNS)
    return (
        Section(title, told, media=BOTH),
        Section(f"{title}: outputs", charts, media=DRAWN),
    )
