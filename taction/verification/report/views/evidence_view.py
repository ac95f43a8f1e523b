"""What taction shows of itself: the paper claim by claim, the stress cases, the demonstration."""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from dataclasses import replace

from taction.system.charts import Chart, Outcome
from taction.verification.evidence.demonstration import Demonstration, DemonstrationStep
from taction.verification.evidence.paper.findings import ClaimOutcome, Finding
from taction.verification.evidence.paper.reproduce import Reproduction
from taction.verification.evidence.stress.run_cases import CaseJudgement, CaseRun, StressReport
from taction.verification.report.blocks import Notes, Page, Section, Table
from taction.verification.report.texts import Cell, Column, fields, outcome_cell, shown_by
from taction.verification.report.views.answer_view import answer_text, decisive_text
from taction.verification.report.views.origin_view import origin_section
from taction.verification.report.views.waveforms_view import outputs_chart, stress_chart

SOURCE = (
    "Y. C. Pati, P. S. Krishnaprasad and M. C. Peckerar, Neural network solutions to problems in"
    " early taction"
)
CLAIMS: dict[ClaimOutcome, Outcome] = {
    ClaimOutcome.HOLDS: "pass",
    ClaimOutcome.FITTED: "pass",
    ClaimOutcome.CONDITION: "inconclusive",
    ClaimOutcome.FAILS: "fail",
    ClaimOutcome.NOT_RUN: "error",
}
COLUMNS: dict[str, Column] = {
    "claim": "claim.claim",
    "verdict": lambda each: _verdict(each),
    **fields("place = claim.place; what was run = run; printed = claim.printed; ours"),
}


def paper_view(result: Reproduction) -> Page:
    """Return the page of the reproduction."""
    chapters = []
    for chapter in result.sections:
        table = Table.of(chapter.title, chapter.findings, COLUMNS)
        chapters.append(Section(chapter.title, (table,), media="terminal page"))
        if chapter.charts:
            chapters.append(Section(f"{chapter.title}: pictures", chapter.charts))
    unexpected = tuple(
        f"{each.claim.id}: {each.outcome.value}; expected: {each.claim.expected.value}. {each.ours}"
        for each in result.findings
        if not each.as_expected
    )
    return Page(
        title="The paper, claim by claim",
        command="taction reproduce",
        outcome=result.outcome,
        summary=f"{summary(result)} {result.seconds:.0f} s.",
        lines=(f"{SOURCE}.",),
        sections=(
            *chapters,
            Section("Left out of a quick run", ", ".join(result.omitted), media="terminal page"),
            Section("Unexpected", Notes("", unexpected, "fail"), media="terminal page"),
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
    return outcome_cell(text, CLAIMS[each.outcome])


OUTCOMES: dict[CaseJudgement, Outcome] = {
    CaseJudgement.RIGHT: "pass",
    CaseJudgement.WRONG_OUTCOME: "fail",
    CaseJudgement.WRONG_NUMBER: "fail",
    CaseJudgement.NOT_RUN: "inconclusive",
}


def stress_view(report: StressReport) -> Page:
    """Return the page of a run of the stress cases."""
    outcome = "fail" if report.wrong else "pass" if not report.exit_status else "inconclusive"
    wrong = tuple(
        f"{run.case.name}, {run.engine}: {run.judgement.value}: {run.reason}"
        for run in report.wrong
    )
    cases = {run.case.name: f"{run.case.family}: {run.case.why}" for run in report.runs}
    return Page(
        title="Stiff and extreme cases",
        command="taction self stress",
        outcome=outcome,
        summary=headline(report),
        sections=(
            Section("Results", _results(report.runs), media="terminal page"),
            Section("Wrong", Notes("Wrong", wrong, "fail"), media="terminal page"),
            Section("What makes the cases hard", cases),
        ),
    )


def headline(report: StressReport) -> str:
    """Return the counts, the time and the versions as one line of text."""
    counts = ", ".join(f"{count} {kind}" for kind, count in report.count().items())
    cases, seconds = (
        len({run.case.name for run in report.runs}),
        sum(r.seconds for r in report.runs),
    )
    compared = f"{report.outside} of {report.numbers} numbers outside their stated error"
    if not report.numbers:
        compared = "no numbers compared: a checkout has their true values"
    parts = f"{cases} cases, {len(report.runs)} runs: {counts}", compared, f"{seconds:.0f} s"
    versions = ", ".join(f"{name} {version}" for name, version in report.versions.items())
    return "; ".join((*parts, versions))


def _results(runs: Iterable[CaseRun]) -> Table:
    """Return a row for each run, with the number that is worst in its stated error."""

    def error(name: str) -> Column:
        shown = shown_by(f"{name} @unit 2")
        return lambda run: run.worst and shown(run.worst)

    columns = {
        **fields("case = case.name; engine"),
        "outcome": lambda run: outcome_cell(run.outcome, OUTCOMES[run.judgement]),
        "worst quantity": lambda run: run.worst and run.worst.name,
        "true error": error("error"),
        "stated error": error("uncertainty"),
        "outside": lambda run: (
            run.worst and Cell(f"{run.outside} of {len(run.comparisons)}", run.outside)
        ),
        **fields("time = seconds s 2"),
    }
    return Table.of("Results", runs, columns)


TITLE = "Seven sensors, one board"
NEXT = (
    "Your own board: taction new board.toml, then taction verify board.toml --report board.html,"
    " then taction explore board.toml."
)


STEPS: dict[str, Column] = {
    **fields("board = title; outcome = verdict.outcome outcome"),
    "because": lambda step: decisive_text(step.verdict.checks, step.verdict.outcome.value),
}


def demonstration_view(found: Demonstration) -> Page:
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
            Section("Next", NEXT, media="terminal page"),
            origin_section(None),
        ),
    )


def _sections(number: int, step: DemonstrationStep) -> tuple[Section, Section]:
    """Return the sentences and checks of a board, and its outputs; of the first also the answer."""
    verdict, title, first = step.verdict, f"{number}. {step.title}", number == 1
    answer = answer_text(verdict.answer) if first else ""
    shown = (outputs_chart, stress_chart)[: 1 + first]
    told = (step.text, answer, Table.of("", (step,), STEPS))

    def charts() -> Iterator[Chart]:
        for made in (each(verdict) for each in shown):
            yield replace(made, title=f"{title}. {made.title}")

    return (
        Section(title, told, media="terminal page"),
        Section(f"{title}: outputs", charts, media="page picture"),
    )
