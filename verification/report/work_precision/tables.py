"""A work-precision study as JSON and as tables."""

from __future__ import annotations

import math
from typing import Any

from rich.console import Console
from rich.markup import escape
from rich.table import Column

from taction.system.quantities import show
from taction.verification.report.fitted_table import FittedTable
from taction.verification.report.tables import make_table, value_text
from taction.verification.studies.work_precision.convergence_order import Order
from taction.verification.studies.work_precision.methods import Method
from taction.verification.studies.work_precision.norms import NORMS
from taction.verification.studies.work_precision.run_errors import ProblemErrors
from taction.verification.studies.work_precision.study import (
    ERRORS,
    SettingResult,
    WorkPrecisionStudy,
)

TITLES = {
    "final": "final",
    "maximum": "maximum",
    "settling_time": "settling",
    "frequency": "frequency",
    "growth_rate": "growth",
}
PROBLEMS = {"board": "the whole board", "ideal": "the network with ideal op-amps"}


def accuracy_document(study: WorkPrecisionStudy) -> dict[str, Any]:
    """Return `study` as plain data, SI base units; errors are fractions, None where unknown."""
    transient = study.extent.transient
    pole = study.extent.pole
    methods = list(dict.fromkeys(point.method for point in study.points))
    return {
        "scene": study.scene.name,
        "file": str(study.scene.file),
        "stop": transient.stop,
        "whole_stop": study.extent.whole,
        "stretch": study.extent.text,
        "period": study.extent.period,
        "pole": None if pole is None else [pole.real, pole.imag],
        "norms": list(NORMS),
        "problems": {name: _problem(errors) for name, errors in study.problems.items()},
        "methods": [_method(study, method) for method in methods],
        "cheapest": [_cheapest(study, error) for error in ERRORS],
        "omissions": list(study.omissions),
        "machine": study.machine,
        "seconds": study.seconds,
    }


def _problem(errors: ProblemErrors) -> dict[str, Any]:
    scale = errors.scale
    return {
        "references": list(errors.references),
        "reference_error": errors.floor,
        "step_amplitude": None if scale is None else scale.amplitude,
        "settling_band": None if scale is None else scale.band,
        "settling_time": None if scale is None else scale.settling_time,
        "ringing": None if scale is None else scale.ringing,
    }


def _method(study: WorkPrecisionStudy, method: Method) -> dict[str, Any]:
    order = study.orders[method.name]
    return {
        "name": method.name,
        "engine": method.engine,
        "problem": method.problem,
        "setting": method.setting,
        "order": order.value,
        "order_uncertainty": order.sigma,
        "order_theory": method.order,
        "order_theory_says": method.theory,
        "order_points": [study.of(method)[place].setting for place in order.points],
        "order_reason": order.reason,
        "points": [point_record(point) for point in study.of(method)],
    }


def point_record(point: SettingResult) -> dict[str, Any]:
    """Return the result of one setting as plain data."""
    return {
        "setting": point.setting if point.method.setting else None,
        "status": point.status,
        "seconds": point.seconds,
        "seconds_fastest": point.fastest,
        "seconds_slowest": point.slowest,
        "repeats": point.repeats,
        "steps": point.steps,
        "factorisations": point.factorisations,
        "mean_step": point.mean_step,
        "errors": dict(point.errors),
        "reference": point.reference,
        "note": point.note,
    }


def _cheapest(study: WorkPrecisionStudy, error: float) -> dict[str, Any]:
    document: dict[str, Any] = {"error": error, "any": None, "ngspice": None}
    for name, engines in (("any", None), ("ngspice", ["ngspice"])):
        if point := study.cheapest(error, engines=engines):
            document[name] = {
                "method": point.method.name,
                "setting": point.setting if point.method.setting else None,
                "seconds": point.seconds,
                "achieved": point.errors["maximum"],
            }
    return document


