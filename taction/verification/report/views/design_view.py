"""A tuning, new scalings, a scene made for a matrix, and the changes that mend a verdict."""

from __future__ import annotations

import math
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import replace
from functools import partial
from typing import Any

import numpy as np

from taction.netlist_gen.scene.keys import SYMBOLS, Value, find_key
from taction.netlist_gen.scene.scene import Scene
from taction.system.charts import Axis, Chart, Curve, Limit, Mark, Text
from taction.system.quantities import banded, percent, quantity, show, spaced, written
from taction.verification.design.fresh_scene import NewScene
from taction.verification.design.remedies import Change, Remedies, StableRange
from taction.verification.design.scaling import Scaled
from taction.verification.design.trials import Trial
from taction.verification.design.tune import Tuned
from taction.verification.report.blocks import Code, Content, Page, Section, Table
from taction.verification.report.texts import Cell, Column, figure, number_cell
from taction.verification.report.views.verdict_view import on_screen
from taction.verification.report.views.verdict_view import view as verdict_report
from taction.verification.stability.margin import first_knob
from taction.verification.verdict.headroom import describe
from taction.verification.verdict.record import finite

TRADE = "Settling time against overshoot of the designs on the trade-off curve; dotted: the limit."
LEAST_REACH, EDGE = 1e-3, 0.12  # of the step, and of the width: around the points of the picture


def view(result: Tuned) -> Page:
    """Return the page of a tuning."""
    verdict = result.verdict
    verified = verdict_report(verdict, "taction design tune")
    before, after = result.before.settling_time, result.after.settling_time
    lead = banded("settles", verdict.measurements.band).capitalize()
    summary = f"{lead} in {figure(after, 's')}, before: {figure(before, 's')}. {verified.summary}"
    own = (
        Section("Tuning", tuple(_blocks(result)), media="terminal page"),
        Section("Trade-off", lambda: _tradeoff(result), media="page picture"),
    )
    return replace(
        verified,
        summary=summary,
        sections=(*own, *on_screen(verified, verdict)),
        foot=(*verified.foot, "more: --report FILE"),
    )


def _blocks(tuning: Tuned) -> Iterator[Content]:
    units, circuit = _units(tuning), tuning.verdict.circuit
    columns: dict[str, Column] = {"design": lambda each: each[0]}
    for path, unit in units.items():
        columns[_key_name(path)] = partial(_value, path=path, unit=unit)
    settling = banded("settling_time", tuning.scene.checks.settling_time.band)
    columns[settling] = lambda each: number_cell(each[1].settling_time, "s")
    columns["overshoot"] = lambda each: number_cell(finite(each[1].overshoot), "step", 3)
    designs = ("before", tuning.before), ("after", tuning.after)
    yield Table.of("Before and after", designs, columns)
    yield {
        "designs tried": str(tuning.tried),
        "designs on the trade-off curve": str(len(tuning.frontier)),
        "limit of the overshoot": percent(tuning.overshoot_limit, 4),
        f"margin of {first_knob(circuit)}": f"{tuning.margin:g}",
        "lambda, unchanged": circuit.facts["lambda"].text,
    }
    new = {path: written(value, units[path]) for path, value in tuning.after.values.items()}
    if "R" in circuit.facts:
        new["resistance"] = written(circuit.value("R"), "ohm")
    lines = (f"{path.removeprefix('design.')} = {value}" for path, value in new.items())
    yield Code("the values for the table [design]", "\n".join(lines))
    for path, edge in tuning.at_edges.items():
        name = path.removeprefix("design.")
        yield (
            f"{name} is at the edge of its range, {quantity(edge, units[path])}: a wider range may"
            f" hold a better design, such as --over {name}=LOW:HIGH or a larger --reach"
        )


def _value(design: tuple[str, Trial], path: str, unit: str) -> Cell:
    return number_cell(design[1].values[path], unit, 5)


