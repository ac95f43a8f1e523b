"""What taction shows of itself: the paper, stress cases, the demonstration, error and run time."""

from __future__ import annotations

import itertools
from collections.abc import Iterable, Iterator
from dataclasses import replace
from functools import partial

import numpy as np

from taction.system.charts import SERIES, Axis, Chart, Curve, Limit, Line, Mark, Outcome
from taction.system.quantities import quantity
from taction.verification.evidence.demonstration import Demonstration, DemonstrationStep
from taction.verification.evidence.paper.findings import ClaimOutcome, Finding
from taction.verification.evidence.paper.reproduce import Reproduction
from taction.verification.evidence.stress.run_cases import CaseJudgement, CaseRun, StressReport
from taction.verification.report.blocks import Content, Notes, Page, Section, Table
from taction.verification.report.texts import Cell, Column, fields, marked_cell, shown_by
from taction.verification.report.views.answer_view import answer_text, decisive_text, origin_section
from taction.verification.report.views.waveforms_view import outputs_chart, stress_chart
from taction.verification.studies.work_precision import (
    ERRORS,
    Method,
    SettingResult,
    WorkPrecisionStudy,
)

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
        chapters.append(Section(chapter.title, (table,)))
        if chapter.charts:
            chapters.append(Section(f"{chapter.title}: pictures", chapter.charts, media="page"))
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
            Section("Unexpected", Notes("", unexpected, "fail")),
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
    return marked_cell(text, CLAIMS[each.outcome])


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
            Section("Results", _results(report.runs)),
            Section("Wrong", Notes("Wrong", wrong, "fail")),
            Section("What makes the cases hard", cases, media="page"),
        ),
    )


def headline(report: StressReport) -> str:
    """Return the counts, the time and the versions as one line of text."""
    counts = ", ".join(f"{count} {kind}" for kind, count in report.count().items())
    cases, seconds = len({r.case.name for r in report.runs}), sum(r.seconds for r in report.runs)
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
        "outcome": lambda run: marked_cell(run.outcome, OUTCOMES[run.judgement]),
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


BOARDS: dict[str, Column] = {
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
        sections=(*steps, Section("Next", NEXT), origin_section(None)),
    )


def _sections(number: int, step: DemonstrationStep) -> tuple[Section, Section]:
    """Return the sentences and checks of a board, and its outputs; of the first also the answer."""
    verdict, title, first = step.verdict, f"{number}. {step.title}", number == 1
    answer = answer_text(verdict.answer) if first else ""
    shown = (outputs_chart, stress_chart)[: 1 + first]
    told = (step.text, answer, Table.of("", (step,), BOARDS))

    def charts() -> Iterator[Chart]:
        for made in (each(verdict) for each in shown):
            yield replace(made, title=f"{title}. {made.title}")

    return (Section(title, told), Section(f"{title}: outputs", charts, media="page picture"))


MARKS = ("circle", "square", "diamond", "triangle-down", "triangle-up", "star", "cross", "hexagon")
LINES: tuple[Line, ...] = ("solid", "dash", "dot", "dashdot")
LOWEST = 1e-15  # place of an error of exactly 0
ERROR = Axis("largest error over time (of the step)", scale="log")
WORK = (
    "Each mark is one setting of a method: further left is faster, further down is more accurate."
    " The dashed line is the error of the reference."
)


def accuracy_view(study: WorkPrecisionStudy) -> Page:
    """Return the page of a work-precision study."""
    took = quantity(study.seconds, "s", 3)
    machine = ", ".join(f"{k} {v}" for k, v in study.machine.items() if v is not None)
    return Page(
        title=study.scene.name,
        command="taction self accuracy",
        summary=_summary(study),
        lines=(study.stretch,),
        sections=(
            Section("Error against run time", partial(_charts, study), media="page picture"),
            Section("Runs", tuple(_runs(study))),
            Section("Cheapest settings", _cheapest(study)),
            Section("Left out", Notes("", study.omissions)),
            origin_section(study.scene),
        ),
        foot=("; ".join(filter(None, (machine, f"the study took {took}"))),),
    )


