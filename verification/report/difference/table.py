"""The difference of two verdicts as text."""

from __future__ import annotations

from rich.console import Console
from rich.text import Text

from taction.verification.report.tables import make_table, spaced, value_text, whole
from taction.verification.studies.difference import KeyDifference, VerdictDifference
from taction.verification.verdict.compare import Difference

WORDS = {True: "yes", False: "no", None: "unknown"}


def print_difference(difference: VerdictDifference, console: Console) -> None:
    """Print the keys that differ, then the readings that are not the same."""
    console.print(Text(f"A: {difference.first}\nB: {difference.second}", style="bold"))
    if difference.keys is None:
        console.print(Text("keys: unknown; a document of an older taction has none"))
    elif not difference.keys:
        console.print(Text("keys: no difference"))
    else:
        console.print(make_table(whole("key", "A", "B"), map(_key_row, difference.keys)))
    shown = [reading for reading in difference.readings if reading.first != reading.second]
    if shown:
        titles = whole("reading", "A", "B", "B - A", "±", "beyond ±")
        console.print(make_table(titles, map(_row, shown)))
    equal = len(difference.readings) - len(shown)
    beyond = sum(reading.beyond is True for reading in shown)
    unknown = sum(reading.beyond is None for reading in shown)
    text = f"{len(difference.readings)} readings: {equal} equal,"
    text += f" {len(shown) - beyond - unknown} within their uncertainties, {beyond} beyond"
    console.print(Text(text + (f", {unknown} unknown" if unknown else ""), style="bold"))


def _key_row(key: KeyDifference) -> tuple[Text, ...]:
    first, second = (value_text(value, key.unit or "", 6) for value in (key.first, key.second))
    if key.content:
        second += " (another content)"
    return Text(key.key), Text(first), Text(second)


def _row(reading: Difference) -> tuple[str, ...]:
    name, values = spaced(reading.name), (reading.first, reading.second)
    if reading.group == "checks":
        name = f"check {name}"
    return (
        f"u_{reading.channel} {name}" if reading.channel else name,
        *(value_text(value, reading.unit, 6) for value in values),
        value_text(reading.difference, reading.unit, 3),
        value_text(reading.allowed, reading.unit, 2),
        WORDS[reading.beyond],
    )
