"""Values as text, as an engineer writes them."""

from __future__ import annotations

import math
from collections.abc import Iterable

from netlist_gen.quantities import NONE as NONE
from netlist_gen.quantities import quantity as quantity
from netlist_gen.quantities import readable as readable
from netlist_gen.scene.summary import counted as counted
from verification.report.html.blocks import Cell, Outcome
from verification.report.tables import value_text


def figure(value: float | None, unit: str, digits: int = 4) -> str:
    """Return a value as `value_text` does, with the signs for ohm and micro; "never" for infinity.

    Examples
    --------
    >>> figure(0.0123, "step"), figure(float("inf"), "s"), figure(-1123.46, "1/s")
    ('1.23 %', 'never', '-1123 /s')
    """
    if value is None or math.isnan(value):
        return NONE
    if math.isinf(value):
        return "never"
    return readable(value_text(float(value), "" if unit == "ratio" else unit, digits))


def percent(share: float) -> str:
    """Return a fraction as per cent."""
    return f"{100 * share:.4g} %"


def number_cell(value: float | None, unit: str, digits: int = 4) -> Cell:
    """Return a cell that shows a value as `figure` and sorts by it."""
    known = value is not None and math.isfinite(value)
    return Cell(figure(value, unit, digits), value if known else None)


def text_cells(texts: Iterable[object]) -> tuple[Cell, ...]:
    """Return cells that sort by their texts."""
    return tuple(Cell(str(text)) for text in texts)


def outcome_cell(outcome: Outcome) -> Cell:
    """Return a cell with the mark of an outcome."""
    return Cell(outcome, None, outcome)
