"""The difference of two boards: the keys or parts that differ, then the readings that do."""

from __future__ import annotations

from collections.abc import Iterable, Iterator

import numpy as np

from taction.system.array_types import Floats
from taction.system.charts import TIME, Axis, Chart, Curve, Line, Outcome, spread_colours, thinned
from taction.verification.report.blocks import BOTH, DRAWN, Block, Cell, Notes, Page, Section, Table
from taction.verification.report.texts import (
    is_small,
    outcome_cell,
    quantity,
    readable,
    spaced,
    value_text,
)
from taction.verification.report.views.waveforms_view import channel_names, end_names
from taction.verification.studies.difference import VerdictDifference
from taction.verification.verdict.compare import Difference

NAMED = 3  # keys in the first line
POINTS = 20_000  # of all curves of one board
LABELLED = 12  # outputs above which curves have no names beside them
BEYOND: dict[bool | None, tuple[str, Outcome]] = {
    True: ("yes", "fail"),
    False: ("no", "pass"),
    None: ("unknown", "inconclusive"),
}
EXITS: dict[int, Outcome] = {0: "pass", 1: "fail", 3: "inconclusive"}


def view(difference: VerdictDifference) -> Page:
    """Return the page of a difference."""
    return Page(
        title=f"{difference.first} and {difference.second}",
        command="taction diff",
        outcome=EXITS[difference.exit_status],
        summary=_edited(difference) + _summary(difference),
        lines=(f"A: {difference.first}", f"B: {difference.second}", *difference.notes),
        sections=(
            Section("Keys", (_keys(difference),), media=BOTH),
            Section("Readings", (_readings(difference),), media=BOTH),
            Section("Waveforms", lambda: _waveforms(difference), media=DRAWN),
        ),
    )


def _edited(difference: VerdictDifference) -> str:
    """Return the keys or parts that differ, with both values, and the outcomes if these differ."""
    keys = difference.keys or ()
    texts = [
        f"{k.key} {_text(k.first, k.unit, 6)} → {_text(k.second, k.unit, 6)}"
        for k in keys[:NAMED]
        if not k.content
    ]
    texts += [f"{len(keys) - NAMED} more"] if len(keys) > NAMED else []
    outcomes = (each for each in difference.readings if each.name == "outcome")
    texts += [f"{each.first} → {each.second}" for each in outcomes if each.first != each.second]
    return f"{', '.join(texts)}; " if texts else ""


def _summary(difference: VerdictDifference) -> str:
    shown = [reading for reading in difference.readings if reading.first != reading.second]
    equal = len(difference.readings) - len(shown)
    beyond = sum(reading.beyond is True for reading in shown)
    unknown = sum(reading.beyond is None for reading in shown)
    text = f"{len(difference.readings)} readings: {equal} equal,"
    text += f" {len(shown) - beyond - unknown} within their uncertainties, {beyond} beyond"
    return text + (f", {unknown} unknown" if unknown else "")


def _keys(difference: VerdictDifference) -> Block:
    if difference.keys is None:
        return Notes("", ("parts: not compared; a record has none",))
    if not difference.keys:
        return Notes("", ("keys: no difference",))
    columns = {
        "key": lambda each: each.key,
        "A": lambda each: _text(each.first, each.unit, 6),
        "B": lambda each: _text(each.second, each.unit, 6) + " (another content)" * each.content,
    }
    return Table.of("Keys", difference.keys, columns)


def _readings(difference: VerdictDifference) -> Table:
    columns = {
        "reading": lambda each: _name(each, difference.outputs),
        "A": lambda each: _text(each.first, each.unit, 6),
        "B": lambda each: _text(each.second, each.unit, 6),
        "B - A": lambda each: Cell(_text(each.difference, each.unit, 3), each.difference),
        "±": allowed_cell,
        "beyond ±": lambda each: outcome_cell(*BEYOND[each.beyond]),
    }
    changed = (each for each in difference.readings if each.first != each.second)
    return Table.of("Readings", changed, columns)


def allowed_cell(reading: Difference) -> Cell:
    """Return the sum of the bounds of both readings."""
    size = max((abs(x) for x in (reading.first, reading.second) if isinstance(x, float)), default=0)
    small = bool(reading.allowed) and is_small(reading.allowed, size, reading.unit)
    text = "1 ppm or better" if small else _text(reading.allowed, reading.unit, 2)
    return Cell(text, reading.allowed)


def _name(reading: Difference, outputs: tuple[str, ...]) -> str:
    if reading.group == "waveforms":
        return f"waveform {reading.name}, {reading.note}"
    name = f"check {spaced(reading.name)}" if reading.group == "checks" else spaced(reading.name)
    name = f"{name} {reading.note}".rstrip()
    if not reading.channel:
        return name
    return f"{outputs[reading.channel - 1] if outputs else f'u_{reading.channel}'} {name}"


def _waveforms(difference: VerdictDifference) -> Iterator[Block]:
    """Yield the outputs of both over time, and B minus A, where both have waveforms."""
    first, second = (each and each() for each in difference.curves)
    if not first or not second:
        text = "No waveforms: one of them is a stored verdict, or leaves the range of floats."
        yield Notes("", (text,))
        return
    (time, u), (other, v) = first, second
    count = min(u.shape[1], v.shape[1])
    names = difference.outputs or [f"u_{n + 1}" for n in range(count)]
    colours = spread_colours(count)

    def curves(x: Floats, values: Floats, line: Line, width: float) -> Iterator[Curve]:
        for n, look in enumerate(colours):
            shown = thinned(x, values[:, n], POINTS // count)
            yield Curve(*shown, names[n], look, line, width=width, label="")

    def named(group: Iterable[int]) -> str:
        return ", ".join(names[n] for n in group) if difference.outputs else channel_names(group)

    both = np.concatenate([u[:, :count], v[:, :count]])
    ends = u[-1, :count].tolist(), float(both.min()), float(both.max())
    marks = [*curves(time, u, "solid", 2.2), *curves(other, v, "dash", 1.2)]
    texts = tuple(end_names(*ends, colours, named)) if count <= LABELLED else ()
    text = f"Solid: A, {difference.first}. Dashed: B, {difference.second}."
    volts, said = Axis("output", "V"), "solid A, dashed B"
    yield Chart("Outputs", TIME, volts, (*marks, *texts), said, text, height=420)
    inside = time[(time >= other[0]) & (time <= other[-1])]
    if len(inside):
        places = np.searchsorted(time, inside)
        apart = [np.interp(inside, other, v[:, n]) - u[places, n] for n in range(count)]
        moved = tuple(curves(inside, np.column_stack(apart), "solid", 1.2))
        said = f"apart by at most {quantity(float(np.abs(apart).max()), 'V', 3)}"
        text = "The outputs of B minus those of A."
        yield Chart("B minus A", TIME, Axis("difference", "V"), moved, said, text)


def _text(value: object, unit: str | None, digits: int) -> str:
    return readable(value_text(value, unit or "", digits))
