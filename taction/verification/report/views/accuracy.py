"""A work-precision study: error against run time and step, orders, cheapest settings."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from functools import partial

import numpy as np

from taction.system.charts import SERIES, Axis, Chart, Curve, Limit, Line, Mark
from taction.verification.report.blocks import (
    BOTH,
    DRAWN,
    Block,
    Cell,
    Notes,
    Page,
    Section,
    Shown,
    Table,
)
from taction.verification.report.texts import number_cell, quantity
from taction.verification.report.views.origin import origin_section
from taction.verification.studies.work_precision.methods import Method
from taction.verification.studies.work_precision.study import (
    ERRORS,
    Ladder,
    SettingResult,
    WorkPrecisionStudy,
)

PROBLEMS = {"board": "the whole board", "ideal": "the network with ideal op-amps"}
MARKS = ("circle", "square", "diamond", "triangle-down", "triangle-up", "star", "cross", "hexagon")
LINES: tuple[Line, ...] = ("solid", "dash", "dot", "dashdot")
LOWEST = 1e-15  # place of an error of exactly 0


def view(study: WorkPrecisionStudy) -> Page:
    """Return the page of a work-precision study."""
    sections = []
    for name in study.problems:
        title = f"Error against run time: {PROBLEMS[name]}"
        sections += [
            Section(title, partial(_charts, study, name), media=DRAWN),
            Section(f"Runs: {PROBLEMS[name]}", tuple(_runs(study, name)), media=BOTH),
        ]
    took = f"the study took {quantity(study.seconds, 's', 3)}"
    machine = [f"{k} {v}" for k, v in study.machine.items() if v is not None]
    return Page(
        title=study.scene.name,
        command="taction self accuracy",
        summary=_summary(study),
        lines=(study.extent.text,),
        sections=(
            *sections,
            Section("Order of convergence", (_orders(study),), media=BOTH),
            Section("Cheapest settings", (_cheapest(study),), media=BOTH),
            Section("Left out", (Notes("", study.omissions),), media=BOTH),
            origin_section(study.scene, (("the study took", quantity(study.seconds, "s", 3)),)),
        ),
        foot=("; ".join(filter(None, (", ".join(machine), took))),),
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
    return {
        method: (
            SERIES[k % len(SERIES)],
            MARKS[k % len(MARKS)],
            LINES[k // len(SERIES) % len(LINES)],
        )
        for k, method in enumerate(methods)
    }


def _known(study: WorkPrecisionStudy, method: Method) -> list[SettingResult]:
    """Return the runs of a method with a time and an error."""
    points = study.of(method)
    return [p for p in points if p.error is not None and p.seconds is not None]


def _charts(study: WorkPrecisionStudy, problem: str) -> Iterator[Block]:
    methods = _methods(study, problem)
    count = sum(len(_known(study, method)) for method in methods)
    if count < 2:
        text = f"{count or 'No'} run has a known error: there is nothing to compare."
        yield Notes("", (f"{text} A larger --budget gives more runs.",))
        return
    yield _work(study, problem)
    yield _steps(study, problem)


ERROR = Axis("largest error over time (of the step)", scale="log")


def _work(study: WorkPrecisionStudy, problem: str) -> Chart:
    """Return the errors over the run times; a bar goes from the fastest to the slowest run."""
    methods, late = _methods(study, problem), list[Curve]()
    marks: list[Mark] = []
    if floor := study.problems[problem].floor:
        marks.append(Limit(floor, "y", "error of the reference", "muted"))
    top = max((float(_errors(_known(study, m)).max(initial=1.0)) for m in methods), default=1.0)
    for method, (colour, mark, line) in methods.items():
        points = _known(study, method)
        times = np.array([(p.seconds, p.fastest, p.slowest) for p in points], dtype=np.float64)
        middle, *ends = times.reshape(-1, 3).T
        texts = tuple(f"{method.name} {p.name}: {_error_text(p)}" for p in points)
        marks.append(
            Curve(
                middle, _errors(points), method.name, colour, line, mark,
                width=1.2, hover=texts, spread=np.array(ends),
            )
        )  # fmt: skip
        for point in study.of(method):
            if point.status == "timeout" and point.seconds is not None:
                # At the upper edge, since the error of this run has no bound.
                text = f"timed out at {point.name}"
                late.append(
                    Curve(
                        np.array([point.seconds]), np.array([top]), text, colour, "", "x",
                        size=9.0, label="", hover=(text,), written=() if late else ("timed out",),
                    )
                )  # fmt: skip
    return Chart(
        f"Runs by time and error, {PROBLEMS[problem]}",
        Axis("wall time, median", "s", "log"),
        ERROR,
        (*marks, *late),
        message=_best(study, problem),
        summary=(
            "Each mark is one setting of a method: further left is faster, further down is more"
            " accurate. A bar ends at the fastest and the slowest run. The dashed line is the error"
            " of the reference; a cross at the upper edge is a run that timed out."
        ),
        height=460,
    )


def _errors(points: list[SettingResult]) -> np.ndarray:
    return np.array([max(p.error or 0.0, LOWEST) for p in points], dtype=np.float64)


def _error_text(point: SettingResult) -> str:
    return f"error {point.error:.2e} in {quantity(point.seconds, 's', 3)}"


def _best(study: WorkPrecisionStudy, problem: str) -> str:
    """Return the most accurate run in words."""
    runs = [p for method in _methods(study, problem) for p in _known(study, method)]
    if len(runs) < 2:
        return "only one run was measured: no trend" if runs else "no run was measured"
    best = min(runs, key=lambda p: (p.error or 0.0, p.seconds or 0.0))
    text = f"the most accurate is {best.method.name}, {best.error:.1e}"
    return f"{text} in {quantity(best.seconds, 's', 3)}"


def _steps(study: WorkPrecisionStudy, problem: str) -> Chart:
    """Return the errors over the mean steps; the order is fitted to the filled marks."""
    periods = problem == "board"
    unit = study.extent.period if periods else 1.0
    marks: list[Mark] = []
    orders: dict[float, str] = {}
    for method, (colour, shape, _) in _methods(study, problem).items():
        points, order = study.of(method), study.order(method)
        for fitted in (True, False):
            shown = [
                p
                for place, p in enumerate(points)
                if (place in order.points) is fitted
                and p.error is not None
                and p.mean_step is not None
            ]
            steps = np.array([p.mean_step for p in shown], dtype=np.float64) / unit
            mark = shape if fitted else _open(shape)
            texts = tuple(f"{method.name} {p.name}: {p.error:.2e}" for p in shown)
            marks.append(
                Curve(
                    steps, _errors(shown), method.name, colour, "", mark, size=5.0,
                    label="", hover=texts,
                )
            )  # fmt: skip
        if order.value is not None and order.constant is not None:
            ends = np.array([points[order.points[k]].mean_step for k in (0, -1)], dtype=np.float64)
            name = f"{method.name}: order {order.value:.2f}"
            name += f" (theory {method.order:g})" if method.order is not None else " (varies)"
            fit = order.constant * ends**order.value
            marks.append(Curve(ends / unit, fit, name, colour, "dot", width=1.4))
            orders[order.value] = method.name
    return Chart(
        f"Error against the mean step, {PROBLEMS[problem]}",
        Axis("mean step (periods of the fastest ringing)", "", "log")
        if periods
        else Axis("mean step", "s", "log"),
        ERROR,
        tuple(marks),
        message=f"{orders[max(orders)]} has the largest order, {max(orders):.3g}" if orders else "",
        summary=(
            "The order of convergence is fitted to the filled marks; the dotted lines show the"
            " fits."
        ),
        height=460,
    )


def _open(mark: str) -> str:
    """Return the mark without its filling."""
    return {"star": "star-open", "hexagon": "hexagon-open"}.get(mark, f"{mark}-open")


def _runs(study: WorkPrecisionStudy, problem: str) -> Iterator[Block]:
    points = [point for method in _methods(study, problem) for point in study.of(method)]
    columns: dict[str, Callable[[SettingResult], Shown]] = {
        "method": lambda each: each.method.name,
        "setting": lambda each: Cell(
            f"{each.setting:g}" if each.method.setting else "–", each.setting
        ),
        "status": lambda each: each.status,
        "time": lambda each: number_cell(each.seconds, "s", 3),
        "fastest": lambda each: number_cell(each.fastest, "s", 3),
        "slowest": lambda each: number_cell(each.slowest, "s", 3),
        "runs": lambda each: each.repeats,
        "steps": lambda each: each.steps,
        "factorisations": lambda each: each.factorisations,
        "largest error": lambda each: Cell(_power(each.error), each.error),
    }
    title = f"Wall times and errors of {PROBLEMS[problem]}"
    yield Table.of(title, points, columns, _scale_text(study, problem))
    notes = (f"{p.method.name}, {p.name}: {p.status} {p.note}" for p in points if p.note)
    yield Notes("", tuple(notes))


def _power(value: float | None) -> str:
    return "–" if value is None else f"{value:.1e}"


def _scale_text(study: WorkPrecisionStudy, problem: str) -> str:
    """Return how the errors of a problem are measured."""
    found = study.problems[problem]
    text = f"Largest error over time and outputs, over the step. Reference: {found.references[0]}"
    if len(found.references) > 1:
        text += f", checked by {found.references[1]}; the largest difference of the two is"
        text += f" {_power(found.floor)}"
    return f"{text}; step {quantity(found.amplitude, 'V')}."


def _cheapest(study: WorkPrecisionStudy) -> Table:
    of_all = {error: _choice(study.cheapest(error)) for error in ERRORS}
    of_ngspice = {error: _choice(study.cheapest(error, ["ngspice"])) for error in ERRORS}
    columns: dict[str, Callable[[float], Shown]] = {
        "largest error": lambda error: Cell(f"{error:.0e}", error),
        "cheapest": lambda error: of_all[error][0],
        "time": lambda error: of_all[error][1],
        "ngspice": lambda error: of_ngspice[error][0],
        "time of ngspice": lambda error: of_ngspice[error][1],
    }
    note = "Largest error over time on the board, as measured."
    return Table.of("Cheapest setting that reaches an error", ERRORS, columns, note)


def _choice(point: SettingResult | None) -> tuple[Cell, Cell]:
    if point is None:
        return Cell("no run reached it"), Cell("–")
    setting = f", {point.name}" if point.method.setting else ""
    return Cell(f"{point.method.name}{setting}"), number_cell(point.seconds, "s", 3)


def _orders(study: WorkPrecisionStudy) -> Table:
    columns: dict[str, Callable[[Ladder], Shown]] = {
        "method": lambda each: each.method.name,
        "fitted": _fitted,
        "theory": lambda each: each.method.theory,
        "from settings": lambda each: ", ".join(f"{s:g}" for s in each.fitted) or None,
    }
    shown = (each for each in study.ladders if each.method.setting)
    note = "Of the largest error over time, against the mean step."
    return Table.of("Order of convergence", shown, columns, note)


def _fitted(ladder: Ladder) -> Cell | None:
    order = ladder.order
    if order.value is None:
        return None
    return Cell(f"{order.value:.2f} ± {order.sigma or 0.0:.2f}", order.value)
