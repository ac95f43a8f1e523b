"""A card of facts: a small piece of HTML that a notebook shows, and the parts of all cards.

All styles are inline; text and lines take the colours of the page, light or dark. Every text is
escaped.
"""

from __future__ import annotations

import html
from collections.abc import Iterable, Sequence

from taction.system.foreign_files import visible_lines

LINE = "1px solid rgba(127,127,127,.4)"
LONGEST = 500  # characters of a text
BOX = (
    f"border:{LINE};border-left:5px solid {{}};border-radius:6px;padding:.6em .9em;"
    "margin:.4em 0;max-width:46em;font:14px/1.45 system-ui,sans-serif;overflow-x:auto"
)
PLAIN = "rgba(127,127,127,.6)"  # of a card without an outcome
CELL = f"text-align:left;vertical-align:top;padding:.2em 1.2em .2em 0;border:0;border-top:{LINE}"
WHOLE = "border-collapse:collapse;border:0;margin:.5em 0;width:auto;font-size:1em"
ROW = '<tr style="background:none">{}</tr>'


def facts_card(kind: str, title: str, facts: Sequence[tuple[str, str]]) -> str:
    """Return names and values as one ``<div>``."""
    return boxed([head(kind, title), facts_table(facts)])


def boxed(parts: Iterable[str], colour: str = PLAIN) -> str:
    """Return pieces of HTML as one ``<div>`` with a border."""
    return f'<div style="{BOX.format(colour)}">{"".join(parts)}</div>'


def head(kind: str, title: str, more: str = "") -> str:
    """Return the first line of a card; `more` is HTML."""
    name = f'<b style="font-size:1.1em">{escaped(title)}</b>'
    return f'<div>{name} <span style="opacity:.7">{escaped(kind)}</span> {more}</div>'


def facts_table(facts: Iterable[tuple[str, str]]) -> str:
    """Return names and values as a table; nothing without facts."""
    rows = [
        ROW.format(
            f'<th scope="row" style="{CELL};font-weight:400;opacity:.75;white-space:nowrap">'
            f'{escaped(name)}</th><td style="{CELL}">{escaped(value)}</td>'
        )
        for name, value in facts
    ]
    return whole_table(rows) if rows else ""


def whole_table(rows: Iterable[str]) -> str:
    """Return rows of HTML as a table."""
    return f'<table style="{WHOLE}"><tbody>{"".join(rows)}</tbody></table>'


def escaped(text: str) -> str:
    """Return `text` for HTML, cut where it is very long."""
    text = visible_lines(text)
    return html.escape(text if len(text) <= LONGEST else text[: LONGEST - 1] + "…")
