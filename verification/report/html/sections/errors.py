"""Recovered stress beside the truth, the error budget, and what the run's accuracy cost."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from taction.system.array_types import EPS, Floats
from taction.system.quantities import readable
from taction.verification.report.html.blocks import (
    Cell,
    Facts,
    Notes,
    Picture,
    Section,
    Table,
    View,
)
from taction.verification.report.html.pictures import HATCH, axis, label, line, numbers
from taction.verification.report.html.texts import figure, quantity
from taction.verification.report.tables import spaced
from taction.verification.verdict.verify import Verdict

ROUNDING = 16.0 * EPS  # of the step: a smaller part is rounding
LEAST = 1e-9  # of the step: a smaller part has no number
FEW = 20  # channels with a number each
SEEN = 20.0  # times the reference: a larger end of the record is off the picture


def stress_section(verdict: Verdict) -> Section:
    """Return the recovered stress beside the regularised optimum and the true stress."""
    problem, U0 = verdict.problem, verdict.circuit.value("U0")
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
    layout = {
        "xaxis": axis(title, zeroline=False, **ticks), "yaxis": axis("stress"),
        "hovermode": "closest",
    }  # fmt: skip
    summary = f"Stress by channel: {', '.join(curve[0] for curve in curves)}.{text}"
    spec, result = {"data": data, "layout": layout}, _distance(verdict, optimum)
    picture = Picture("Stress by channel", spec, summary, 340, zoom=False, result=result)
    return Section("Recovered stress", (picture,))


def _distance(verdict: Verdict, optimum: Floats) -> str:
    """Return how far the board at rest is from the optimum, and the optimum from the truth."""
    amplitude = verdict.measurements.amplitude
    if not amplitude:
        return ""
    unit = verdict.circuit.value("U0") / amplitude
    near = float(np.abs(verdict.steady.values / verdict.circuit.value("U0") - optimum).max())
    text = f"the board at rest is {figure(unit * near, 'step')} of the step off the optimum"
    if verdict.problem.stress is None:
        return text
    far = float(np.abs(optimum - verdict.problem.stress).max())
    return f"{text}, the optimum {figure(unit * far, 'step')} off the truth"


def budget_section(document: Mapping[str, Any]) -> Section:
    """Return the error budget as a waterfall of one channel and as a table."""
    parts: Mapping[str, Mapping[str, Any]] = document["error_budget"]
    amplitude = document["step_amplitude"] or 0.0
    if not parts:
        return Section("Error budget", ())
    total = parts.get("total")
    worst = None if total is None else int(np.argmax(np.abs(total["channels"])))
    signed = () if worst is None else (f"channel {worst + 1}",)
    rows = [
        _part(spaced(name), part, worst, amplitude)
        for name, part in parts.items()
        if name != "total"
    ]
    if total is not None:
        sums = {"channels": total["sum"], "value": max(map(abs, total["sum"])), "how": ""}
        rows += [
            _part("sum of the parts", sums, worst, amplitude),
            _part(total["how"], {**total, "how": ""}, worst, amplitude),
        ]
    titles = ("error", "largest of any channel", "of the step", *signed, "how it was found")
    table = Table("Parts of the error", titles, tuple(rows))
    if total is None or worst is None:
        text = "The parts do not add up: a solution between them is not known."
        return Section("Error budget", (Notes("", (text,)), table))
    lead = "From one solution to the next; the parts of a channel add up to its whole error."
    return Section("Error budget", (_waterfall(parts, worst, amplitude), table), lead)


def _part(
    name: str, part: Mapping[str, Any], worst: int | None, amplitude: float
) -> tuple[Cell, ...]:
    """Return the row of a part, with its signed value in the channel `worst` (from 0)."""
    return (
        Cell(name),
        _volts(part["value"], amplitude),
        _share(part["value"], amplitude),
        *(() if worst is None else (_signed(part["channels"], worst, amplitude),)),
        Cell(readable(part["how"])),
    )


def _signed(channels: Sequence[float], place: int, amplitude: float) -> Cell:
    return _volts(channels[place], amplitude) if channels else Cell("–")


def _is_known(value: float | None) -> bool:
    return value is not None and math.isfinite(value)


def _volts(value: float | None, amplitude: float) -> Cell:
    if value is None or not math.isfinite(value):
        return Cell("unknown")
    return Cell(_part_text(value, amplitude), value)


def _part_text(value: float, amplitude: float) -> str:
    """Return a part of the error, V; parts too small to matter have no number."""
    if abs(value) <= ROUNDING * amplitude:
        return "below rounding"
    return quantity(value, "V", 3) if abs(value) > LEAST * amplitude else "under 1 ppb of the step"


def _share(value: float | None, amplitude: float) -> Cell:
    if value is None or not math.isfinite(value) or abs(value) <= ROUNDING * amplitude:
        return Cell("–")
    return Cell(figure(value / amplitude, "step", 3) if amplitude else "–", value)


def _waterfall(parts: Mapping[str, Mapping[str, Any]], worst: int, amplitude: float) -> Picture:
    """Return the signed parts of a channel, each from the sum of those before."""
    links = {n: p["channels"][worst] for n, p in parts.items() if p["channels"] and n != "total"}
    whole = parts["total"]["channels"][worst]
    steps = list(links.values())
    ends = np.cumsum([0.0, *steps]).tolist()
    falls = [step < 0.0 for step in steps]
    texts = [_part_text(step, amplitude) for step in (*steps, whole)]
    data = [
        {"type": "bar", "orientation": "h", "y": [*map(spaced, links), "whole"],
         "x": [*steps, whole], "base": [*ends[:-1], 0.0], "textposition": "none",
         "text": texts,
         "marker": {
             "color": [*("--fail-fill" if fall else "--pass" for fall in falls), "--band"],
             "pattern": HATCH | {"shape": [*("/" if fall else "" for fall in falls), ""]}},
         "hovertemplate": "%{y}: %{text}<extra></extra>"}
    ]  # fmt: skip
    names = [
        label(text, 1.01, place, xref="paper", xanchor="left", font={"size": 12, "color": "--ink"})
        for place, text in enumerate(texts)
    ]
    layout = {
        "xaxis": axis(f"error of channel {worst + 1}", "V"),
        "yaxis": {"autorange": "reversed"},
        "shapes": [line(0.0, None)],
        "annotations": names,
        "showlegend": False,
        "margin": {"l": 84, "r": 24 + 7 * max(map(len, texts)), "t": 8, "b": 44},
    }
    unknown = [spaced(n) for n, p in parts.items() if not _is_known(p["value"]) and n != "total"]
    summary = (
        f"Channel {worst + 1}, which has the largest whole error, {quantity(whole, 'V', 3)}."
        " Solid blue bars raise the output, hatched orange bars lower it."
        + f" Not known: {', '.join(unknown)}."
        * bool(unknown)
    )
    picture = {"data": data, "layout": layout}
    largest = max(links, key=lambda name: abs(links[name]))
    result = f"{quantity(whole, 'V', 3)} in channel {worst + 1}, most of it {spaced(largest)}"
    height, views = 90 + 34 * len(texts), _steps_views(ends, whole)
    return Picture("Waterfall", picture, summary, height, views, zoom=False, result=result)


def _steps_views(ends: Sequence[float], whole: float) -> tuple[View, ...]:
    """Return the whole waterfall, and one from which the largest part is left out."""
    sizes = np.abs(np.diff(ends))
    if len(sizes) < 2:
        return ()
    everything = View("every part", {"xaxis.range": _around([0.0, whole, *ends])})
    large = int(np.argmax(sizes))
    if large not in (0, len(sizes) - 1):
        return (everything,)
    rest = ends[1:] if large == 0 else ends[:-1]
    return everything, View("without the largest part", {"xaxis.range": _around(rest)})


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
        ("requested error", f"{figure(accuracy['wanted'], 'step')} of the step"),
        ("reached error", f"{figure(reached, 'step')} of the step" if reached else "unknown"),
        ("how it is known", accuracy["how"]),
        ("simulation", quantity(accuracy["seconds"], "s", 3)),
        ("points", f"{accuracy['points']} up to {quantity(run['stop'], 's')}"),
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
    result = f"{total}, most of it {max(stages, key=lambda name: stages[name])}"
    spec = {"data": data, "layout": layout}
    picture = Picture("Run time", spec, summary, 260, zoom=False, result=result)
    return Section("Error and run time", (Facts("", rows), picture))
