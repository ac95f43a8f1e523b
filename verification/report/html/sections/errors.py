"""Recovered stress beside the truth, the error budget, and what the run's accuracy cost."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from verification.report.html.blocks import Cell, Facts, Notes, Picture, Section, Table, View
from verification.report.html.pictures import HATCH, axis, line, numbers
from verification.report.html.texts import figure, number_cell, percent, quantity, readable
from verification.report.tables import spaced
from verification.verify import Verdict

ROUNDING = 16.0 * float(np.finfo(np.float64).eps)  # of the step: a smaller part is rounding
FEW = 20  # channels with a number each
SEEN = 20.0  # times the reference: a larger end of the record is off the picture


def stress_section(verdict: Verdict) -> Section:
    """Return the recovered stress beside the regularised optimum and the true stress."""
    problem, U0 = verdict.problem, verdict.circuit.scalings.unit_voltage
    channels = verdict.measurements.channels
    if problem.positions is None:
        where, title = np.arange(1.0, len(channels) + 1), "channel"
    else:
        where = problem.positions / getattr(verdict.scene.problem, "depth", 1.0)
        title = "place y (in depths)"
    optimum = np.array([c.target for c in channels]) / U0
    curves = [
        ("regularised optimum", optimum, "lines+markers", "--pass", "square-open", "dash"),
        ("board at rest", verdict.steady.values / U0, "markers", "--ink", "cross-thin-open", ""),
    ]
    final, text = np.array([c.final for c in channels]) / U0, ""
    if np.abs(final).max() < SEEN * (np.abs(optimum).max() + 1e-300):
        curves.append(("board, end of record", final, "markers", "--fail", "x-thin-open", ""))
    else:
        text = " The end of the record is far off this picture."
    if problem.stress is not None:
        true = ("true stress", problem.stress, "lines+markers", "--true", "circle", "solid")
        curves.insert(0, true)
    data = [
        {"type": "scatter", "mode": mode, "name": name, "x": numbers(where), "y": numbers(values),
         "line": {"color": colour, "dash": dash or "solid"},
         "marker": {"symbol": symbol, "size": 10, "color": colour, "line": {"width": 2}},
         "hovertemplate": f"{name}: %{{y:.5g}} at %{{x:.4g}}<extra></extra>"}
        for name, values, mode, colour, symbol, dash in curves
    ]  # fmt: skip
    ticks: dict[str, Any] = (
        {"dtick": 1} if problem.positions is None and len(channels) <= FEW else {}
    )
    layout = {"xaxis": axis(title, **ticks), "yaxis": axis("stress"), "hovermode": "closest"}
    summary = f"Stress by channel: {', '.join(curve[0] for curve in curves)}.{text}"
    picture = Picture(
        "Stress by channel", {"data": data, "layout": layout}, summary, 340, zoom=False
    )
    return Section("Recovered stress", (picture,))


def budget_section(document: Mapping[str, Any]) -> Section:
    """Return the error budget as a waterfall of one channel and as a table."""
    parts: Mapping[str, Mapping[str, Any]] = document["error_budget"]
    amplitude = document["step_amplitude"] or 0.0
    if not parts:
        return Section("Error budget", ())
    total = parts.get("total")
    worst = None if total is None else int(np.argmax(np.abs(total["channels"])))
    signed = () if worst is None else (f"channel {worst + 1}",)
    rows = tuple(
        (
            Cell(spaced(name)),
            _volts(part["value"], amplitude),
            _share(part["value"], amplitude),
            *(() if worst is None else (_signed(part["channels"], worst, amplitude),)),
            Cell(readable(part["how"])),
        )
        for name, part in parts.items()
    )
    titles = ("error", "largest of any channel", "of the step", *signed, "how it was found")
    table = Table("Parts of the error", titles, rows)
    if total is None or worst is None:
        text = "The parts do not add up: a solution between them is not known."
        return Section("Error budget", (Notes("", (text,)), table))
    lead = "From one solution to the next; the parts of a channel add up to its whole error."
    return Section("Error budget", (_waterfall(parts, worst), table), lead)


def _signed(channels: Sequence[float], place: int, amplitude: float) -> Cell:
    return _volts(channels[place], amplitude) if channels else Cell("–")


def _is_known(value: float | None) -> bool:
    return value is not None and math.isfinite(value)


def _volts(value: float | None, amplitude: float) -> Cell:
    if value is None or not math.isfinite(value):
        return Cell("unknown")
    if abs(value) <= ROUNDING * amplitude:
        return Cell("below rounding", value)
    return number_cell(value, "V", 3)


def _share(value: float | None, amplitude: float) -> Cell:
    if value is None or not math.isfinite(value) or abs(value) <= ROUNDING * amplitude:
        return Cell("–")
    return Cell(f"{100 * value / amplitude:.2g} %" if amplitude else "–", value)


def _waterfall(parts: Mapping[str, Mapping[str, Any]], worst: int) -> Picture:
    """Return the signed parts of a channel, each from the sum of those before."""
    links = {n: p["channels"][worst] for n, p in parts.items() if p["channels"] and n != "total"}
    whole = parts["total"]["channels"][worst]
    steps = list(links.values())
    ends = np.cumsum([0.0, *steps]).tolist()
    falls = [step < 0.0 for step in steps]
    data = [
        {"type": "bar", "x": [*map(spaced, links), "total"], "y": [*steps, whole],
         "base": [*ends[:-1], 0.0], "textposition": "outside", "cliponaxis": False,
         "text": [quantity(step, "V", 3) for step in (*steps, whole)],
         "marker": {
             "color": [*("--fail-fill" if fall else "--pass" for fall in falls), "--band"],
             "pattern": HATCH | {"shape": [*("/" if fall else "" for fall in falls), ""]}},
         "hovertemplate": "%{x}: %{text}<extra></extra>"}
    ]  # fmt: skip
    layout = {
        "xaxis": axis(""),
        "yaxis": axis("error", "V"),
        "shapes": [line(None, 0.0)],
        "showlegend": False,
        "margin": {"l": 64, "r": 14, "t": 24, "b": 44},
    }
    unknown = [spaced(n) for n, p in parts.items() if not _is_known(p["value"]) and n != "total"]
    summary = (
        f"Channel {worst + 1}, which has the largest whole error, {quantity(whole, 'V', 3)}."
        " Solid blue bars raise the output, hatched orange bars lower it."
        + f" Not known: {', '.join(unknown)}."
        * bool(unknown)
    )
    picture = {"data": data, "layout": layout}
    return Picture("Waterfall", picture, summary, 340, _steps_views(ends, whole), zoom=False)


def _steps_views(ends: Sequence[float], whole: float) -> tuple[View, ...]:
    """Return the whole waterfall, and one from which the largest part is left out."""
    sizes = np.abs(np.diff(ends))
    if len(sizes) < 2:
        return ()
    everything = View("every part", {"yaxis.range": _around([0.0, whole, *ends])})
    large = int(np.argmax(sizes))
    if large not in (0, len(sizes) - 1):
        return (everything,)
    rest = ends[1:] if large == 0 else ends[:-1]
    return everything, View("without the largest part", {"yaxis.range": _around(rest)})


def _around(values: Sequence[float]) -> list[float]:
    low, high = min(values), max(values)
    room = 0.15 * ((high - low) or abs(high) or 1.0)
    return [low - room, high + room]


def effort_section(document: Mapping[str, Any]) -> Section:
    """Return the requested and the reached error of the run, and its cost."""
    accuracy, run = document["accuracy"], document["simulation"]
    reached = accuracy["achieved"]
    certificate = document["certificate"]
    rows = (
        ("requested error", f"{percent(accuracy['wanted'])} of the step"),
        ("reached error", "unknown" if reached is None else f"{percent(reached)} of the step"),
        ("how it is known", accuracy["how"]),
        ("simulation", quantity(accuracy["seconds"], "s", 3)),
        ("points", f"{accuracy['points']} to {quantity(run['stop'], 's')}"),
        ("largest step", quantity(run["max_step"], "s", 3)),
        ("tries", str(accuracy["tries"])),
        (
            "reference",
            f"{certificate['kind']} {certificate['value']:.2g}, bound {certificate['bound']:.2g}",
        ),
        ("the ideal network settles in", quantity(document["settling_time_ideal"], "s")),
    )
    stages = {k: v for k, v in document["timing"].items() if k != "total"}
    data = [{
        "type": "bar", "orientation": "h", "x": list(stages.values()), "y": list(stages),
        "marker": {"color": "--pass"}, "text": [figure(v, "s", 3) for v in stages.values()],
        "textposition": "outside", "cliponaxis": False,
        "hovertemplate": "%{y}: %{text}<extra></extra>",
    }]  # fmt: skip
    layout = {
        "xaxis": axis("time", "s"),
        "yaxis": {"autorange": "reversed"},
        "margin": {"l": 90, "r": 60, "t": 8, "b": 44},
    }
    total = figure(document["timing"]["total"], "s", 3)
    summary = f"Run time by stage; {total} in all. The simulation runs beside the reference."
    picture = Picture("Run time", {"data": data, "layout": layout}, summary, 260, zoom=False)
    return Section("Error and run time", (Facts("", rows), picture))
