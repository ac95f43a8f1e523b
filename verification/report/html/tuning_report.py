"""The report of a tuning: before and after, the trade-off, and the verification of the design."""

from __future__ import annotations

import math
from collections.abc import Iterator

from taction.netlist_gen.scene.keys import find_key
from taction.system.quantities import written
from taction.verification.design.trials import Trial
from taction.verification.design.tune import Tuning
from taction.verification.report.html.blocks import (
    Block,
    Cell,
    Code,
    Facts,
    Picture,
    Report,
    Section,
    Table,
)
from taction.verification.report.html.pictures import axis, label, line, log_axis, numbers
from taction.verification.report.html.texts import number_cell, percent, quantity
from taction.verification.report.html.verdict_report import verdict_report
from taction.verification.verdict.verify import Verdict


def tuning_report(tuning: Tuning, verdict: Verdict) -> Report:
    """Return the report of a tuning; `verdict` is that of the tuned scene."""
    verified = verdict_report(verdict, "taction tune")
    before, after = tuning.before.settling_time, tuning.after.settling_time
    summary = (
        f"Settling time {quantity(after, 's')}, before {quantity(before, 's')}. {verified.summary}"
    )
    tuned = Section("Tuning", tuple(_blocks(tuning, verdict)))
    return Report(
        verified.title,
        verified.command,
        verified.outcome,
        summary,
        verified.lines,
        (tuned, *verified.sections),
    )


def _blocks(tuning: Tuning, verdict: Verdict) -> Iterator[Block]:
    keys = {path: find_key(tuning.scene, path).unit for path in tuning.after.values}
    titles = ("design", *map(_key_name, keys), "settling time", "overshoot")
    rows = tuple(
        (
            Cell(name),
            *(number_cell(value, keys[path]) for path, value in candidate.values.items()),
            number_cell(candidate.settling_time, "s"),
            number_cell(candidate.overshoot, "step"),
        )
        for name, candidate in (("before", tuning.before), ("after", tuning.after))
    )
    yield Table("Before and after", titles, rows)
    yield _tradeoff(tuning, keys)
    facts = (
        ("designs tried", str(tuning.tried)),
        ("limit of the overshoot", percent(tuning.overshoot_limit)),
        ("margin of C", f"{tuning.margin:g}"),
        ("lambda, unchanged", verdict.circuit.facts["lambda"].text),
    )
    yield Facts("", facts)
    lines = [
        f"{path.removeprefix('design.')} = {written(value, keys[path])}"
        for path, value in tuning.after.values.items()
    ]
    resistance = written(verdict.circuit.value("R"), "ohm")
    lines.append(f"resistance = {resistance}")
    yield Code("the values for the table [design]", "\n".join(lines))


def _tradeoff(tuning: Tuning, keys: dict[str, str]) -> Picture:
    def text(candidate: Trial) -> str:
        return ", ".join(
            f"{_key_name(path)} {quantity(value, keys[path])}"
            for path, value in candidate.values.items()
        )

    frontier = list(tuning.frontier)
    data = [
        {"type": "scatter", "mode": "lines+markers", "name": "no other design tried is better",
         "x": numbers([100.0 * c.overshoot for c in frontier]),
         "y": numbers([c.settling_time for c in frontier]), "text": list(map(text, frontier)),
         "line": {"color": "--true"}, "marker": {"size": 6},
         "hovertemplate": "%{text}: %{y:.4s}s, %{x:.3g} %<extra></extra>"}
    ]  # fmt: skip
    marks = (
        ("before", tuning.before, "square-open", "--fail"),
        ("after", tuning.after, "star", "--pass"),
    )
    notes = []
    for name, candidate, symbol, colour in marks:
        if not math.isfinite(candidate.settling_time + candidate.overshoot):
            continue
        x, y = 100.0 * candidate.overshoot, candidate.settling_time
        data.append(
            {"type": "scatter", "mode": "markers", "name": name, "x": [x], "y": [y],
             "text": [text(candidate)], "marker": {"symbol": symbol, "size": 14, "color": colour},
             "hovertemplate": f"{name}: %{{text}}, %{{y:.4s}}s, %{{x:.3g}} %<extra></extra>"}
        )  # fmt: skip
        notes.append(
            label(
                f"{name}: {text(candidate)}",
                x,
                math.log10(y),
                xanchor="left",
                xshift=12,
                yanchor="bottom",
                yshift=2,
            )
        )
    layout = {
        "xaxis": axis("overshoot (% of the step)"),
        "yaxis": log_axis("settling time", "s", [c.settling_time for c in frontier]),
        "shapes": [line(100.0 * tuning.overshoot_limit, None, "--ink", dash="dot")],
        "annotations": notes,
    }
    summary = (
        "Settling time against overshoot of the designs on the trade-off curve; dotted: the limit."
    )
    spec, result = {"data": data, "layout": layout}, _gain(tuning)
    return Picture("Trade-off", spec, summary, 380, result=result)


def _key_name(path: str) -> str:
    return path.removeprefix("design.").replace("_", " ")


def _gain(tuning: Tuning) -> str:
    """Return how much faster the design settles."""
    before, after = tuning.before.settling_time, tuning.after.settling_time
    if not (math.isfinite(before) and after > 0.0):
        return f"it settles in {quantity(after, 's')}"
    return f"it settles {before / after:.3g} times as fast"