def _units(tuning: Tuned) -> dict[str, str]:
    return {path: find_key(tuning.scene, path).unit for path in tuning.after.values}


def _key_name(path: str) -> str:
    return path.removeprefix("design.").replace("_", " ")


def _tradeoff(tuning: Tuned) -> Chart:
    """Return the frontier, the limit, and the designs before and after with their values."""
    units, limit = _units(tuning), tuning.overshoot_limit

    def text(trial: Trial) -> str:
        pairs = trial.values.items()
        return ", ".join(f"{_key_name(path)} {quantity(v, units[path])}" for path, v in pairs)

    def curve(trials: Sequence[Trial], *look: Any, **more: Any) -> Curve:
        places = [(each.overshoot, each.settling_time) for each in trials]
        return Curve(*np.array(places).reshape(-1, 2).T, *look, **more)

    frontier = sorted(tuning.frontier, key=lambda each: each.overshoot)
    name, hover = "no design tried is better than these", tuple(map(text, frontier))
    marks: list[Mark] = [curve(frontier, name, "true", mark="circle", hover=hover)]
    first, last = ("before", tuning.before), ("after", tuning.after)
    ends = [(*first, "square-open", "fail"), (*last, "star", "pass")]
    for name, trial, mark, outcome in ends:
        if math.isfinite(trial.settling_time + trial.overshoot):
            title = f"{name}: {quantity(trial.settling_time, 's')}, {text(trial)}"
            marks.append(curve([trial], title, outcome, "", mark, size=9.0))
    every = np.array([(each.overshoot, each.settling_time) for _, each, *_ in ends])
    known = [each.overshoot for each in frontier] + every[np.isfinite(every).all(1), 0].tolist()
    low, high = min(known, default=limit), max(known, default=limit)
    reach = max(high - low, 0.1 * high, LEAST_REACH)
    near = low <= limit <= high + reach
    high = max(high, limit) if near else high
    said = f"overshoot limit, {figure(limit, 'step', 3)}"
    far = Text(f"{said} →", None, None, ("left", "below"))
    marks.append(Limit(limit, "x", said, "ink", "dot") if near else far)
    shown = (max(0.0, low - EDGE * reach), high + EDGE * reach) if known else None
    y = Axis(banded("settling_time", tuning.scene.checks.settling_time.band), "s", "log")
    return Chart("Trade-off", Axis("overshoot", "step", limits=shown), y, tuple(marks), TRADE)


def scaling_view(result: Scaled) -> Page:
    """Return the page of the scalings, the loads, and what the checks say."""
    return Page(
        title=result.scene.name,
        command="taction new --from",
        outcome=result.verdict.outcome.value,
        sections=(Section("Scalings", tuple(_lines(result)), media="terminal page notebook"),),
        foot=("verified by the state-space engine",),
    )


def _lines(result: Scaled) -> Iterator[str]:
    facts = result.verdict.circuit.facts
    shown = (facts[name] for name in ("G0", "U0", "gain", "R", "C"))
    yield ", ".join(f"{fact.symbol} = {show(fact.value, fact.unit)}" for fact in shown)
    low, high = (show(ohms, "ohm") for ohms in result.matrix_ohms)
    yield f"matrix resistors from {low} to {high}; lambda stays {facts['lambda'].value:.4g}"
    yield from (f"{describe(load)} ({load.share:.0%})" for load in result.verdict.parts.loads)
    yield from (f"note: {note}" for note in result.notes)
    for check in result.verdict.checks:
        if check.outcome.value != "pass":
            yield f"{check.name}: {check.outcome.value}: {check.reason}"


def new_view(result: NewScene) -> Page:
    """Return the page of a new scene: what was recognised, how lambda was chosen, the scalings."""
    if result.scaled is None:
        return Page(result.file, "taction new", "", "", (), ())
    found = (*result.notes, f"lambda {result.rule}")
    return replace(
        scaling_view(result.scaled), title=result.file, command="taction new", lines=found
    )


