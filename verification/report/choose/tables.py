"""The designs of a choice as a table for people and as plain data."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

from taction.verification.design.choose import Confirmation, Design


def choice_document(
    designs: Sequence[Design],
    best: Sequence[Design],
    confirmations: Sequence[Confirmation],
    files: Mapping[int, str],
) -> dict[str, Any]:
    """Return a choice as plain data: all designs in their order, and the best with ngspice's word.

    `files` are the scene files of the best by their place of the grid.
    """
    return {
        "designs": [design.plain() for design in designs],
        "best": [
            design.plain()
            | {
                "ngspice": confirmation.outcome and confirmation.outcome.value,
                "ngspice_settling_time": confirmation.settling_time,
                "ngspice_reason": confirmation.reason,
                "file": files.get(design.place),
            }
            for design, confirmation in zip(best, confirmations, strict=True)
        ],
    }
