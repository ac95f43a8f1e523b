"""The parts of a board: values, references, packages, power; also as CSV with KiCad's columns."""

from __future__ import annotations

import csv
import io
from collections.abc import Iterator
from typing import Any

from taction.netlist_gen.board.bill_of_materials import UNITS, BillOfMaterials, PartLine, Preferred
from taction.verification.report.blocks import PAGE, TERMINAL, Cell, Notes, Page, Section, Table
from taction.verification.report.texts import quantity
from taction.verification.verdict.board_power import BoardPower

SHOWN = 3  # references in a line of the table
# The fields of KiCad's bill of materials, then our own; a footprint is not known.
COLUMNS = (
    *("Reference", "Value", "Footprint", "Quantity", "DNP"),
    *("Kind", "Unit", "Tolerance", "Preferred", "Series", "Deviation"),
)


def view(name: str, parts: BillOfMaterials, power: BoardPower) -> Page:
    """Return the page of the parts of the scene `name`."""
    titles = ("part", "value", "count", "tolerance", "references", "not a standard value; nearest")
    table = Table("Parts", titles, tuple(map(_row, parts.lines)))
    return Page(
        title=name,
        command="taction bom",
        outcome="",
        summary=_counts(parts),
        lines=(),
        sections=(
            Section("Parts", (table,), media=(TERMINAL, PAGE)),
            Section("Board", (Notes("", tuple(_lines(parts, power))),), media=(TERMINAL, PAGE)),
        ),
    )


def _counts(parts: BillOfMaterials) -> str:
    counts = " and ".join(f"{parts.count(kind)} {kind}s" for kind in UNITS)
    odd = sum(line.preferred is not None for line in parts.lines)
    remedy = "; set resistor_series and capacitor_series" if odd else ""
    return f"{counts} of {len(parts.lines)} values; not a standard value: {odd}{remedy}"


def _lines(parts: BillOfMaterials, power: BoardPower) -> Iterator[str]:
    """Yield the packages, the power and what is not listed."""
    names = [package.reference for package in parts.packages]
    shown = names[0] if len(names) == 1 else f"{names[0]} to {names[-1]}"
    spare = f"; spare op-amps: {parts.spare} in {names[-1]}" if parts.spare else ""
    yield f"{len(names)} packages {parts.opamp}, {shown}{spare}"
    yield (
        f"supply current {quantity(power.supply_current, 'A', 3)}, dissipation"
        f" {quantity(power.total, 'W', 3)} at rest: op-amps {quantity(power.quiescent, 'W', 3)}"
        f" quiescent and {quantity(power.outputs, 'W', 3)} by their load,"
        f" resistors {quantity(power.resistors, 'W', 3)}"
    )
    yield from (f"not included: {what}" for what in parts.not_listed)


def _row(line: PartLine) -> tuple[Cell, ...]:
    names, near = " ".join(line.references[:SHOWN]), line.preferred
    more = len(line.references) - SHOWN
    return (
        Cell(line.kind),
        Cell(quantity(line.value, line.unit), line.value),
        Cell(str(len(line.references)), len(line.references)),
        Cell("–" if line.tolerance is None else f"{100 * line.tolerance:.3g} %", line.tolerance),
        Cell(f"{names} and {more} more" if more > 0 else names),
        Cell("" if near is None else _text(near, line.unit)),
    )


def _text(near: Preferred, unit: str) -> str:
    return f"{near.series}: {quantity(near.value, unit)} ({100 * near.deviation:+.2g} %)"


def parts_csv(parts: BillOfMaterials) -> str:
    """Return the parts as CSV in SI base units, one row for each value, the op-amps last."""
    text = io.StringIO()
    table = csv.DictWriter(text, COLUMNS, restval="", lineterminator="\n")
    table.writeheader()
    table.writerows(_records(parts))
    return text.getvalue()


def _records(parts: BillOfMaterials) -> Iterator[dict[str, Any]]:
    for line in parts.lines:
        record = _record(line.references, repr(line.value), line.kind)
        record |= {"Unit": line.unit}
        if line.tolerance is not None:
            record["Tolerance"] = repr(line.tolerance)
        if (near := line.preferred) is not None:
            record |= {"Preferred": repr(near.value), "Series": near.series}
            record["Deviation"] = repr(near.deviation)
        yield record
    names = tuple(package.reference for package in parts.packages)
    yield _record(names, parts.opamp.upper(), "op-amp")


def _record(references: tuple[str, ...], value: str, kind: str) -> dict[str, Any]:
    """Return what every row has."""
    listed = ",".join(references)
    return {"Reference": listed, "Value": value, "Quantity": len(references), "Kind": kind}