NAMES = {path: symbol for symbol, path in SYMBOLS.items()} | {"design.gain": "gain"}


def remedies_text(scene: Scene, remedies: Remedies) -> str:
    """Return the changes as lines of text."""
    return "\n".join(_change_lines(scene, remedies))


HEAD = "what to change (by the state-space engine; lambda stays unless it is named):"


def _change_lines(scene: Scene, remedies: Remedies) -> Iterator[str]:
    yield HEAD
    if remedies.unmendable:
        names = ", ".join(map(spaced, remedies.unmendable))
        yield f"  no change of the design mends: {names}"
        return
    edges = [text for each in remedies.stability if (text := edge_text(each))]
    if edges:
        yield f"  stable {', or '.join(edges)}"
    if remedies.opamps:
        yield f"  {'or' if edges else 'stable'} with {' or '.join(remedies.opamps)}"
    yield from (f"  {_change(scene, change)}" for change in remedies.changes)
    for searched in remedies.without:
        where, ends = "", (searched.least, searched.most)
        if None not in ends:
            unit = find_key(scene, searched.paths[0]).unit
            where = " from {} to {}".format(*(show(end or 0.0, unit, 3) for end in ends))
        yield f"  no tried value of {_names(searched.paths)}{where} makes the board pass"
    keys = ", ".join(map(name_of, remedies.searched)) or "no key"
    cut = ", ".join(map(_names, remedies.cut))
    rest = f"; not to the end: {cut} (--changes)" if cut else ""
    yield f"  searched {remedies.trials} changes of {keys}{rest}"
    if remedies.undecided:
        count = len(remedies.undecided)
        yield f"  {count} of them without a verdict, such as: {remedies.undecided[0]}"


def _names(paths: Iterable[str]) -> str:
    return " and ".join(map(name_of, paths))


def edge_text(found: StableRange) -> str:
    """Return the nearest edge of a stable range: ``"from C = 9.023 pF"``; empty without one."""
    if found.edge is None:
        return ""
    side, word, other = "up to", "from", found.low
    if found.edge == found.low:
        side, word, other = "from", "to", found.high
    text = f"{side} {name_of(found.path)} = {show(found.edge, found.unit)}"
    return text if other is None else f"{text} ({word} {show(other, found.unit)})"


def distance_text(found: StableRange) -> str:
    """Return how far a board is from stability on one key."""
    name, own = name_of(found.path), show(found.own, found.unit)
    if found.reason:
        return f"{name} = {own}: not known, {found.reason}"
    if found.edge is None or found.factor is None:
        ends = f"{show(found.least, found.unit)} to {show(found.most, found.unit)}"
        return f"{name} = {own}: no value from {ends} makes the board stable"
    return f"{name} = {own}: stable {edge_text(found)}, {found.factor:.4g} times the scene's value"


def _change(scene: Scene, change: Change) -> str:
    values = {path: v for path, v in change.values.items() if path != "design.lambda"}
    pairs = (values or change.values).items()
    text = " and ".join(key_with_value(scene, path, value) for path, value in pairs)
    if change.resistance is not None:
        text += f" with R = {show(change.resistance, 'ohm')}"
    if change.left:
        mended, left = (", ".join(map(spaced, each)) for each in (change.mends, change.left))
        return f"{text}: mends {mended}, but not {left}"
    return f"{text} (verified)"


def key_with_value(scene: Scene, path: str, value: Value) -> str:
    """Return ``"C = 9.76 pF"``."""
    if isinstance(value, float):
        value = show(value, find_key(scene, path).unit)
    return f"{name_of(path)} = {value}"


def name_of(path: str) -> str:
    """Return the symbol of a key, or the last part of its path."""
    return NAMES.get(path, path.removeprefix("design.").removeprefix("opamp."))
