"""A work-precision study: error against run time and step, orders, cheapest settings."""

from __future__ import annotations

from collections.abc import Iterator
from functools import partial

import numpy as np

from taction.system.charts import SERIES, Axis, Chart, Curve, Limit, Line, Mark
from taction.verification.report.blocks import Content, Notes, Page, Section, Table
from taction.verification.report.texts import Cell, fields, quantity, shown_by
from taction.verification.report.views.origin_view import origin_section
from taction.verification.studies.work_precision.methods import Method
from taction.verification.studies.work_precision.study import (
    ERRORS,
    SettingResult,
    WorkPrecisionStudy,
)

PROBLEMS = {"board": "the whole board", "ideal": "the network with ideal op-amps"}
MARKS = ("circle", "square", "diamond", "triangle-down", "triangle-up", "star", "cross", "hexagon")
LINES: tuple[Line, ...] = ("solid", "dash", "dot", "dashdot")
LOWEST = 1e-15  # place of an error of exactly 0
ERROR = Axis("largest error over time (of the step)", scale="log")
WORK = (
    "Each mark is one setting of a method: further left is faster, further down is more accurate."
    " The dashed line is the error of the reference; a cross at the upper edge is a run that timed"
    " out."
)
STEPS = "The order of convergence of a method is the median slope of its line."