def _summary(study: WorkPrecisionStudy) -> str:
    reached = [(error, point) for error in ERRORS if (point := study.cheapest(error))]
    if not reached:
        return "No run of this study has a known error."
    error, point = reached[-1]
    name = point.method.name
    text = f"{name[:1].upper()}{name[1:]} reaches an error of {error:.0e} of the step"
    return f"{text} in {quantity(point.seconds, 's', 3)}."


def _methods(study: WorkPrecisionStudy) -> dict[Method, tuple[str, str, Line]]:
    """Return the methods with their colour, mark and line."""
    looks = ((SERIES[k % 8], MARKS[k % 8], LINES[k // 8 % 4]) for k in itertools.count())
    return dict(zip(dict.fromkeys(p.method for p in study.points), looks, strict=False))


def _known(study: WorkPrecisionStudy, method: Method, name: str) -> list[SettingResult]:
    """Return the runs of a method with an error and another figure."""
    return [p for p in study.of(method) if None not in (p.error, getattr(p, name))]


def _charts(study: WorkPrecisionStudy) -> Iterator[Content]:
    known = [p for method in _methods(study) for p in _known(study, method, "seconds")]
    if len(known) < 2:
        text = f"{len(known) or 'No'} run has a known error: there is nothing to compare."
        yield f"{text} A larger --budget gives more runs."
        return
    time = Axis("wall time, median", "s", "log")
    yield Chart("Runs by time and error", time, ERROR, tuple(_work(study)), WORK)


def _work(study: WorkPrecisionStudy) -> Iterator[Mark]:
    """Yield the errors over the median run times."""
    if study.floor:
        yield Limit(study.floor, "y", "error of the reference", "muted")
    for method, (colour, mark, line) in _methods(study).items():
        points = _known(study, method, "seconds")
        times = np.array([p.seconds for p in points], dtype=np.float64)
        hover = tuple(
            f"{method.name} {p.name}: error {p.error:.1e} in {quantity(p.seconds, 's', 3)}"
            for p in points
        )
        errors = np.array([max(p.error or 0.0, LOWEST) for p in points])
        yield Curve(times, errors, method.name, colour, line, mark, width=1.2, hover=hover)


def _runs(study: WorkPrecisionStudy) -> Iterator[Content]:
    points = [point for method in _methods(study) for point in study.of(method)]
    columns = {
        **fields("method = method.name; setting; status; time = seconds 3"),
        **fields("steps"),
        "largest error": lambda each: Cell(_power(each.error), each.error),
    }
    yield Table.of("Wall times and errors", points, columns, _scale_text(study))
    yield from (f"{p.method.name}, {p.name}: {p.status} {p.note}" for p in points if p.note)


def _power(value: float | None) -> str:
    return "–" if value is None else f"{value:.1e}"


def _scale_text(study: WorkPrecisionStudy) -> str:
    """Return how the errors are measured."""
    text = "Largest error over time and outputs, over the step. Reference: "
    text += study.references[0] if study.references else "none, all failed"
    if len(study.references) > 1:
        text += f", checked by {study.references[1]}; the largest difference of the two is"
        text += f" {_power(study.floor)}"
    return f"{text}; step {quantity(study.amplitude, 'V')}."


def _cheapest(study: WorkPrecisionStudy) -> Table:
    def choice(point: SettingResult | None) -> str:
        if point is None:
            return "no run reached it"
        return f"{point.method.name}{f', {point.name}' if point.method.setting else ''}"

    rows = [(e, study.cheapest(e), study.cheapest(e, ["ngspice"])) for e in ERRORS]
    seconds = shown_by("seconds 3")
    columns = {
        "largest error": lambda row: Cell(f"{row[0]:.0e}", row[0]),
        "cheapest": lambda row: choice(row[1]),
        "time": lambda row: row[1] and seconds(row[1]),
        "ngspice": lambda row: choice(row[2]),
        "time of ngspice": lambda row: row[2] and seconds(row[2]),
    }
    note = "Largest error over time on the board, as measured."
    return Table.of("Cheapest setting that reaches an error", rows, columns, note)
