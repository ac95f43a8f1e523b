"""The report of corners: least, typical and largest values against the limits."""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence

from netlist_gen.scene.scene import Scene
from verification.report.html.blocks import Block, Cell, Range, Ranges, Report, Section, Table
from verification.report.html.sections.origin import origin_section
from verification.report.html.texts import figure, number_cell, outcome_cell
from verification.report.tables import spaced
from verification.studies.tolerance.corners import Corner
from verification.studies.tolerance.varied_board import Quantity, quantities
from verification.studies.tolerance.yield_report import limits_of

MARGIN = 1.15  # of the largest value or limit: the width of a range
WORST = ("fail", "inconclusive", "pass")
MOST = 200  # deviations in a table


def corners_report(scene: Scene, corners: Sequence[Corner]) -> Report:
    """Return the report of the corners of `scene`."""
    outcomes = [corner.result.outcome for corner in corners]
    outcome = next((each for each in WORST if each in outcomes), "")
    counts = ", ".join(f"{outcomes.count(each)} {each}" for each in WORST if each in outcomes)
    return Report(
        title=scene.name,
        command="taction corners",
        outcome=outcome,
        summary=f"{len(corners)} corners: {counts}.",
        lines=("Every component at an end of its tolerance, as it makes a quantity worst.",),
        sections=(
            Section("Least, typical and largest values", tuple(_ranges(scene, corners))),
            Section("Corners", tuple(_tables(scene, corners))),
            Section("Deviations", tuple(_deviations(corners))),
            origin_section(scene),
        ),
    )


def _ranges(scene: Scene, corners: Sequence[Corner]) -> Iterator[Block]:
    rows = [row for each in quantities(scene) if (row := _range(scene, each, corners)) is not None]
    note = "The line in the bar is the nominal board, the black line the limit."
    yield Ranges("", tuple(rows), note)


def _range(scene: Scene, quantity: Quantity, corners: Sequence[Corner]) -> Range | None:
    found = [getattr(corner.result, quantity.name) for corner in corners]
    values = [value for value in found if value is not None and math.isfinite(value)]
    if not values:
        return None
    nominal = found[0] if found[0] in values else values[0]
    limits = [each for each in limits_of(scene, quantity.name) if each is not None]
    bottom, top = min(0.0, *values, *limits), MARGIN * max(0.0, *values, *limits)
    width = (top - bottom) or 1.0
    least, most = limits_of(scene, quantity.name)
    beyond = (most is not None and max(values) > most) or (
        least is not None and min(values) < least
    )
    missing = len(found) - len(values)
    texts = [
        f"least {figure(min(values), quantity.unit)}",
        f"typical {figure(nominal, quantity.unit)}",
        f"largest {figure(max(values), quantity.unit)}",
        *(f"limit {figure(limit, quantity.unit)}" for limit in limits),
        *([f"{missing} corners without a value"] if missing else []),
    ]
    return Range(
        spaced(quantity.name),
        (min(values) - bottom) / width,
        (nominal - bottom) / width,
        (max(values) - bottom) / width,
        tuple((limit - bottom) / width for limit in limits),
        ("fail" if beyond or missing else "pass") if limits else "",
        tuple(texts),
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
            *(number_cell(getattr(corner.result, each.name), each.unit) for each in reported),
            Cell(corner.result.reason or ", ".join(map(spaced, corner.result.failed))),
            Cell(" ".join(corner.largest)),
        )
        for corner in corners
    )
    yield Table("Corners", titles, rows)


def _deviations(corners: Sequence[Corner]) -> Iterator[Block]:
    for corner in corners:
        if corner.deviations:
            rows = tuple(
                (Cell(name), Cell(f"{value:+g}", value))
                for name, value in list(corner.deviations.items())[:MOST]
            )
            more = len(corner.deviations) - len(rows)
            note = f"and {more} more (--json has all)" if more > 0 else ""
            yield Table(spaced(corner.name), ("part", "deviation in tolerances"), rows, note)
