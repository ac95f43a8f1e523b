"""A run of the stress cases: every case and engine, what is wrong, and every case in words."""

from __future__ import annotations

import math
from collections.abc import Iterable, Iterator

from taction.system.charts import Outcome
from taction.verification.evidence.stress.catalogue import Case
from taction.verification.evidence.stress.run import CaseJudgement, CaseRun, StressReport
from taction.verification.report.blocks import BOTH, Cell, Notes, Page, Section, Table
from taction.verification.report.texts import fields, figure, outcome_cell

OUTCOMES: dict[CaseJudgement, Outcome] = {
    CaseJudgement.RIGHT: "pass",
    CaseJudgement.WRONG_OUTCOME: "fail",
    CaseJudgement.WRONG_NUMBER: "fail",
    CaseJudgement.NOT_RUN: "inconclusive",
}


def view(report: StressReport) -> Page:
    """Return the page of a run of the stress cases."""
    outcome = "fail" if report.wrong else "pass" if not report.exit_status else "inconclusive"
    wrong = tuple(
        f"{run.case.name}, {run.engine}: {run.judgement.value}: {run.reason}"
        for run in report.wrong
    )
    cases = {run.case.name: run.case for run in report.runs}
    families = dict.fromkeys(case.family for case in cases.values())
    return Page(
        title="Stiff and extreme cases",
        command="taction self stress",
        outcome=outcome,
        summary=headline(report),
        sections=(
            Section("Results", (_results(report.runs),), media=BOTH),
            Section("Wrong", (Notes("Wrong", wrong, "fail"),), media=BOTH),
            *(
                Section(f"Cases: {family}", (_cases(family, cases.values()),))
                for family in families
            ),
        ),
    )


def headline(report: StressReport) -> str:
    """Return the counts, the time and the versions as one line of text."""
    counts = ", ".join(f"{count} {kind}" for kind, count in report.count().items())
    cases = len({run.case.name for run in report.runs})
    numbers, seconds = report.numbers, sum(run.seconds for run in report.runs)
    versions = ", ".join(f"{name} {version}" for name, version in report.versions.items())
    compared = f"{report.outside} of {numbers} numbers outside their stated error"
    if not numbers:
        compared = "no numbers compared: a checkout has their true values"
    return (
        f"{cases} cases, {len(report.runs)} runs: {counts}; {compared}; {seconds:.0f} s; {versions}"
    )


def _results(runs: Iterable[CaseRun]) -> Table:
    """Return a row for each run.

    The worst quantity is the stated number whose true error is largest in its stated error;
    "outside" counts the numbers whose true error is larger than the stated one.
    """
    columns = {
        **fields("case = case.name; engine"),
        "outcome": lambda run: outcome_cell(run.outcome, OUTCOMES[run.judgement]),
        "worst quantity": lambda run: run.worst and run.worst.name,
        "true error": lambda run: run.worst and _error(run.worst.error, run.worst.unit),
        "stated error": lambda run: run.worst and _error(run.worst.uncertainty, run.worst.unit),
        "outside": lambda run: (
            run.worst and Cell(f"{run.outside} of {len(run.comparisons)}", run.outside)
        ),
        **fields("time = seconds s 2"),
    }
    return Table.of("Results", runs, columns)


def _error(error: float, unit: str) -> Cell:
    return Cell("–") if math.isnan(error) else Cell(figure(error, unit, 2), error)


def _cases(family: str, cases: Iterable[Case]) -> Table:
    columns = {
        **fields("case = name; hard because = why"),
        "right outcome": lambda case: ", ".join(_outcomes(case)),
        **fields("known from = known"),
    }
    return Table.of(family, (case for case in cases if case.family == family), columns)


def _outcomes(case: Case) -> Iterator[str]:
    """Yield the one outcome of all engines, or the outcome of each."""
    words = {engine: " or ".join(outcomes) for engine, outcomes in case.outcome.items()}
    if len(set(words.values())) == 1:
        yield next(iter(words.values()))
    else:
        yield from (f"{engine}: {outcome}" for engine, outcome in words.items())
    yield from (f"{name} {outcome}" for name, outcome in case.decided.items())
