"""A choice, a tuning, new scalings, a scene for a matrix, and the changes that mend a verdict."""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Collection, Iterator, Mapping, Sequence
from dataclasses import replace
from functools import partial

import numpy as np

from taction.netlist_gen.scene.keys import SYMBOLS, Value, find_key
from taction.netlist_gen.scene.scene import Scene
from taction.system import charts
from taction.system.charts import Axis, Chart, Curve, Mark
from taction.system.foreign_files import shortened
from taction.system.quantities import banded, percent, quantity, readable, show, spaced, written
from taction.verification.design.choose import (
    CAPACITANCE,
    FEEDBACK,
    G0,
    GAIN,
    NAMES,
    BestDesign,
    Choice,
    ChosenDesign,
    first_of_each,
)
from taction.verification.design.fresh_scene import NewScene
from taction.verification.design.remedies import Change, Remedies
from taction.verification.design.scaling import Scaled
from taction.verification.design.trials import Trial
from taction.verification.design.tune import Tuned
from taction.verification.report.blocks import Code, Content, Notes, Page, Section, Table
from taction.verification.report.texts import Cell, Column, figure, marked_cell, number_cell
from taction.verification.report.views.verdict_view import on_screen
from taction.verification.report.views.verdict_view import view as verdict_report
from taction.verification.stability.margin import first_knob
from taction.verification.verdict.checks import band_text
from taction.verification.verdict.headroom import describe
from taction.verification.verdict.record import ERROR, finite

LONGEST = 60  # characters of a reason in a table
SHOWN = 12  # op-amps in a terminal
LISTED = 500  # designs in the table
DRAWN = 8  # op-amps with a colour of their own, the best first
LOOKS = {
    **{"passes": ("pass", "circle"), "does not pass": ("fail", "x")},
    **{"before": ("ink", "diamond"), "after": ("ink", "star"), "among the best": ("ink", "star")},
}
MARKS = ("circle", "square", "diamond", "triangle-up", "triangle-down", "cross", "hexagon")
PICTURE = (
    "A mark is a design: below the line the value is within its limit. A design that is not here"
    " does not settle, or has no value."
)
MAP = (
    "The worst value over its limit, of the op-amp that is first in the tables; star: among the"
    " best; empty: no value."
)
WORST = (
    "Worst: the largest value over its limit; below 1 every check passes; -: a check that does not"
    " pass has no value."
)
UNITS = {CAPACITANCE: "F", GAIN: "ohm", G0: "S", FEEDBACK: "S"}


def choice_view(choice: Choice) -> Page:
    """Return the page of a choice."""
    designs, best = choice.designs, choice.best
    passing = sum(design.good for design in designs)
    summary = f"{passing} of {len(designs)} designs pass with parts that can be bought."
    own = (
        Section("Best designs", tuple(_best(best)), WORST),
        Section("Op-amps", _opamps(designs)),
        Section("Picture", lambda: _picture(choice), media="page picture"),
        Section("All designs", lambda: _table(designs), media="page"),
    )
    none = "No design passes; the table of op-amps has the nearest of each with its reason."
    return Page(
        title=choice.scene.name,
        command="taction design choose",
        outcome=choice.outcome,
        summary=summary,
        lines=() if best else (none,),
        sections=own,
    )


def _place(scene: Scene, design: Trial) -> str:
    paths = design.keys if isinstance(design, ChosenDesign) else design.values
    return ", ".join(key_with_value(scene, path, float(design.values[path])) for path in paths)


def _best(best: Sequence[BestDesign]) -> Iterator[Content]:
    said = {one.design.place: one for one in best}

    def ngspice(design: ChosenDesign) -> Cell:
        outcome = said[design.place].outcome
        return Cell("not run") if outcome is None else Cell(outcome.value, None, outcome.value)

    designs = [one.design for one in best]
    columns = {**_columns(designs), "ngspice": ngspice}
    yield Table.of("Best designs", designs, columns)
    reasons = (f"{one.design.opamp}: {readable(one.reason)}" for one in best if one.reason)
    yield Notes("What ngspice says", tuple(reasons))


def _opamps(designs: Sequence[ChosenDesign]) -> Table:
    """Return the best design of each op-amp, and why it does not pass."""
    passing = Counter(design.opamp for design in designs if design.good)
    more = {"passing": lambda each: passing[each.opamp], "outcome": _outcome}
    columns = _columns(designs) | more
    title, most = "The best design of each op-amp", {"terminal": SHOWN}
    return Table.of(title, first_of_each(designs), columns, "", most)


def _table(designs: Sequence[ChosenDesign]) -> Table:
    columns = {**_columns(designs), "outcome": _outcome}
    more = f"The first {LISTED} of {len(designs)}; --json has all."
    return Table.of("Designs, the best first", designs, columns, "", {"page": LISTED}, more)