def view(study: WorkPrecisionStudy) -> Page:
    """Return the page of a work-precision study."""
    took = quantity(study.seconds, "s", 3)
    machine = ", ".join(f"{k} {v}" for k, v in study.machine.items() if v is not None)
    sections = []
    for name in study.problems:
        title = f"Error against run time: {PROBLEMS[name]}"
        sections += [
            Section(title, partial(_charts, study, name), media="page picture"),
            Section(f"Runs: {PROBLEMS[name]}", tuple(_runs(study, name)), media="terminal page"),
        ]
    return Page(
        title=study.scene.name,
        command="taction self accuracy",
        summary=_summary(study),
        lines=(study.stretch,),
        sections=(
            *sections,
            Section("Order of convergence", _orders(study), media="terminal page"),
            Section("Cheapest settings", _cheapest(study), media="terminal page"),
            Section("Left out", Notes("", study.omissions), media="terminal page"),
            origin_section(study.scene, (("the study took", took),)),
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


def _methods(study: WorkPrecisionStudy, problem: str) -> dict[Method, tuple[str, str, Line]]:
    """Return the methods of a problem with their colour, mark and line."""
    methods = dict.fromkeys(p.method for p in study.points if p.method.problem == problem)
    looks = (
        (SERIES[k % len(SERIES)], MARKS[k % len(MARKS)], LINES[k // len(SERIES) % len(LINES)])
        for k in range(len(methods))
    )
    return dict(zip(methods, looks, strict=True))


def _known(study: WorkPrecisionStudy, method: Method) -> list[SettingResult]:
    """Return the runs of a method with a time and an error."""
    return [p for p in study.of(method) if p.error is not None and p.seconds is not None]


def _charts(study: WorkPrecisionStudy, problem: str) -> Iterator[Content]:
    known = [p for method in _methods(study, problem) for p in _known(study, method)]
    if len(known) < 2:
        text = f"{len(known) or 'No'} run has a known error: there is nothing to compare."
        yield f"{text} A larger --budget gives more runs."
        return
    best = min(known, key=lambda p: (p.error or 0.0, p.seconds or 0.0))
    said = f"the most accurate is {best.method.name}, {_error_text(best)}"
    time, name = Axis("wall time, median", "s", "log"), PROBLEMS[problem]
    marks = tuple(_work(study, problem))
    yield Chart(f"Runs by time and error, {name}", time, ERROR, marks, said, WORK)
    unit, step = 1.0, Axis("mean step", "s", "log")
    if problem == "board":
        unit = study.period
        step = Axis("mean step (periods of the fastest ringing)", "", "log")
    orders = {m.order: m for m in study.ladders if m.method.problem == problem}
    largest = max((order for order in orders if order is not None), default=None)
    said = ""
    if largest is not None:
        said = f"{orders[largest].method.name} has the largest order, {largest:.3g}"
    title = f"Error against the mean step, {name}"
    yield Chart(title, step, ERROR, tuple(_steps(study, problem, unit)), said, STEPS)


def _work(study: WorkPrecisionStudy, problem: str) -> Iterator[Mark]:
    """Yield the errors over the median run times."""
    if floor := study.problems[problem].floor:
        yield Limit(floor, "y", "error of the reference", "muted")
    top = 1.0
    for method, (colour, mark, line) in _methods(study, problem).items():
        points = _known(study, method)
        times = np.array([p.seconds for p in points], dtype=np.float64)
        texts = tuple(f"{method.name} {p.name}: error {_error_text(p)}" for p in points)
        errors = _errors(points)
        top = max(top, float(errors.max(initial=top)))
        yield Curve(times, errors, method.name, colour, line, mark, width=1.2, hover=texts)
    for point in study.points:  # at the upper edge, since the error of this run has no bound
        known = point.method.problem == problem and point.status == "timeout"
        if known and point.seconds is not None:
            look, place = _methods(study, problem)[point.method][0], np.array([point.seconds])
            text = f"timed out at {point.name}"
            yield Curve(place, np.array([top]), text, look, "", "x", size=9.0, label="",
                        hover=(text,))  # fmt: skip


def _errors(points: list[SettingResult]) -> np.ndarray:
    return np.array([max(p.error or 0.0, LOWEST) for p in points], dtype=np.float64)


def _error_text(point: SettingResult) -> str:
    return f"{point.error:.1e} in {quantity(point.seconds, 's', 3)}"


def _steps(study: WorkPrecisionStudy, problem: str, unit: float) -> Iterator[Mark]:
    """Yield the errors over the mean steps in a unit, s, with the orders of convergence."""
    for method, (colour, mark, _) in _methods(study, problem).items():
        known = [p for p in study.of(method) if None not in (p.error, p.mean_step)]
        steps = np.array([p.mean_step for p in known], dtype=np.float64) / unit
        texts = tuple(f"{method.name} {p.name}: {p.error:.2e}" for p in known)
        order, name = study.order(method), method.name
        if order is not None:
            theory = "varies" if method.order is None else f"theory {method.order:g}"
            name = f"{method.name}: order {order:.2f} ({theory})"
        yield Curve(steps, _errors(known), name, colour, "dot", mark, size=5.0, hover=texts)


def _runs(study: WorkPrecisionStudy, problem: str) -> Iterator[Content]:
    points = [point for method in _methods(study, problem) for point in study.of(method)]
    columns = {
        **fields("method = method.name; setting = known_setting; status; time = seconds 3"),
        **fields("steps; factorisations"),
        "largest error": lambda each: Cell(_power(each.error), each.error),
    }
    title = f"Wall times and errors of {PROBLEMS[problem]}"
    yield Table.of(title, points, columns, _scale_text(study, problem))
    notes = (f"{p.method.name}, {p.name}: {p.status} {p.note}" for p in points if p.note)
    yield from notes


def _power(value: float | None) -> str:
    return "–" if value is None else f"{value:.1e}"


def _scale_text(study: WorkPrecisionStudy, problem: str) -> str:
    """Return how the errors of a problem are measured."""
    found = study.problems[problem]
    text = "Largest error over time and outputs, over the step. Reference: "
    text += found.references[0] if found.references else "none, all failed"
    if len(found.references) > 1:
        text += f", checked by {found.references[1]}; the largest difference of the two is"
        text += f" {_power(found.floor)}"
    return f"{text}; step {quantity(found.amplitude, 'V')}."


def _cheapest(study: WorkPrecisionStudy) -> Table:
    rows = [(e, study.cheapest(e), study.cheapest(e, ["ngspice"])) for e in ERRORS]
    columns = {
        "largest error": lambda row: Cell(f"{row[0]:.0e}", row[0]),
        "cheapest": lambda row: _choice(row[1]),
        "time": lambda row: row[1] and SECONDS(row[1]),
        "ngspice": lambda row: _choice(row[2]),
        "time of ngspice": lambda row: row[2] and SECONDS(row[2]),
    }
    note = "Largest error over time on the board, as measured."
    return Table.of("Cheapest setting that reaches an error", rows, columns, note)


SECONDS = shown_by("seconds 3")


def _choice(point: SettingResult | None) -> str:
    if point is None:
        return "no run reached it"
    return f"{point.method.name}{f', {point.name}' if point.method.setting else ''}"


def _orders(study: WorkPrecisionStudy) -> Table:
    columns = {
        "method": lambda each: each.method.name,
        "fitted": lambda each: each.order and Cell(f"{each.order:.2f}", each.order),
        "theory": lambda each: each.method.theory,
    }
    shown = (each for each in study.ladders if each.method.setting)
    note = "Median slope of the largest error over time, against the mean step."
    return Table.of("Order of convergence", shown, columns, note)
