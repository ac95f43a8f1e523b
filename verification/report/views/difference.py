"""The difference of two verdicts: the keys that differ, then the readings that are not the same."""

from __future__ import annotations

from collections.abc import Callable

from taction.verification.report.blocks import BOTH, Block, Cell, Notes, Page, Section, Shown, Table
from taction.verification.report.charts import Outcome
from taction.verification.report.texts import outcome_cell, readable, spaced, value_text
from taction.verification.studies.difference import KeyDifference, VerdictDifference
from taction.verification.verdict.compare import Difference

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
        summary=_summary(difference),
        lines=(f"A: {difference.first}", f"B: {difference.second}"),
        sections=(
            Section("Keys", (_keys(difference),), media=BOTH),
            Section("Readings", (_readings(difference),), media=BOTH),
        ),
    )


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
        return Notes("", ("keys: unknown; a document of an older taction has none",))
    if not difference.keys:
        return Notes("", ("keys: no difference",))
    columns: dict[str, Callable[[KeyDifference], Shown]] = {
        "key": lambda each: each.key,
        "A": lambda each: _text(each.first, each.unit or "", 6),
        "B": lambda each: (
            _text(each.second, each.unit or "", 6) + " (another content)" * each.content
        ),
    }
    return Table.of("Keys", difference.keys, columns)


def _readings(difference: VerdictDifference) -> Table:
    columns: dict[str, Callable[[Difference], Shown]] = {
        "reading": _name,
        "A": lambda each: _text(each.first, each.unit, 6),
        "B": lambda each: _text(each.second, each.unit, 6),
        "B - A": lambda each: Cell(_text(each.difference, each.unit, 3), each.difference),
        "±": lambda each: Cell(_text(each.allowed, each.unit, 2), each.allowed),
        "beyond ±": lambda each: outcome_cell(*BEYOND[each.beyond]),
    }
    changed = (each for each in difference.readings if each.first != each.second)
    return Table.of("Readings", changed, columns)


def _name(reading: Difference) -> str:
    name = f"check {spaced(reading.name)}" if reading.group == "checks" else spaced(reading.name)
    return f"u_{reading.channel} {name}" if reading.channel else name


def _text(value: object, unit: str, digits: int) -> str:
    return readable(value_text(value, unit, digits))
