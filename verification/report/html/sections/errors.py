"""Recovered stress beside the truth, the error budget, and what the run's accuracy cost."""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import Any

import numpy as np

from verification.report.html.blocks import Block, Facts, Notes, Picture, Section, Table
from verification.report.html.pictures import axis, label, line, numbers
from verification.report.html.texts import Cell, figure, number_cell, percent, quantity
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
    ticks = {"dtick": 1} if problem.positions is None and len(channels) <= FEW else {}
    layout = {"xaxis": axis(title, **ticks), "yaxis": axis("stress"), "hovermode": "closest"}
    summary = f"Stress by channel: {', '.join(curve[0] for curve in curves)}.{text}"
    return Section(
        "Recovered stress",
        (Picture("", {"data": data, "layout": layout}, summary, 340, zoom=False),),
    )


def budget_section(document: Mapping[str, Any]) -> Section:
    """Return the error budget as a waterfall and as a table."""
    parts: Mapping[str, Mapping[str, Any]] = document["error_budget"]
    amplitude = document["step_amplitude"] or 0.0
    if not parts:
        return Section("Error budget", ())
    rows = tuple(
        (
            Cell(spaced(name)),
            _volts(part["value"], amplitude),
            _share(part["value"], amplitude),
            Cell(part["how"]),
        )
        for name, part in parts.items()
    )
    table = Table(
        "Parts of the error", ("error", "largest", "of the step", "how it was found"), rows
    )
    lead = "Each part is measured by itself: the largest deviation of any channel."
    return Section("Error budget", (_waterfall(document, amplitude), table), lead)


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


def _waterfall(document: Mapping[str, Any], amplitude: float) -> Block:
    """Return the parts, the smallest first, each on top of the sum of those before."""
    least = ROUNDING * amplitude
    known = [
        (name, part["value"])
        for name, part in document["error_budget"].items()
        if _is_known(part["value"]) and part["value"] > least
    ]
    if not known:
        return Notes("", ("No part of the error is above rounding.",))
    known.sort(key=lambda pair: pair[1])
    sums = np.cumsum([value for _, value in known])
    floor = 10.0 ** math.floor(math.log10(known[0][1]) - 0.3)
    names = [spaced(name) for name, _ in known]
    bases = [floor, *sums[:-1].tolist()]
    tops = [max(float(top - base), 0.0) for top, base in zip(sums, bases, strict=True)]
    common = {"type": "bar", "orientation": "v"}
    texts = [quantity(value, "V", 3) for _, value in known]
    data = [
        {**common, "x": names, "y": tops, "base": bases, "text": texts, "textposition": "outside",
         "marker": {"color": "--pass"}, "cliponaxis": False,
         "hovertemplate": "%{x}: %{text}<extra></extra>"},
        {**common, "x": ["sum"], "y": [float(sums[-1]) - floor], "base": [floor],
         "text": [quantity(float(sums[-1]), "V", 3)], "textposition": "outside",
         "marker": {"color": "--band", "pattern": {"shape": "/", "fgcolor": "--muted"}},
         "cliponaxis": False, "hovertemplate": "sum: %{text}<extra></extra>"},
    ]  # fmt: skip
    top = math.log10(float(sums[-1])) + 0.5
    unknown = [spaced(k) for k, p in document["error_budget"].items() if not _is_known(p["value"])]
    meaning = "bounds the difference of the simulated outputs and the true stress"
    if unknown:
        meaning = f"is their sum; not known, and not in it: {', '.join(unknown)}"
    layout: dict[str, Any] = {
        "xaxis": axis(""),
        "yaxis": axis("error", "V", type="log", range=[math.log10(floor), top], dtick=1),
        "showlegend": False,
        "margin": {"l": 64, "r": 14, "t": 24, "b": 44},
    }
    if amplitude:
        layout["shapes"] = [line(None, amplitude, "--muted", dash="dash")]
        layout["annotations"] = [
            label(
                "step", 0.005, math.log10(amplitude), xref="paper", xanchor="left", yanchor="bottom"
            )
        ]
    summary = (
        "Waterfall on a logarithmic scale: the parts that are above rounding, the smallest first,"
        f" each on top of the sum of the others. {quantity(float(sums[-1]), 'V', 3)} {meaning}."
    )
    return Picture("", {"data": data, "layout": layout}, summary, 340, zoom=False)


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
    summary = f"Run time by stage; {figure(document['timing']['total'], 's', 3)} in all. The simulation runs beside the reference."
    picture = Picture("Run time", {"data": data, "layout": layout}, summary, 260, zoom=False)
    return Section("Error and run time", (Facts("", rows), picture))
