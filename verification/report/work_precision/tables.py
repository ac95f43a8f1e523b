"""A work-precision study as JSON and as tables."""

from __future__ import annotations

import math
from typing import Any

from rich.box import SIMPLE_HEAD
from rich.console import Console
from rich.markup import escape
from rich.table import Table

from netlist_gen.quantities import show
from verification.studies.work_precision.convergence_order import Order
from verification.studies.work_precision.methods import Method
from verification.studies.work_precision.norms import NORMS
from verification.studies.work_precision.run_errors import ProblemErrors
from verification.studies.work_precision.study import WANTED, SettingResult, Study

TITLES = {
    "final": "final",
    "maximum": "maximum",
    "settling_time": "settling",
    "frequency": "frequency",
    "growth_rate": "growth",
}
PROBLEMS = {"board": "the whole board", "ideal": "the network with ideal op-amps"}


def accuracy_document(study: Study) -> dict[str, Any]:
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
        "problems": {name: _problem(found) for name, found in study.problems.items()},
        "methods": [_method(study, method) for method in methods],
        "cheapest": [_cheapest(study, error) for error in WANTED],
        "omissions": list(study.omissions),
        "machine": study.machine,
        "seconds": study.seconds,
    }


def _problem(found: ProblemErrors) -> dict[str, Any]:
    scale = found.scale
    return {
        "references": list(found.references),
        "reference_error": found.floor,
        "step_amplitude": None if scale is None else scale.amplitude,
        "settling_band": None if scale is None else scale.band,
        "settling_time": None if scale is None else scale.settling_time,
        "ringing": None if scale is None or scale.ringing is None else scale.ringing,
    }


def _method(study: Study, method: Method) -> dict[str, Any]:
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
    """Return one setting as plain data."""
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


def _cheapest(study: Study, error: float) -> dict[str, Any]:
    found = {"any": study.cheapest(error), "ngspice": study.cheapest(error, engines=["ngspice"])}
    return {"error": error} | {
        name: None
        if point is None
        else {
            "method": point.method.name,
            "setting": point.setting if point.method.setting else None,
            "seconds": point.seconds,
            "achieved": point.errors["maximum"],
        }
        for name, point in found.items()
    }


def print_study(study: Study, console: Console) -> None:
    """Print the points, the orders, the cheapest settings, and what was left out."""
    console.print(f"[bold]{escape(study.scene.name)}[/bold]: error against run time")
    console.print(f"board: {study.extent.text}")
    for problem, found in study.problems.items():
        console.print(_points(study, problem))
        console.print(_scale_text(found), style="dim")
        for point in _of(study, problem):
            if point.note:
                what = f"{point.method.name}, {point.name}: {point.status}"
                console.print(f"[yellow]{what}[/yellow] {escape(point.note)}")
    console.print(_orders(study))
    console.print(_cheapest_table(study))
    for omission in study.omissions:
        console.print(f"[yellow]left out[/yellow] {escape(omission)}")
    facts = ", ".join(f"{k} {v}" for k, v in study.machine.items() if v is not None)
    console.print(f"{facts}; the study took {study.seconds:.3g} s", style="dim")


def _points(study: Study, problem: str) -> Table:
    norms = [n for n in NORMS if any(p.errors[n] is not None for p in _of(study, problem))]
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
    table = Table("method", box=SIMPLE_HEAD, pad_edge=False, collapse_padding=True)
    for title in titles:
        table.add_column(title, justify="right", no_wrap=True)
    before = ""
    for point in _of(study, problem):
        name = point.method.name
        table.add_row(
            name if name != before else "",
            f"{point.setting:g}" if point.method.setting else "-",
            *(_seconds(x) for x in (point.seconds, point.fastest, point.slowest)),
            str(point.repeats),
            _count(point.steps),
            _count(point.factorisations),
            *_errors(point, norms),
        )
        before = name
    table.title = f"{PROBLEMS[problem]}: wall time and errors"
    table.title_justify = "left"
    return table


def _of(study: Study, problem: str) -> list[SettingResult]:
    return [point for point in study.points if point.method.problem == problem]


def _errors(point: SettingResult, norms: list[str]) -> list[str]:
    if point.status != "done":
        return [point.status, *([""] * (len(norms) - 1))]
    return [_error(point.errors[norm]) for norm in norms]


def _error(value: float | None) -> str:
    return "-" if value is None else f"{value:.1e}"


def _seconds(value: float | None) -> str:
    return "-" if value is None else show(value, "s", 3)


def _count(value: int | None) -> str:
    return "-" if value is None else str(value)


def _scale_text(found: ProblemErrors) -> str:
    scale = found.scale
    if scale is None:
        return "no reference"
    settling = "not reached" if scale.settling_time is None else show(scale.settling_time, "s")
    text = f"reference: {found.references[0]}"
    if len(found.references) > 1:
        text += f"; {found.references[1]} judges that one, they differ by"
        text += f" {_error(found.floor['maximum'])} at the most"
    return f"{text}; step {show(scale.amplitude, 'V')}; ±{100 * scale.band:g} % at {settling}"


def _orders(study: Study) -> Table:
    table = Table(
        "order of convergence", "fitted", "theory", "from settings", "left out", box=SIMPLE_HEAD
    )
    for name, order in study.orders.items():
        points = [point for point in study.points if point.method.name == name]
        if points and points[0].method.setting:
            method = points[0].method
            table.add_row(
                name,
                _order(order),
                method.theory,
                ", ".join(f"{points[place].setting:g}" for place in order.points) or "-",
                order.reason,
            )
    table.caption = "of the largest error over time, against the mean step"
    table.caption_justify = "left"
    return table


def _order(order: Order) -> str:
    if order.value is None or order.sigma is None:
        return "-"
    return f"{order.value:.2f} ± {order.sigma:.2f}"


def _cheapest_table(study: Study) -> Table:
    table = Table(
        "wanted error", "cheapest", "time", "ngspice", "time", box=SIMPLE_HEAD, pad_edge=False
    )
    for error in WANTED:
        any_, ngspice = study.cheapest(error), study.cheapest(error, engines=["ngspice"])
        table.add_row(f"{error:.0e}", *_choice(any_), *_choice(ngspice))
    table.caption = "largest error over time on the board, as measured"
    table.caption_justify = "left"
    return table


def _choice(point: SettingResult | None) -> tuple[str, str]:
    if point is None or point.seconds is None or not math.isfinite(point.seconds):
        return "none that was run", "-"
    setting = f", {point.name}" if point.method.setting else ""
    return f"{point.method.name}{setting}", show(point.seconds, "s", 3)
