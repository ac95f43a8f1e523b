"""Corners: least, typical and largest values against the limits, and the parts behind them."""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence

from taction.netlist_gen.scene.scene import Scene
from taction.verification.report.blocks import (
    PAGE,
    TERMINAL,
    Block,
    Cell,
    Notes,
    Page,
    Range,
    Ranges,
    Section,
    Table,
)
from taction.verification.report.texts import counted, number_cell, outcome_cell, spaced
from taction.verification.report.views.montecarlo import value_range
from taction.verification.report.views.origin import origin_section
from taction.verification.studies.tolerance.corners import Corner, CornerStudy
from taction.verification.studies.tolerance.varied_board import Quantity, quantities
from taction.verification.studies.tolerance.yield_report import limits_of

WORST = ("fail", "inconclusive", "pass")
MOST = 200  # deviations in a table
SHOWN = 4  # worst-case directions in a terminal


def view(scene: Scene, study: CornerStudy) -> Page:
    """Return the page of the corners of `scene`."""
    corners = study.corners
    outcomes = [corner.result.outcome for corner in corners]
    outcome = next((each for each in WORST if each in outcomes), "")
    counts = ", ".join(f"{outcomes.count(each)} {each}" for each in WORST if each in outcomes)
    short, whole = (directions(study, most) for most in (SHOWN, len(study.directions)))
    return Page(
        title=scene.name,
        command="taction corners",
        outcome=outcome,
        summary=f"{counted(len(corners), 'corner')}: {counts}.",
        lines=("Every component at an end of its tolerance, as it makes a quantity worst.",),
        sections=(
            Section("Least, typical and largest values", lambda: _ranges(scene, corners)),
            Section("Corners", tuple(tables(quantities(scene), corners)), media=(TERMINAL, PAGE)),
            Section("Channels at rest", tuple(short), media=(TERMINAL,)),
            Section("Channels at rest", tuple(whole)),
            Section("Deviations", tuple(_deviations(corners))),
            origin_section(scene),
        ),
    )


def _ranges(scene: Scene, corners: Sequence[Corner]) -> Iterator[Block]:
    rows = [row for each in quantities(scene) if (row := _range(scene, each, corners)) is not None]
    note = "The line in the bar is the nominal board, the black line the limit."
    yield Ranges("", tuple(rows), note)


def _range(scene: Scene, quantity: Quantity, corners: Sequence[Corner]) -> Range | None:
    found = [corner.result.value(quantity.name) for corner in corners]
    values = [value for value in found if value is not None and math.isfinite(value)]
    if not values:
        return None
    nominal = found[0] if found[0] in values else values[0]
    count = len(found) - len(values)
    shown = {"least": min(values), "typical": nominal, "largest": max(values)}
    missing = f"{count} corners without a value" if count else ""
    return value_range(
        quantity.name, quantity.unit, shown, limits_of(scene, quantity.name), missing
    )


def tables(reported: Sequence[Quantity], corners: Sequence[Corner]) -> Iterator[Block]:
    """Yield the corners with their values, and why they do not pass."""
    names = (spaced(each.name) for each in reported)
    rows = tuple(
        (
            Cell(_name(corner)),
            outcome_cell(corner.result.outcome),
            *(number_cell(corner.result.value(each.name), each.unit) for each in reported),
        )
        for corner in corners
    )
    yield Table("Corners", ("corner", "outcome", *names), rows)
    lines = tuple(line for corner in corners if (line := _remark(corner)))
    if lines:
        yield Notes("Why, and most moved by", lines)


def _name(corner: Corner) -> str:
    """Return the name of a corner in words, and a user's own name unchanged."""
    return spaced(corner.name) if corner.quantity else corner.name


def _remark(corner: Corner) -> str:
    """Return why a corner does not pass, and the parts behind it."""
    failed, largest = corner.result.failed, " ".join(corner.largest)
    remarks = (
        corner.result.lost,
        f"fails {', '.join(map(spaced, failed))}" if failed else "",
        f"most moved by {largest}" if largest else "",
    )
    return f"{_name(corner)}: {'; '.join(filter(None, remarks))}" if any(remarks) else ""


def directions(study: CornerStudy, most: int) -> Iterator[Block]:
    """Yield the `most` largest errors of the channels at rest."""
    rows = tuple(
        (
            Cell(f"u{each.channel}", each.channel),
            Cell("above" if each.sign > 0 else "below"),
            number_cell(each.predicted, "step"),
            number_cell(each.solved, "step"),
            Cell(" ".join(each.largest)),
        )
        for each in study.directions[:most]
    )
    if rows:
        titles = ("channel", "side of the reference", "first order", "solved", "most moved by")
        more = len(study.directions) - most
        note = "Worst-case errors at rest, from the signs of the sensitivities."
        note += f" {more} smaller ones: --json." if more > 0 else ""
        yield Table("Largest error of each channel at rest", titles, rows, note)


def _deviations(corners: Sequence[Corner]) -> Iterator[Block]:
    """Yield one table of the deviations, in tolerances, with a column for each corner."""
    moved = [corner for corner in corners if corner.deviations]
    names = list(dict.fromkeys(name for corner in moved for name in corner.deviations))
    rows = tuple(
        (Cell(name), *(_deviation(corner.deviations.get(name)) for corner in moved))
        for name in names[:MOST]
    )
    more = len(names) - MOST
    note = "In tolerances of the part." + (f" {more} more parts: --json." if more > 0 else "")
    yield Table("Deviations", ("part", *map(_name, moved)), rows, note)


def _deviation(value: float | None) -> Cell:
    return Cell("–") if value is None else Cell(f"{value:+g}", value)
