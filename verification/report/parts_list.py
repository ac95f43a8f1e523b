"""The parts of a board as a table, as CSV with KiCad's columns, and as JSON."""

from __future__ import annotations

import csv
import io
from collections.abc import Iterator
from dataclasses import asdict
from typing import Any

from rich.console import Console
from rich.markup import escape

from taction.netlist_gen.board.bill_of_materials import UNITS, BillOfMaterials, PartLine
from taction.system.quantities import show
from taction.verification.report.tables import make_table
from taction.verification.verdict.board_power import BoardPower

SHOWN = 3  # references in a line of the table
# The fields of KiCad's bill of materials, then our own; a footprint is not known.
COLUMNS = (
    *("Reference", "Value", "Footprint", "Quantity", "DNP"),
    *("Kind", "Unit", "Tolerance", "Preferred", "Series", "Deviation"),
)


def print_parts(parts: BillOfMaterials, power: BoardPower, console: Console) -> None:
    """Print the parts, the packages, the power and what is not listed."""
    titles = ("part", "value", "count", "tolerance", "references", "not a standard value; nearest")
    console.print(make_table(titles, map(_row, parts.lines)))
    counts = " and ".join(f"{parts.count(kind)} {kind}s" for kind in UNITS)
    odd = sum(line.preferred is not None for line in parts.lines)
    remedy = "; set resistor_series and capacitor_series" if odd else ""
    console.print(f"{counts} of {len(parts.lines)} values; not a standard value: {odd}{remedy}")
    spare = f"; spare op-amps: {parts.spare} in {parts.packages[-1].reference}" * bool(parts.spare)
    console.print(f"{len(parts.packages)} packages {parts.opamp}, {_range(parts)}{spare}")
    console.print(
        f"supply current {show(power.supply_current, 'A', 3)}, dissipation"
        f" {show(power.total, 'W', 3)} at rest: op-amps {show(power.quiescent, 'W', 3)}"
        f" quiescent and {show(power.outputs, 'W', 3)} by their load,"
        f" resistors {show(power.resistors, 'W', 3)}"
    )
    for what in parts.not_listed:
        console.print(f"not included: {escape(what)}")


def _range(parts: BillOfMaterials) -> str:
    names = [package.reference for package in parts.packages]
    return names[0] if len(names) == 1 else f"{names[0]} to {names[-1]}"


def _row(line: PartLine) -> tuple[str, ...]:
    names = " ".join(line.references[:SHOWN])
    more = len(line.references) - SHOWN
    return (
        line.kind,
        show(line.value, line.unit),
        str(len(line.references)),
        "-" if line.tolerance is None else f"{100 * line.tolerance:.3g} %",
        f"{names} and {more} more" if more > 0 else names,
        _preferred(line),
    )


def _preferred(line: PartLine) -> str:
    near = line.preferred
    if near is None:
        return ""
    value = show(near.value, line.unit)
    return f"{near.series}: {value} ({100 * near.deviation:+.2g} %)"


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


def parts_document(parts: BillOfMaterials, power: BoardPower) -> dict[str, Any]:
    """Return the parts as plain data in SI base units."""
    return {
        "parts": [
            asdict(line)
            | {"unit": line.unit, "count": len(line.references), "standard": not line.preferred}
            for line in parts.lines
        ],
        "opamps": {
            "preset": parts.opamp,
            "packages": [asdict(package) for package in parts.packages],
            "spare": parts.spare,
        },
        "power": asdict(power) | {"total": power.total},
        "not_listed": list(parts.not_listed),
    }
