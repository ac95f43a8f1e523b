"""Tables in the one style of all reports, and the text of the values in their cells."""

from __future__ import annotations

import math
from collections.abc import Iterable, Sequence
from typing import Any

from rich.table import Column
from rich.text import Text

from taction.system.quantities import UNITS, show
from taction.verification.report.fitted_table import FittedTable


def make_table(
    titles: Iterable[str | Column], rows: Iterable[Sequence[str | Text]], **style: Any
) -> FittedTable:
    """Return a table of `rows` under `titles`; a cell that is a string may have rich's markup."""
    columns = [title if isinstance(title, Column) else Column(title) for title in titles]
    cells = [
        [Text.from_markup(cell) if isinstance(cell, str) else cell for cell in row] for row in rows
    ]
    left: dict[str, Any] = {"title_justify": "left", "caption_justify": "left"}
    return FittedTable(columns, cells, left | style)


def whole(*titles: str) -> tuple[Column, ...]:
    """Return columns whose cells stay in one line wherever the page is wide enough."""
    return tuple(Column(title, no_wrap=True) for title in titles)


def value_text(value: object, unit: str, digits: int = 4) -> str:
    """Return a value with its unit, fractions of the step as per cent; a dash for no value."""
    if not isinstance(value, float):
        return "-" if value is None else str(value)
    if math.isnan(value):
        return "-"
    if unit in (*UNITS, "1/s"):
        return show(value, unit, digits)
    if unit == "step":
        return f"{100 * value:.3g} %"
    return f"{value:.{digits}g}"


def rounded_up(value: float) -> float:
    """Return the least number of one digit that is not below a positive value.

    Examples
    --------
    >>> rounded_up(1.2e-15), rounded_up(0.07)
    (2e-15, 0.07)
    """
    exponent = math.floor(math.log10(value))
    return float(f"{math.ceil(value / 10.0**exponent * (1.0 - 1e-12))}e{exponent}")


def spaced(name: str) -> str:
    """Return the name of a figure or a check in words."""
    return name.replace("_", " ")
