"""The report of corners: least, typical and largest values against the limits."""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence

from taction.netlist_gen.scene.scene import Scene
from taction.verification.report.html.blocks import (
    Block,
    Cell,
    Range,
    Ranges,
    Report,
    Section,
    Table,
)
from taction.verification.report.html.ranges import value_range
from taction.verification.report.html.sections.origin import origin_section
from taction.verification.report.html.texts import counted, number_cell, outcome_cell
from taction.verification.report.tables import spaced
from taction.verification.studies.tolerance.corners import Corner, CornerStudy
from taction.verification.studies.tolerance.varied_board import Quantity, quantities
from taction.verification.studies.tolerance.yield_report import limits_of

WORST = ("fail", "inconclusive", "pass")
MOST = 200  # deviations in a table


def corners_report(scene: Scene, study: CornerStudy) -> Report:
    """Return the report of the corners of `scene`."""
    corners = study.corners
    outcomes = [corner.result.outcome for corner in corners]
    outcome = next((each for each in WORST if each in outcomes), "")
    counts = ", ".join(f"{outcomes.count(each)} {each}" for each in WORST if each in outcomes)
    return Report(
        title=scene.name,
        command="taction corners",
        outcome=outcome,
        summary=f"{counted(len(corners), 'corner')}: {counts}.",
        lines=("Every component at an end of its tolerance, as it makes a quantity worst.",),
        sections=(
            Section("Least, typical and largest values", tuple(_ranges(scene, corners))),
            Section("Corners", tuple(_tables(scene, corners))),
            *([Section("Channels at rest", (_directions(study),))] if study.directions else []),
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


def _tables(scene: Scene, corners: Sequence[Corner]) -> Iterator[Block]:
    reported = quantities(scene)
    titles = (
        "corner",
        "outcome",
        *(spaced(each.name) for each in reported),
        "why",
        "most moved by",
    )
    rows = tuple(
        (
            Cell(spaced(corner.name)),
            outcome_cell(corner.result.outcome),
            *(number_cell(corner.result.value(each.name), each.unit) for each in reported),
            Cell(corner.result.lost or ", ".join(map(spaced, corner.result.failed))),
            Cell(" ".join(corner.largest)),
        )
        for corner in corners
    )
    yield Table("Corners", titles, rows)


def _directions(study: CornerStudy) -> Table:
    rows = tuple(
        (
            Cell(f"u{each.channel}", each.channel),
            Cell("above" if each.sign > 0 else "below"),
            number_cell(each.predicted, "step"),
            number_cell(each.solved, "step"),
            Cell(" ".join(each.largest)),
        )
        for each in study.directions
    )
    titles = ("channel", "side of the reference", "predicted", "solved", "most moved by")
    return Table("Largest error of each channel at rest", titles, rows)


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
    yield Table("Deviations", ("part", *(spaced(corner.name) for corner in moved)), rows, note)


def _deviation(value: float | None) -> Cell:
    return Cell("–") if value is None else Cell(f"{value:+g}", value)
