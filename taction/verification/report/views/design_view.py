"""A tuning, new scalings, a scene made for a matrix, and the changes that mend a verdict."""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import replace
from functools import partial

import numpy as np

from taction.netlist_gen.scene.keys import SYMBOLS, Value, find_key
from taction.netlist_gen.scene.scene import Scene
from taction.system.charts import Axis, Chart, Curve, Limit, Mark, Text
from taction.system.quantities import show, written
from taction.verification.design.fresh_scene import NewScene
from taction.verification.design.remedies import Change, Remedies, StableRange
from taction.verification.design.scaling import Scaled
from taction.verification.design.trials import Trial
from taction.verification.design.tune import Tuned, Tuning
from taction.verification.report.blocks import Code, Content, Page, Section, Table
from taction.verification.report.texts import (
    Cell,
    Column,
    banded,
    figure,
    number_cell,
    percent,
    quantity,
    spaced,
)
from taction.verification.report.views.verdict_view import on_screen
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
        Section("Tuning", tuple(_blocks(tuning, verdict)), media="terminal page"),
        Section("Trade-off", lambda: _tradeoff(tuning), media="page picture"),
    )
    return replace(
        verified,
        summary=summary,
        sections=(*own, *on_screen(verified, verdict)),
        foot=(*verified.foot, "more: --report FILE"),
    )


def _blocks(tuning: Tuning, verdict: Verdict) -> Iterator[Content]:
    units, circuit = _units(tuning), verdict.circuit
    columns: dict[str, Column] = {"design": lambda each: each[0]}
    for path, unit in units.items():
        columns[_key_name(path)] = partial(_value, path=path, unit=unit)
    settling = banded("settling_time", tuning.scene.checks.settling_time.band)
    columns[settling] = lambda each: number_cell(each[1].settling_time, "s")
    columns["overshoot"] = lambda each: (
        number_cell(each[1].overshoot, "step", 3) if math.isfinite(each[1].overshoot) else "–"
    )
    designs = ("before", tuning.before), ("after", tuning.after)
    yield Table.of("Before and after", designs, columns)
    yield {
        "designs tried": str(tuning.tried),
        "designs on the trade-off curve": str(len(tuning.frontier)),
        "limit of the overshoot": percent(tuning.overshoot_limit, 4),
        f"margin of {first_knob(circuit)}": f"{tuning.margin:g}",
        "lambda, unchanged": circuit.facts["lambda"].text,
    }
    lines = [
        f"{path.removeprefix('design.')} = {written(value, units[path])}"
        for path, value in tuning.after.values.items()
    ]
    if "R" in circuit.facts:
        lines.append(f"resistance = {written(circuit.value('R'), 'ohm')}")
    yield Code("the values for the table [design]", "\n".join(lines))
    for path, edge in tuning.at_edges.items():
        name = path.removeprefix("design.")
        yield (
            f"{name} is at the edge of its range, {quantity(edge, units[path])}: a wider range may"
            f" hold a better design, such as --over {name}=LOW:HIGH or a larger --reach"
        )


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
    return Chart("Trade-off", x, y, tuple(marks), TRADE)


def _is_finite(trial: Trial) -> bool:
    return math.isfinite(trial.settling_time + trial.overshoot)


def _places(trials: list[Trial]) -> tuple[np.ndarray, np.ndarray]:
    x, y = np.array([(each.overshoot, each.settling_time) for each in trials]).reshape(-1, 2).T
    return x, y


def scaling_view(result: Scaled) -> Page:
    """Return the page of the scalings, the loads, and what the checks say."""
    scaling = result.scaling
    return Page(
        title=scaling.scene.name,
        command="taction new --from",
        outcome=result.verdict.outcome.value,
        sections=(Section("Scalings", tuple(_lines(result)), media="terminal page notebook"),),
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
    for change in remedies.changes:
        yield f"  {_change(scene, change)}"
    for searched in remedies.without:
        where = ""
        if searched.least is not None and searched.most is not None:
            unit = find_key(scene, searched.paths[0]).unit
            where = f" from {show(searched.least, unit, 3)} to {show(searched.most, unit, 3)}"
        names = " and ".join(map(name_of, searched.paths))
        yield f"  no tried value of {names}{where} makes the board pass"
    keys = ", ".join(map(name_of, remedies.searched)) or "no key"
    cut = [" and ".join(map(name_of, paths)) for paths in remedies.cut]
    rest = f"; not to the end: {', '.join(cut)} (--changes)" if cut else ""
    yield f"  searched {remedies.trials} changes of {keys}{rest}"
    if remedies.undecided:
        count = len(remedies.undecided)
        yield f"  {count} of them without a verdict, such as: {remedies.undecided[0]}"


def edge_text(found: StableRange) -> str:
    """Return the nearest edge of a stable range: ``"from C = 9.023 pF"``; empty without one."""
    name = name_of(found.path)
    if found.edge is None:
        return ""
    side = "from" if found.edge == found.low else "up to"
    text = f"{side} {name} = {show(found.edge, found.unit)}"
    other = found.high if found.edge == found.low else found.low
    if other is not None:
        text += f" ({'to' if found.edge == found.low else 'from'} {show(other, found.unit)})"
    return text


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
    if not values:
        values = change.values
    text = " and ".join(key_with_value(scene, path, value) for path, value in values.items())
    if change.resistance is not None:
        text += f" with R = {show(change.resistance, 'ohm')}"
    if change.left:
        mended = ", ".join(map(spaced, change.mends))
        return f"{text}: mends {mended}, but not {', '.join(map(spaced, change.left))}"
    return f"{text} (verified)"


def key_with_value(scene: Scene, path: str, value: Value) -> str:
    """Return ``"C = 9.76 pF"``."""
    if isinstance(value, float):
        value = show(value, find_key(scene, path).unit)
    return f"{name_of(path)} = {value}"


def name_of(path: str) -> str:
    """Return the symbol of a key, or the last part of its path."""
    return NAMES.get(path, path.removeprefix("design.").removeprefix("opamp."))
