"""Tables in the one style of all reports, and the text of the values in their cells."""

from __future__ import annotations

import math
import re
from collections.abc import Iterable, Iterator, Sequence
from typing import Any

from rich.box import SIMPLE_HEAD
from rich.console import RenderableType
from rich.table import Column, Table

from netlist_gen.quantities import UNITS, show

MARKDOWN = re.compile(r"([\\`*_{}\[\]<>#|~&])")


def make_table(
    titles: Iterable[str | Column], rows: Iterable[Sequence[RenderableType]], **style: Any
) -> Table:
    """Return a table of `rows` under `titles`; `style` goes to `rich.table.Table`."""
    left: dict[str, Any] = {"title_justify": "left", "caption_justify": "left"}
    table = Table(*titles, box=SIMPLE_HEAD, pad_edge=False, **left, **style)
    for row in rows:
        table.add_row(*row)
    return table


def whole(*titles: str) -> tuple[Column, ...]:
    """Return columns whose cells are never cut or wrapped."""
    return tuple(Column(title, no_wrap=True, overflow="ignore") for title in titles)


def markdown_table(titles: Sequence[str], rows: Iterable[Iterable[str]]) -> Iterator[str]:
    """Yield the lines of a table in Markdown."""
    for cells in (titles, ["---"] * len(titles), *(map(markdown_line, row) for row in rows)):
        yield f"| {' | '.join(cells)} |"


def markdown_line(text: str) -> str:
    """Return `text` in one line, its special characters escaped for Markdown."""
    return MARKDOWN.sub(r"\\\1", " ".join(text.split()))


def value_text(value: object, unit: str, digits: int = 4) -> str:
    """Return a value with its unit, fractions of the step as per cent; a dash for no value."""
    if not isinstance(value, float):
        return "-" if value is None else str(value)
    if math.isnan(value):
        return "-"
    if unit in UNITS:
        return show(value, unit, digits)
    if unit == "step":
        return f"{100 * value:.3g} %"
    return f"{value:.{digits}g}" + (" /s" if unit == "1/s" else "")


def spaced(name: str) -> str:
    """Return the name of a figure or a check in words."""
    return name.replace("_", " ")
