"""A page as a card: a small piece of HTML that a notebook shows.

All styles are inline, text and lines take the colours of the page, light or dark, and an outcome
has a sign and a word beside its colour. Every text is escaped.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence
from typing import Any

from taction.netlist_gen.card import (
    CELL,
    PLAIN,
    ROW,
    boxed,
    escaped,
    facts_table,
    head,
    whole_table,
)
from taction.system.charts import OUTCOMES, Chart, Outcome
from taction.verification.report import blocks

INK = {"pass": "#fff", "fail": "#000", "inconclusive": "#000", "error": "#000"}
MOST_ROWS, MOST_NOTES = 40, 6


def card(page: blocks.Page, kind: str = "") -> str:
    """Return `page` as one ``<div>``; `kind` stands beside the title, by default its command."""
    colour = OUTCOMES[page.outcome].colour if page.outcome else PLAIN
    parts = [_head(page, kind or page.command)]
    for section in page.sections:
        parts += (SHOWN[type(block)](block) for block in section.made(blocks.NOTEBOOK))
    parts += map(_note, page.foot)
    return boxed(parts, colour)


def _first(texts: Sequence[str], most: int) -> list[str]:
    more = len(texts) - most
    return [*texts] if more <= 0 else [*texts[:most], f"and {more} more"]


def _mark(outcome: Outcome, text: str = "") -> str:
    look = OUTCOMES[outcome]
    style = f"background:{look.colour};color:{INK[outcome]};border-radius:4px;padding:.05em .5em"
    shown = f"{look.sign} {escaped(text or outcome)}"
    return f'<span style="{style};font-weight:600;white-space:nowrap">{shown}</span>'


def _head(page: blocks.Page, kind: str) -> str:
    outcome = _mark(page.outcome) if page.outcome else ""
    lines = (f"<div>{escaped(line)}</div>" for line in (page.summary, *page.lines) if line)
    return head(kind, page.title, outcome) + "".join(lines)


def _table(block: blocks.Table) -> str:
    if not block.rows:
        return ""
    rows = (ROW.format("".join(map(_cell, row))) for row in block.rows[:MOST_ROWS])
    more = len(block.rows) - MOST_ROWS
    note = _note(f"and {more} more rows") if more > 0 else ""
    return whole_table([_titles(block.columns), *rows]) + note


def _bars(block: blocks.Bars) -> str:
    reasons = [f"{bar.name}: {bar.reason}" for bar in block.rows if bar.outcome != "pass"]
    return _table(block.table) + "".join(map(_note, _first(reasons, MOST_NOTES)))


def _titles(titles: Iterable[str]) -> str:
    cells = (f'<th scope="col" style="{CELL}">{escaped(title)}</th>' for title in titles)
    return ROW.format("".join(cells))


def _cell(cell: blocks.Cell) -> str:
    shown = _mark(cell.outcome, cell.text) if cell.outcome else escaped(cell.text)
    return f'<td style="{CELL}">{shown}</td>'


def _note(text: str) -> str:
    return f'<div style="margin-top:.3em;opacity:.85">{escaped(text)}</div>'


SHOWN: dict[type, Callable[[Any], str]] = {
    blocks.Bars: _bars,
    Chart: lambda block: _note(block.heading),
    blocks.Code: lambda block: f"<pre>{escaped(block.text)}</pre>",
    blocks.Drawing: lambda block: _note(block.summary),
    blocks.Facts: lambda block: facts_table(block.rows),
    blocks.Notes: lambda block: "".join(map(_note, _first(block.lines, MOST_NOTES))),
    blocks.Table: _table,
}
