"""Corners: least, typical and largest values against the limits, and the parts behind them."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Sequence
from functools import partial
from typing import Any

from taction.verification.report.blocks import (
    BOTH,
    PAGE,
    TERMINAL,
    Bars,
    Block,
    Cell,
    Notes,
    Page,
    Section,
    Table,
)
from taction.verification.report.texts import counted, fields, number_cell, outcome_cell, spaced
from taction.verification.report.views.montecarlo import spread_bar
from taction.verification.report.views.origin import origin_section
from taction.verification.studies.tolerance.corners import Corner, CornerStudy
from taction.verification.studies.tolerance.samples import Quantity

WORST = ("fail", "inconclusive", "pass")
RANGES = "The bar is the part of the limit that the worst corner uses; typical: the nominal board."
MOST = 200  # deviations in a table
SHOWN = 4  # worst-case directions in a terminal


def view(study: CornerStudy) -> Page:
    """Return the page of the corners of a scene."""
    corners = study.corners
    outcomes = [corner.result.outcome for corner in corners]
    outcome = next((each for each in WORST if each in outcomes), "")
    counts = ", ".join(f"{outcomes.count(each)} {each}" for each in WORST if each in outcomes)
    return Page(
        title=study.name,
        command="taction yield corners",
        outcome=outcome,
        summary=f"{counted(len(corners), 'corner')}: {counts}.",
        lines=("Every component at an end of its tolerance, as it makes a quantity worst.",),
        sections=(
            Section("Least, typical and largest values", lambda: ranges(study)),
            Section("Corners", tuple(tables(study.quantities, corners)), media=BOTH),
            Section("Channels at rest", (directions(study),), media=BOTH),
            Section("Deviations", (_deviations(corners),)),
            origin_section(study.scene),
        ),
    )


def ranges(study: CornerStudy) -> Iterator[Block]:
    """Yield the least, typical and largest values of the corners, against the limits."""
    rows = []
    for each in study.quantities:
        found = [corner.result.value(each.name) for corner in study.corners]
        if values := [value for value in found if value is not None and math.isfinite(value)]:
            nominal = found[0] if found[0] in values else values[0]
            shown = {"least": min(values), "typical": nominal, "largest": max(values)}
            lost = len(found) - len(values)
            missing = f"{lost} corners without a value" if lost else ""
            rows.append(spread_bar(each.title, each.unit, shown, each.limits, missing))
    yield Bars("", tuple(rows), RANGES)


def tables(reported: Sequence[Quantity], corners: Sequence[Corner]) -> Iterator[Block]:
    """Yield the corners with their values, and why they do not pass."""
    columns: dict[str, Callable[[Corner], Any]] = {
        "corner": _name,
        "outcome": lambda corner: outcome_cell(corner.result.outcome),
    }
    columns |= {each.title: partial(_quantity, each) for each in reported}
    yield Table.of("Corners", corners, columns)
    yield Notes("Why, and most moved by", tuple(filter(None, map(_remark, corners))))


def _quantity(quantity: Quantity, corner: Corner) -> Cell:
    return number_cell(corner.result.value(quantity.name), quantity.unit)


def _name(corner: Corner) -> str:
    """Return the name of a corner in words, and a user's own name unchanged."""
    return spaced(corner.name) if corner.quantity else corner.name


def _remark(corner: Corner) -> str:
    """Return why a corner does not pass, and the parts behind it."""
    failed, largest = corner.result.failed, " ".join(corner.largest)
    verb = "not decided: " if corner.result.undecided else "fails "
    remarks = (
        corner.result.lost,
        f"{verb}{', '.join(map(spaced, failed))}" if failed else "",
        f"most moved by {largest}" if largest else "",
    )
    return f"{_name(corner)}: {'; '.join(filter(None, remarks))}" if any(remarks) else ""


def directions(study: CornerStudy, names: Sequence[str] = ()) -> Table:
    """Return the errors of the channels at rest, the largest first; `names` are those of decks."""
    columns = {
        "channel": lambda each: Cell(
            names[each.channel - 1] if names else f"u{each.channel}", each.channel
        ),
        "side of the reference": lambda each: "above" if each.sign > 0 else "below",
        **fields("first order = predicted step; solved step"),
        "most moved by": lambda each: " ".join(each.largest),
    }
    note, title = "Worst-case errors at rest, from the signs of the sensitivities.", "Largest error"
    most, more = {TERMINAL: SHOWN}, "{} smaller ones: --json."
    return Table.of(f"{title} of each channel at rest", study.directions, columns, note, most, more)


def _deviations(corners: Sequence[Corner]) -> Table:
    """Return the deviations, in tolerances, with a column for each corner."""
    moved = [corner for corner in corners if corner.deviations]
    names = list(dict.fromkeys(name for corner in moved for name in corner.deviations))
    columns: dict[str, Callable[[str], Any]] = {"part": str}
    columns |= {_name(corner): partial(_deviation, corner) for corner in moved}
    note, most = "In tolerances of the part.", {PAGE: MOST}
    return Table.of("Deviations", names, columns, note, most, "{} more parts: --json.")


def _deviation(corner: Corner, part: str) -> Cell | None:
    value = corner.deviations.get(part)
    return None if value is None else Cell(f"{value:+g}", value)
