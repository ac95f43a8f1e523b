"""The parts of a board as a table, as CSV with KiCad's columns, and as JSON."""

from __future__ import annotations

from dataclasses import asdict
from typing import Any

from taction.netlist_gen.board.bill_of_materials import BillOfMaterials
from taction.verification.verdict.board_power import BoardPower

# The fields of KiCad's bill of materials, then our own; a footprint is not known.


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