def _outcome(design: ChosenDesign) -> Cell:
    """Return the outcome with the check that decides it, or what cannot be bought."""
    if design.refused:
        return Cell(f"no parts: {readable(design.refused)}", None, "fail")
    outcome, line = design.record.outcome, design.record.reason.split("\n")[0]
    if outcome == ERROR:  # file, key and value, then what is wrong with it
        line = line.rpartition(": ")[2]
    check = shortened(spaced(line.partition(" (limit")[0].partition("; ")[0]), LONGEST)
    return marked_cell(": ".join(filter(None, (outcome, check))), outcome)


def _band(designs: Sequence[ChosenDesign]) -> str:
    """Return the settling band of the checks in words; empty where no check has one."""
    bands = (band_text(check) for each in designs for check in each.record.checks)
    return next(filter(None, bands), "")


def _checked(design: ChosenDesign, name: str) -> float | None:
    return design.record.check_values.get(name)


def _columns(designs: Sequence[ChosenDesign]) -> dict[str, Column]:
    settling = f"settling {_band(designs)}".rstrip()
    moved = designs[0].keys if designs else ()
    columns: dict[str, Column] = {
        "op-amp": "opamp",
        **{NAMES[path]: partial(_value, path=path, unit=UNITS[path], digits=3) for path in moved},
        settling: lambda each: number_cell(finite(each.settling_time), "s", 3),
        "overshoot": lambda each: number_cell(finite(each.overshoot), "step", 3),
        "op-amp load": lambda each: number_cell(_checked(each, "headroom"), "step", 3),
        "output noise": lambda each: number_cell(_checked(each, "noise"), "V", 3),
        "worst": lambda each: number_cell(finite(each.worst), "ratio", 3),
    }
    if all(_checked(design, "noise") is None for design in designs):
        del columns["output noise"]
    return columns


def _picture(choice: Choice) -> Iterator[Content]:
    """Yield settling time and worst share of every design, and the map of the best op-amp."""
    designs, best = choice.designs, choice.best
    firsts = first_of_each([each for each in designs if math.isfinite(each.settling_time)])
    names, chosen = [each.opamp for each in firsts], {one.design.place for one in best}
    groups = {name: [each for each in designs if each.opamp == name] for name in names[:DRAWN]}
    groups["others"] = [each for each in designs if each.opamp in names[DRAWN:]]
    groups["among the best"] = [each for each in designs if each.place in chosen]
    x = Axis(f"settling {_band(designs)}".rstrip(), "s", "log")
    y = Axis("worst value over its limit", scale="log")
    chart = _tradeoff(choice.scene, groups, "worst", x, y, 1.0)
    yield chart or "No design settles with a value over its limit: there is no picture."
    yield _map([each for each in designs if each.opamp == designs[0].opamp], chosen)


def _tradeoff(
    scene: Scene, groups: Mapping[str, Sequence[Trial]], name: str, x: Axis, y: Axis, limit: float
) -> Chart | None:
    """Return a figure of designs over their settling time, a look for each group."""
    marks, looks = list[Mark](), zip([*charts.SERIES[:DRAWN], "muted"] * 2, MARKS * 2, strict=False)
    for (group, designs), next_look in zip(groups.items(), looks, strict=False):
        points = [(each, each.settling_time, float(getattr(each, name))) for each in designs]
        known = (point for point in points if math.isfinite(point[1] * point[2]))
        shown = [point for point in known if point[2] > 0.0 or y.scale != "log"]
        if shown:
            kept, times, values = zip(*shown, strict=True)
            look, shape = LOOKS.get(group, next_look)
            hover = tuple(f"{group}, {_place(scene, each)}" for each in kept)
            size = 11.0 if shape == "star" else 5.0
            marks.append(Curve(times, values, group, look, "", shape, size=size, hover=hover))
    line = charts.Limit(limit, "y", "the limit", "ink")
    return Chart("Designs", x, y, (*marks, line), PICTURE) if marks else None


def _map(own: Sequence[ChosenDesign], chosen: Collection[int]) -> Chart | None:
    """Return the worst share of the designs of one op-amp over the two keys that are searched."""
    found = {tuple(float(each.values[path]) for path in each.keys): each for each in own}
    x, y = (sorted(set(places)) for places in zip(*found, strict=True))
    values = [[found[a, b].worst if (a, b) in found else math.inf for a in x] for b in y]
    shares = np.where(np.isfinite(values), values, math.nan)
    if min(len(x), len(y)) < 2 or not np.isfinite(shares).any():
        return None
    stars = np.reshape([place for place, each in found.items() if each.place in chosen], (-1, 2))
    best = Curve(stars[:, 0], stars[:, 1], "among the best", charts.ORANGE, "", "star", size=11.0)
    C, gain = (Axis(NAMES[path], UNITS[path], "log") for path in own[0].keys)
    passing = f"{own[0].opamp}: {sum(each.good for each in own)} of {len(own)} designs pass"
    title = f"Worst value over its limit, {passing}"
    return Chart(title, C, gain, (charts.Grid(x, y, shares, "ratio", "log"), best), MAP, False)


