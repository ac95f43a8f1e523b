"""The designs of a choice as a table for people and as plain data."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from types import SimpleNamespace
from typing import Any

from rich.console import Console

from taction.verification.design.choose import Confirmation, Design
from taction.verification.report.renderers.terminal import print_page
from taction.verification.report.views.choose import proposed as proposed
from taction.verification.report.views.choose import view


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


def print_choice(
    designs: Sequence[Design],
    best: Sequence[Design],
    confirmations: Sequence[Confirmation],
    console: Console,
) -> None:
    """Print the best designs, and the best of every op-amp."""
    scene: Any = SimpleNamespace(name="designs")
    print_page(view(scene, designs, best, confirmations), console)
