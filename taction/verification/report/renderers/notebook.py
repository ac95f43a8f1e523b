"""A page as a card: a small piece of HTML that a notebook shows.

All styles are inline, text and lines take the colours of the page, light or dark, and an outcome
has a sign and a word beside its colour. Every text is escaped.
"""

from __future__ import annotations

import html
from collections.abc import Iterable, Iterator, Sequence

from taction.system.charts import OUTCOMES, Chart, Outcome
from taction.system.foreign_files import visible_lines
from taction.verification.report import blocks

LINE = "1px solid rgba(127,127,127,.4)"
BOX = (
    f"border:{LINE};border-left:5px solid {{}};border-radius:6px;padding:.6em .9em;"
    "margin:.4em 0;max-width:46em;font:14px/1.45 system-ui,sans-serif;overflow-x:auto"
)
PLAIN = "rgba(127,127,127,.6)"  # border of a card without an outcome
CELL = f"text-align:left;vertical-align:top;padding:.2em 1.2em .2em 0;border:0;border-top:{LINE}"
TABLE = "border-collapse:collapse;border:0;margin:.5em 0;width:auto;font-size:1em"
HEAD, FIRST = ";font-weight:600", ";font-weight:400;opacity:.75"  # of a row, and in a row
INK = {"pass": "#fff", "fail": "#000", "inconclusive": "#000", "error": "#000"}
MOST_ROWS, MOST_NOTES = 40, 6
LONGEST = 500  # characters of a text


def card(page: blocks.Page, kind: str = "") -> str:
    """Return `page` as one ``<div>``; `kind` stands beside the title, by default its command."""
    colour = OUTCOMES[page.outcome].colour if page.outcome else PLAIN
    title = f'<b style="font-size:1.1em">{_text(page.title)}</b>'
    command = f'<span style="opacity:.7">{_text(kind or page.command)}</span>'
    parts = [f"{title} {command} {_mark(page.outcome)}", *map(_text, (page.summary, *page.lines))]
    for section in page.sections:
        for block in section.made(blocks.NOTEBOOK):
            parts += _block(block)
    parts += map(_text, page.foot)
    lines = (each if each.startswith("<table") else f"<div>{each}</div>" for each in parts if each)
    return f'<div style="{BOX.format(colour)}">{"".join(lines)}</div>'


def _block(block: blocks.Block) -> Iterator[str]:
    """Yield the lines of a block, of which a table is one."""
    notes: Sequence[str] = ()
    if isinstance(block, blocks.Bars):
        yield from _block(block.table)
        notes = [f"{bar.name}: {bar.reason}" for bar in block.rows if bar.outcome != "pass"]
    elif isinstance(block, blocks.Table):
        shown = ([_mark(c.outcome, c.text) or _text(c.text) for c in row] for row in block.rows)
        yield _table([*shown][:MOST_ROWS], map(_text, block.columns))
        more = len(block.rows) - MOST_ROWS
        yield f"and {more} more rows" if more > 0 else ""
    elif isinstance(block, blocks.Facts):
        yield _table([map(_text, row) for row in block.rows])
    elif isinstance(block, blocks.Notes):
        notes = block.lines
    else:
        notes = [block.title if isinstance(block, Chart) else getattr(block, "text", block.title)]
    yield from map(_text, notes[:MOST_NOTES])
    yield f"and {len(notes) - MOST_NOTES} more" if len(notes) > MOST_NOTES else ""


def _table(rows: Iterable[Iterable[str]], titles: Iterable[str] = ()) -> str:
    """Return rows of HTML as a table; the first cell of each is its header."""
    heads = [f'<th scope="col" style="{CELL}{HEAD}">{each}</th>' for each in titles]
    lines = ["".join(heads)] if heads else []
    for first, *others in rows:
        cells = (f'<td style="{CELL}">{each}</td>' for each in others)
        lines.append(f'<th scope="row" style="{CELL}{FIRST}">{first}</th>{"".join(cells)}')
    body = "".join(f'<tr style="background:none">{each}</tr>' for each in lines)
    return f'<table style="{TABLE}"><tbody>{body}</tbody></table>'


def _mark(outcome: Outcome, text: str = "") -> str:
    """Return a text, or the outcome's name, with the sign and the colour of an outcome, if any."""
    if not outcome:
        return ""
    look = OUTCOMES[outcome]
    style = f"background:{look.colour};color:{INK[outcome]};border-radius:4px;padding:.05em .5em"
    shown = f"{look.sign} {_text(text or outcome)}"
    return f'<span style="{style};font-weight:600;white-space:nowrap">{shown}</span>'


def _text(text: str) -> str:
    """Return a text for HTML, cut where it is very long."""
    text = visible_lines(text)
    return html.escape(text if len(text) <= LONGEST else text[: LONGEST - 1] + "…")
