"""A refinement loop: bits and cycles by condition number, and the error after each cycle."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from taction.system.quantities import show
from taction.verification.report.blocks import BOTH, Page, Section, Sheet, Table
from taction.verification.report.charts import SERIES, Axis, Chart, Curve, Limit
from taction.verification.studies.refinement import Refined, Refinement

NOTE = (
    "Bits a cycle: median, least and most of the boards that arrive. Predicted: -log2 of the"
    " spectral radius of 1 - B T, without converters and offset; below 0 a board diverges."
)


def view(result: Refinement) -> Page:
    """Return the page of a refinement loop."""
    columns: dict[str, Callable[[Refined], str]] = {
        "condition": lambda row: f"{row.condition:g}",
        "arrive": lambda row: f"{row.arrived} of {row.boards}",
        "cycles": lambda row: "–" if row.cycles is None else f"{row.cycles:g}",
        "bits a cycle": _bits,
        "predicted": lambda row: f"{row.predicted:.2f}",
    }
    return Page(
        title=result.scene.name,
        command="taction design refine",
        outcome=result.outcome,
        summary=f"{_arrived(result)}.",
        lines=(f"{result.channels} channels, converters of {result.bits} bits.",),
        sections=(
            Section("Cycles", (Table.of("Cycles", result.rows, columns, NOTE),), media=BOTH),
            Section("Error", lambda: (chart(result),)),
        ),
        foot=(f"{show(result.seconds, 's')}; more: --report FILE",),
        sheet=lambda: Sheet(f"{result.scene.name}: refinement", ((chart(result),),)),
    )


def _arrived(result: Refinement) -> str:
    boards = sum(row.boards for row in result.rows)
    arrived = sum(row.arrived for row in result.rows)
    return f"{arrived} of {boards} boards arrive at {result.target} bits"


def _bits(row: Refined) -> str:
    if not row.bits:
        return "–"
    least, median, most = row.bits
    return f"{median:.2f} ({least:.2f} to {most:.2f})"


def chart(result: Refinement) -> Chart:
    """Return the median error of the boards of each condition number after each cycle."""
    curves = [
        Curve(
            np.arange(1.0, len(row.errors) + 1.0),
            np.array(row.errors),
            f"condition number {row.condition:g}",
            SERIES[place % len(SERIES)],
            mark="circle",
        )
        for place, row in enumerate(result.rows)
    ]
    wanted = Limit(2.0**-result.target, "y", f"{result.target} bits")
    return Chart(
        "Error after each cycle",
        Axis("cycle", whole=True),
        Axis("error over the largest entry", scale="log"),
        (*curves, wanted),
        message=_arrived(result),
        summary="Median error of the boards of each condition number, until they have arrived.",
    )
