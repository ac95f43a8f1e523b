"""The difference of two verdicts: the keys that differ, then the readings that are not the same."""

from __future__ import annotations

from collections.abc import Iterator

from taction.verification.report.blocks import (
    PAGE,
    TERMINAL,
    Block,
    Cell,
    Notes,
    Page,
    Section,
    Table,
)
from taction.verification.report.charts import Outcome
from taction.verification.report.texts import readable, spaced, value_text
from taction.verification.studies.difference import KeyDifference, VerdictDifference
from taction.verification.verdict.compare import Difference

BEYOND: dict[bool | None, tuple[str, Outcome]] = {
    True: ("yes", "fail"),
    False: ("no", "pass"),
    None: ("unknown", "inconclusive"),
}
EXITS: dict[int, Outcome] = {0: "pass", 1: "fail", 3: "inconclusive"}
BOTH = (TERMINAL, PAGE)


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
            Section("Readings", tuple(_readings(difference)), media=BOTH),
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
    return Table("Keys", ("key", "A", "B"), tuple(map(_key_row, difference.keys)))


def _key_row(key: KeyDifference) -> tuple[Cell, ...]:
    first, second = (_text(value, key.unit or "", 6) for value in (key.first, key.second))
    return Cell(key.key), Cell(first), Cell(second + " (another content)" * key.content)


def _readings(difference: VerdictDifference) -> Iterator[Block]:
    rows = tuple(_row(each) for each in difference.readings if each.first != each.second)
    if rows:
        yield Table("Readings", ("reading", "A", "B", "B - A", "±", "beyond ±"), rows)


def _row(reading: Difference) -> tuple[Cell, ...]:
    name = f"check {spaced(reading.name)}" if reading.group == "checks" else spaced(reading.name)
    word, outcome = BEYOND[reading.beyond]
    return (
        Cell(f"u_{reading.channel} {name}" if reading.channel else name),
        *(Cell(_text(value, reading.unit, 6)) for value in (reading.first, reading.second)),
        Cell(_text(reading.difference, reading.unit, 3), reading.difference),
        Cell(_text(reading.allowed, reading.unit, 2), reading.allowed),
        Cell(word, None, outcome),
    )


def _text(value: object, unit: str, digits: int) -> str:
    return readable(value_text(value, unit, digits))