def tuning_view(result: Tuned) -> Page:
    """Return the page of a tuning."""
    verdict = result.verdict
    verified = verdict_report(verdict, "taction design tune")
    before, after = result.before.settling_time, result.after.settling_time
    lead = banded("settles", verdict.measurements.band).capitalize()
    summary = f"{lead} in {figure(after, 's')}, before: {figure(before, 's')}. {verified.summary}"
    own = (
        Section("Tuning", tuple(_blocks(result))),
        Section("Trade-off", lambda: _tuned(result), media="page picture"),
    )
    return replace(
        verified,
        summary=summary,
        sections=(*own, *on_screen(verified, verdict)),
        foot=(*verified.foot, "more: --report FILE"),
    )


def _tuned(tuning: Tuned) -> Chart | None:
    """Return overshoot and settling time of every design that was tried."""
    groups = {
        "does not pass": [each for each in tuning.trials if not each.good],
        "passes": [each for each in tuning.trials if each.good],
        "before": [tuning.before],
        "after": [tuning.after],
    }
    x = Axis(banded("settling_time", tuning.scene.checks.settling_time.band), "s", "log")
    y = Axis("overshoot", "step")
    return _tradeoff(tuning.scene, groups, "overshoot", x, y, tuning.overshoot_limit)


def _blocks(tuning: Tuned) -> Iterator[Content]:
    units, circuit = {each.path: each.unit for each in tuning.ranges}, tuning.verdict.circuit
    columns: dict[str, Column] = {"design": lambda each: each[0]}
    for path, unit in units.items():
        columns[spaced(path.removeprefix("design."))] = partial(
            _value, path=path, unit=unit, digits=5
        )
    settling = banded("settling_time", tuning.scene.checks.settling_time.band)
    columns[settling] = lambda each: number_cell(each[1].settling_time, "s")
    columns["overshoot"] = lambda each: number_cell(finite(each[1].overshoot), "step", 3)
    designs = ("before", tuning.before), ("after", tuning.after)
    yield Table.of("Before and after", designs, columns)
    yield {
        "designs tried": str(tuning.tried),
        "limit of the overshoot": percent(tuning.overshoot_limit, 4),
        f"margin of {first_knob(circuit)}": f"{tuning.margin:g}",
        "lambda, unchanged": circuit.facts["lambda"].text,
    }
    new = {path: written(float(value), units[path]) for path, value in tuning.after.values.items()}
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


def _value(each: Trial | tuple[str, Trial], path: str, unit: str, digits: int) -> Cell:
    trial = each if isinstance(each, Trial) else each[1]
    return number_cell(float(trial.values[path]), unit, digits)


def scaling_view(result: Scaled) -> Page:
    """Return the page of the scalings, the loads, and what the checks say."""
    return Page(
        title=result.scene.name,
        command="taction scale",
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


SYMBOL_OF = {path: symbol for symbol, path in SYMBOLS.items()} | {"design.gain": "gain"}


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
    yield from (f"  {_change(scene, change)}" for change in remedies.changes)
    for searched in remedies.searches:
        if searched.complete and not searched.found:
            where, ends = "", (searched.least, searched.most)
            if None not in ends:
                unit = find_key(scene, searched.path).unit
                where = " from {} to {}".format(*(show(end or 0.0, unit, 3) for end in ends))
            yield f"  no tried value of {name_of(searched.path)}{where} makes the board pass"
    keys = ", ".join(name_of(each.path) for each in remedies.searches) or "no key"
    cut = ", ".join(name_of(each.path) for each in remedies.searches if not each.complete)
    rest = f"; not to the end: {cut} (--changes)" if cut else ""
    yield f"  searched {remedies.trials} changes of {keys}{rest}"
    if remedies.undecided:
        count = len(remedies.undecided)
        yield f"  {count} of them without a verdict, such as: {remedies.undecided[0]}"


def _change(scene: Scene, change: Change) -> str:
    values = {path: v for path, v in change.values.items() if path != "design.lambda"}
    pairs = (values or change.values).items()
    text = " and ".join(key_with_value(scene, path, value) for path, value in pairs)
    if change.resistance is not None:
        text += f" with R = {show(change.resistance, 'ohm')}"
    return f"{text} (verified)"


def key_with_value(scene: Scene, path: str, value: Value) -> str:
    """Return ``"C = 9.76 pF"``."""
    if isinstance(value, float):
        value = show(value, find_key(scene, path).unit)
    return f"{name_of(path)} = {value}"


def name_of(path: str) -> str:
    """Return the symbol of a key, or the last part of its path."""
    return SYMBOL_OF.get(path, path.removeprefix("design.").removeprefix("opamp."))
