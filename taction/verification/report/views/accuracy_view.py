"""A work-precision study: error against run time and step, orders, cheapest settings."""

from __future__ import annotations

import itertools
from collections.abc import Iterator
from functools import partial

import numpy as np

from taction.system.charts import SERIES, Axis, Chart, Curve, Limit, Line, Mark
from taction.system.quantities import quantity
from taction.verification.report.blocks import Content, Notes, Page, Section, Table
from taction.verification.report.texts import Cell, Column, fields, shown_by
from taction.verification.report.views.origin_view import origin_section
from taction.verification.studies.work_precision.methods import Method
from taction.verification.studies.work_precision.study import (
    ERRORS,
    SettingResult,
    WorkPrecisionStudy,
)

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
    return Page(
        title=study.scene.name,
        command="taction self accuracy",
        summary=_summary(study),
        lines=(study.stretch,),
        sections=(
            Section("Error against run time", partial(_charts, study), media="page picture"),
            Section("Runs", tuple(_runs(study)), media="terminal page"),
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
    step = Axis("mean step (periods of the fastest ringing)", "", "log")
    yield Chart("Error against the mean step", step, ERROR, tuple(_steps(study)), STEPS)


def _work(study: WorkPrecisionStudy) -> Iterator[Mark]:
    """Yield the errors over the median run times."""
    if study.floor:
        yield Limit(study.floor, "y", "error of the reference", "muted")
    top = 1.0
    for method, (colour, mark, line) in _methods(study).items():
        points = _known(study, method, "seconds")
        times = np.array([p.seconds for p in points], dtype=np.float64)
        hover = tuple(
            f"{method.name} {p.name}: error {p.error:.1e} in {quantity(p.seconds, 's', 3)}"
            for p in points
        )
        errors = _errors(points)
        top = float(errors.max(initial=top))
        yield Curve(times, errors, method.name, colour, line, mark, width=1.2, hover=hover)
    for point in study.points:  # at the upper edge, since the error of this run has no bound
        if point.status == "timeout" and point.seconds is not None:
            look, text = _methods(study)[point.method][0], f"timed out at {point.name}"
            place = np.array([point.seconds]), np.array([top])
            yield Curve(*place, text, look, "", "x", size=9.0, label="", hover=(text,))


def _errors(points: list[SettingResult]) -> np.ndarray:
    return np.array([max(p.error or 0.0, LOWEST) for p in points], dtype=np.float64)


def _steps(study: WorkPrecisionStudy) -> Iterator[Mark]:
    """Yield the errors over the mean steps in periods, with the orders of convergence."""
    for method, (colour, mark, _) in _methods(study).items():
        known = _known(study, method, "mean_step")
        steps = np.array([p.mean_step for p in known], dtype=np.float64) / study.period
        hover = tuple(f"{method.name} {p.name}: {p.error:.2e}" for p in known)
        order, name = study.order(method), method.name
        if order is not None:
            theory = "varies" if method.order is None else f"theory {method.order:g}"
            name = f"{method.name}: order {order:.2f} ({theory})"
        yield Curve(steps, _errors(known), name, colour, "dot", mark, size=5.0, hover=hover)


def _runs(study: WorkPrecisionStudy) -> Iterator[Content]:
    points = [point for method in _methods(study) for point in study.of(method)]
    columns = {
        **fields("method = method.name; setting = known_setting; status; time = seconds 3"),
        **fields("steps; factorisations"),
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


def _orders(study: WorkPrecisionStudy) -> Table:
    columns: dict[str, Column] = {
        "method": "method.name",
        "fitted": lambda each: each.order and Cell(f"{each.order:.2f}", each.order),
        "theory": "method.theory",
    }
    shown = (each for each in study.ladders if each.method.setting)
    note = "Median slope of the largest error over time, against the mean step."
    return Table.of("Order of convergence", shown, columns, note)