def print_study(study: WorkPrecisionStudy, console: Console) -> None:
    """Print the points, the orders, the cheapest settings and the omissions."""
    console.print(f"[bold]{escape(study.scene.name)}[/bold]: error against run time")
    console.print(f"board: {study.extent.text}")
    for problem, errors in study.problems.items():
        console.print(_points(study, problem))
        console.print(_scale_text(errors), style="dim")
        for point in _of(study, problem):
            if point.note:
                run = f"{point.method.name}, {point.name}: {point.status}"
                console.print(f"[yellow]{run}[/yellow] {escape(point.note)}")
    console.print(_orders(study))
    console.print(_cheapest_table(study))
    for omission in study.omissions:
        console.print(f"[yellow]left out[/yellow] {escape(omission)}")
    facts = ", ".join(f"{k} {v}" for k, v in study.machine.items() if v is not None)
    console.print(f"{facts}; the study took {study.seconds:.3g} s", style="dim")


def _points(study: WorkPrecisionStudy, problem: str) -> FittedTable:
    points = _of(study, problem)
    norms = [n for n in NORMS if any(p.errors[n] is not None for p in points)]
    titles = (
        "setting",
        "time",
        "from",
        "to",
        "runs",
        "steps",
        "fact.",
        *(TITLES[n] for n in norms),
    )
    columns = [Column(title, justify="right", no_wrap=True) for title in titles]
    rows = [
        (
            point.method.name if before is None or before.method != point.method else "",
            f"{point.setting:g}" if point.method.setting else "-",
            *(value_text(x, "s", 3) for x in (point.seconds, point.fastest, point.slowest)),
            *(value_text(n, "") for n in (point.repeats, point.steps, point.factorisations)),
            *_errors(point, norms),
        )
        for before, point in zip((None, *points), points, strict=False)
    ]
    title = f"{PROBLEMS[problem]}: wall time and errors"
    return make_table(["method", *columns], rows, title=title, collapse_padding=True)


def _of(study: WorkPrecisionStudy, problem: str) -> list[SettingResult]:
    return [point for point in study.points if point.method.problem == problem]


def _errors(point: SettingResult, norms: list[str]) -> list[str]:
    if point.status != "done":
        return [point.status, *([""] * (len(norms) - 1))]
    return [_error(point.errors[norm]) for norm in norms]


def _error(value: float | None) -> str:
    return "-" if value is None else f"{value:.1e}"


def _scale_text(errors: ProblemErrors) -> str:
    scale = errors.scale
    if scale is None:
        return "no reference"
    settling = "not reached" if scale.settling_time is None else show(scale.settling_time, "s")
    text = f"reference: {errors.references[0]}"
    if len(errors.references) > 1:
        text += f", checked by {errors.references[1]}; the largest difference of the two is"
        text += f" {_error(errors.floor['maximum'])}"
    return f"{text}; step {show(scale.amplitude, 'V')}; ±{100 * scale.band:g} % at {settling}"


def _orders(study: WorkPrecisionStudy) -> FittedTable:
    rows = []
    for name, order in study.orders.items():
        points = [point for point in study.points if point.method.name == name]
        if points and points[0].method.setting:
            settings = ", ".join(f"{points[place].setting:g}" for place in order.points) or "-"
            rows.append((name, _order(order), points[0].method.theory, settings, order.reason))
    titles = ("order of convergence", "fitted", "theory", "from settings", "left out")
    return make_table(titles, rows, caption="of the largest error over time, against the mean step")


def _order(order: Order) -> str:
    if order.value is None or order.sigma is None:
        return "-"
    return f"{order.value:.2f} ± {order.sigma:.2f}"


def _cheapest_table(study: WorkPrecisionStudy) -> FittedTable:
    rows = [
        (
            f"{error:.0e}",
            *_choice(study.cheapest(error)),
            *_choice(study.cheapest(error, engines=["ngspice"])),
        )
        for error in ERRORS
    ]
    titles = ("largest error", "cheapest", "time", "ngspice", "time")
    return make_table(titles, rows, caption="largest error over time on the board, as measured")


def _choice(point: SettingResult | None) -> tuple[str, str]:
    if point is None or point.seconds is None or not math.isfinite(point.seconds):
        return "no run reached it", "-"
    setting = f", {point.name}" if point.method.setting else ""
    return f"{point.method.name}{setting}", show(point.seconds, "s", 3)
