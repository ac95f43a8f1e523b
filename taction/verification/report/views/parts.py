"""The parts of a board: values, references, packages, power; also as CSV with KiCad's columns."""

from __future__ import annotations

import csv
import io
from collections.abc import Callable, Iterator
from typing import Any

from taction.netlist_gen.board.bill_of_materials import UNITS, BillOfMaterials, PartLine
from taction.netlist_gen.kicad.parts import printed_value
from taction.verification.report.blocks import BOTH, Cell, Notes, Page, Section, Table
from taction.verification.report.texts import counted, fields, percent, quantity
from taction.verification.verdict.board_power import BoardPower, PartsList

SHOWN = 3  # references in a line of the table
DIGITS = 6  # of a value in a file; the JSON document has all of them
# The fields of KiCad's bill of materials, then our own; a footprint is not known.
COLUMNS = (
    *("Reference", "Value", "Footprint", "Quantity", "DNP"),
    *("Kind", "Unit", "Tolerance", "Preferred", "Series", "Deviation"),
)


def view(result: PartsList) -> Page:
    """Return the page of the parts of a board."""
    parts, power = result.parts, result.power
    columns = part_columns(SHOWN, "not a standard value; nearest")
    return Page(
        title=result.scene.name,
        command="taction export bom",
        summary=counts_text(parts),
        sections=(
            Section("Parts", (Table.of("Parts", parts.lines, columns),), media=BOTH),
            Section("Board", (Notes("", tuple(_lines(parts, power))),), media=BOTH),
        ),
    )


def counts_text(parts: BillOfMaterials) -> str:
    """Return how many parts and values there are, and how many are not standard."""
    counts = " and ".join(f"{parts.count(kind)} {kind}s" for kind in UNITS)
    odd = sum(line.preferred is not None for line in parts.lines)
    remedy = "; set resistor_series and capacitor_series" if odd else ""
    return f"{counts} of {len(parts.lines)} values; not a standard value: {odd}{remedy}"


def _lines(parts: BillOfMaterials, power: BoardPower) -> Iterator[str]:
    """Yield the packages, the power and what is not listed."""
    yield packages_text(parts)
    yield (
        f"supply current {quantity(power.supply_current, 'A', 3)}, dissipation"
        f" {quantity(power.total, 'W', 3)} at rest: op-amps {quantity(power.quiescent, 'W', 3)}"
        f" quiescent and {quantity(power.outputs, 'W', 3)} by their load,"
        f" resistors {quantity(power.resistors, 'W', 3)}"
    )
    yield from (f"not included: {what}" for what in parts.not_listed)


def packages_text(parts: BillOfMaterials) -> str:
    """Return the packages of op-amps, and the op-amps without use."""
    names = [package.reference for package in parts.packages]
    shown = names[0] if len(names) == 1 else f"{names[0]} to {names[-1]}"
    spare = f"; spare op-amps: {parts.spare} in {names[-1]}" if parts.spare else ""
    return f"{counted(len(names), 'package')} {parts.opamp}, {shown}{spare}"


def part_columns(shown: int, nearest: str, standard: str = "") -> dict[str, Callable[[Any], Any]]:
    """Return the columns of the parts of one value, of which `shown` have their names.

    The column `nearest` has the nearest value that is sold, or `standard` for a value of a series.
    """

    def names(line: PartLine) -> str:
        more = len(line.references) - shown
        return " ".join(line.references[:shown]) + (f" and {more} more" if more > 0 else "")

    def sold(line: PartLine) -> str:
        if (near := line.preferred) is None:
            return standard
        return f"{near.series}: {quantity(near.value, line.unit)} ({100 * near.deviation:+.2g} %)"

    return {
        **fields("part = kind; value @unit"),
        "count": lambda line: len(line.references),
        "tolerance": lambda line: (
            None if line.tolerance is None else Cell(percent(line.tolerance), line.tolerance)
        ),
        nearest: sold,
        "references": names,
    }


def parts_csv(parts: BillOfMaterials) -> str:
    """Return the parts as CSV, one row for each value, the op-amps last; values have prefixes."""
    text = io.StringIO()
    table = csv.DictWriter(text, COLUMNS, restval="", lineterminator="\n")
    table.writeheader()
    table.writerows(_records(parts))
    return text.getvalue()


def _records(parts: BillOfMaterials) -> Iterator[dict[str, Any]]:
    packages = tuple(package.reference for package in parts.packages)
    opamps = {"Value": parts.opamp.upper(), "Kind": "op-amp"}
    rows = [(line.references, _record(line)) for line in parts.lines] + [(packages, opamps)]
    for names, record in rows:
        yield {"Reference": ",".join(names), "Quantity": len(names), **record}


def _record(line: PartLine) -> dict[str, Any]:
    record: dict[str, Any] = {"Value": printed_value(line.value, DIGITS), "Kind": line.kind}
    record["Unit"] = line.unit
    if line.tolerance is not None:
        record["Tolerance"] = repr(line.tolerance)
    if (near := line.preferred) is not None:
        record |= {"Preferred": printed_value(near.value, DIGITS), "Series": near.series}
        record["Deviation"] = f"{near.deviation:.3g}"
    return record
