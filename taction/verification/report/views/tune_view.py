"""A tuning: before and after, and the trade-off; new scalings, and the scene made for a matrix."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator
from dataclasses import replace
from functools import partial
from typing import Any

import numpy as np

from taction.netlist_gen.scene.keys import find_key
from taction.system.charts import Axis, Chart, Curve, Limit, Mark, Text
from taction.system.quantities import show, written
from taction.verification.design.fresh_scene import NewScene
from taction.verification.design.scaling import Scaled
from taction.verification.design.trials import Trial
from taction.verification.design.tune import Tuned, Tuning
from taction.verification.report.blocks import (
    BOTH,
    DRAWN,
    EVERYWHERE,
    Block,
    Cell,
    Code,
    Facts,
    Notes,
    Page,
    Section,
    Table,
)
from taction.verification.report.texts import banded, figure, number_cell, percent, quantity
from taction.verification.report.views.verdict_screen_view import on_screen
from taction.verification.report.views.verdict_view import view as verdict_report
from taction.verification.stability.margin import first_knob
from taction.verification.verdict.headroom import describe
from taction.verification.verdict.verify import Verdict

TRADE = "Settling time against overshoot of the designs on the trade-off curve; dotted: the limit."
LEAST_REACH, EDGE = 1e-3, 0.12  # of the step, and of the width: around the points of the picture


def view(result: Tuned) -> Page:
    """Return the page of a tuning."""
    tuning, verdict = result.tuning, result.verdict
    verified = verdict_report(verdict, "taction design tune")
    before, after = tuning.before.settling_time, tuning.after.settling_time
    lead = banded("settles", verdict.measurements.band).capitalize()
    summary = f"{lead} in {figure(after, 's')}, before: {figure(before, 's')}. {verified.summary}"
    own = (
        Section("Tuning", tuple(_blocks(tuning, verdict)), media=BOTH),
        Section("Trade-off", lambda: (_tradeoff(tuning),), media=DRAWN),
    )
    return replace(
        verified,
        summary=summary,
        sections=(*own, *on_screen(verified, verdict)),
        foot=(*verified.foot, "more: --report FILE"),
    )


def _blocks(tuning: Tuning, verdict: Verdict) -> Iterator[Block]:
    units, circuit = _units(tuning), verdict.circuit
    columns: dict[str, Callable[[Any], Any]] = {"design": lambda each: each[0]}
    for path, unit in units.items():
        columns[_key_name(path)] = partial(_value, path=path, unit=unit)
    settling = banded("settling_time", tuning.scene.checks.settling_time.band)
    columns[settling] = lambda each: number_cell(each[1].settling_time, "s")
    columns["overshoot"] = lambda each: (
        number_cell(each[1].overshoot, "step", 3) if math.isfinite(each[1].overshoot) else "–"
    )
    designs = ("before", tuning.before), ("after", tuning.after)
    yield Table.of("Before and after", designs, columns)
    facts = (
        ("designs tried", str(tuning.tried)),
        ("designs on the trade-off curve", str(len(tuning.frontier))),
        ("limit of the overshoot", percent(tuning.overshoot_limit, 4)),
        (f"margin of {first_knob(circuit)}", f"{tuning.margin:g}"),
        ("lambda, unchanged", circuit.facts["lambda"].text),
    )
    yield Facts("", facts)
    lines = [
        f"{path.removeprefix('design.')} = {written(value, units[path])}"
        for path, value in tuning.after.values.items()
    ]
    if "R" in circuit.facts:
        lines.append(f"resistance = {written(circuit.value('R'), 'ohm')}")
    yield Code("the values for the table [design]", "\n".join(lines))
    edges = tuple(
        f"{name} is at the edge of its range, {quantity(edge, units[path])}: a wider range may hold"
        f" a better design, such as --over {name}=LOW:HIGH or a larger --reach"
        for path, edge in tuning.at_edges.items()
        if (name := path.removeprefix("design."))
    )
    yield Notes("", edges)


def _value(design: tuple[str, Trial], path: str, unit: str) -> Cell:
    return number_cell(design[1].values[path], unit, 5)


def _units(tuning: Tuning) -> dict[str, str]:
    return {path: find_key(tuning.scene, path).unit for path in tuning.after.values}


def _key_name(path: str) -> str:
    return path.removeprefix("design.").replace("_", " ")


def _tradeoff(tuning: Tuning) -> Chart:
    """Return the frontier, the limit, and the designs before and after with their values."""
    units, limit = _units(tuning), tuning.overshoot_limit

    def text(trial: Trial) -> str:
        pairs = trial.values.items()
        return ", ".join(f"{_key_name(path)} {quantity(v, units[path])}" for path, v in pairs)

    frontier = sorted(tuning.frontier, key=lambda each: each.overshoot)
    hover = tuple(map(text, frontier))
    name = "no design tried is better than these"
    marks: list[Mark] = [Curve(*_places(frontier), name, "true", mark="circle", hover=hover)]
    first, last = (tuning.before, "square-open", "fail"), (tuning.after, "star", "pass")
    for name, (trial, mark, outcome) in {"before": first, "after": last}.items():
        if _is_finite(trial):
            title = f"{name}: {quantity(trial.settling_time, 's')}, {text(trial)}"
            marks.append(Curve(*_places([trial]), title, outcome, "", mark, size=9.0))
    ends, near = None, True
    shown = filter(_is_finite, (*frontier, tuning.before, tuning.after))
    if known := [each.overshoot for each in shown]:
        low, high = min(known), max(known)
        reach = max(high - low, 0.1 * high, LEAST_REACH)
        near = low <= limit <= high + reach
        high = max(high, limit) if near else high
        ends = max(0.0, low - EDGE * reach), high + EDGE * reach
    said = f"overshoot limit, {figure(limit, 'step', 3)}"
    far = Text(f"{said} →", None, None, ("left", "below"))
    marks.append(Limit(limit, "x", said, "ink", "dot") if near else far)
    x = Axis("overshoot", "step", limits=ends)
    y = Axis(banded("settling_time", tuning.scene.checks.settling_time.band), "s", "log")
    return Chart("Trade-off", x, y, tuple(marks), _gain(tuning), TRADE, legend="below")


def _is_finite(trial: Trial) -> bool:
    return math.isfinite(trial.settling_time + trial.overshoot)


def _places(trials: list[Trial]) -> tuple[np.ndarray, np.ndarray]:
    x, y = np.array([(each.overshoot, each.settling_time) for each in trials]).reshape(-1, 2).T
    return x, y


def _gain(tuning: Tuning) -> str:
    """Return how much faster the design settles."""
    before, after = tuning.before.settling_time, tuning.after.settling_time
    if not (math.isfinite(before) and after > 0.0):
        return f"it settles in {figure(after, 's')}"
    if f"{before / after:.3g}" == "1":
        return "no design that was tried settles faster"
    return f"it settles {before / after:.3g} times as fast"


def scaling_view(result: Scaled) -> Page:
    """Return the page of the scalings, the loads, and what the checks say."""
    scaling = result.scaling
    return Page(
        title=scaling.scene.name,
        command="taction new --from",
        outcome=result.verdict.outcome.value,
        sections=(Section("Scalings", (Notes("", tuple(_lines(result))),), media=EVERYWHERE),),
        foot=("verified by the state-space engine",),
    )


def _lines(result: Scaled) -> Iterator[str]:
    scaling, facts = result.scaling, result.scaling.circuit.facts
    shown = (facts[name] for name in ("G0", "U0", "gain", "R", "C"))
    yield ", ".join(f"{fact.symbol} = {show(fact.value, fact.unit)}" for fact in shown)
    low, high = (show(ohms, "ohm") for ohms in scaling.matrix_ohms)
    yield f"matrix resistors from {low} to {high}; lambda stays {facts['lambda'].value:.4g}"
    yield from (f"{describe(load)} ({load.share:.0%})" for load in scaling.loads)
    yield from (f"note: {note}" for note in scaling.notes)
    for check in result.verdict.checks:
        if check.outcome.value != "pass":
            yield f"{check.name}: {check.outcome.value}: {check.reason}"


def new_view(result: NewScene) -> Page:
    """Return the page of a new scene: what was recognised, how lambda was chosen, the scalings."""
    if result.fresh is None or result.scaled is None:
        return Page(result.file, "taction new", "", "", (), ())
    found = (*result.fresh.notes, f"lambda {result.fresh.rule}")
    return replace(
        scaling_view(result.scaled), title=result.file, command="taction new", lines=found
    )
