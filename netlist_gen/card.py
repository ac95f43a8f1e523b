"""`Card`: a result as a small piece of HTML that a notebook shows, and its safe `repr`.

All styles are inline, text and lines take the colours of the page, light or dark, and an outcome
has a sign and a word beside its colour. Every text is escaped.
"""

from __future__ import annotations

import html
from collections.abc import Sequence
from dataclasses import dataclass

LINE = "1px solid rgba(127,127,127,.4)"
# Blue and orange of Okabe and Ito: the sign, the background, and a text that is readable on it.
OUTCOMES = {
    "pass": ("✓", "#0072b2", "#fff"),
    "fail": ("✗", "#d55e00", "#000"),
    "inconclusive": ("?", "#6b6b6b", "#fff"),
    "error": ("!", "#cc79a7", "#000"),
}
HATCH = "repeating-linear-gradient(135deg,{0} 0 3px,transparent 3px 6px)"
HATCHED = ("fail", "inconclusive", "error")
MOST_ROWS, MOST_NOTES = 40, 6
LONGEST = 400  # characters of a text
BOX = (
    f"border:{LINE};border-left:5px solid {{colour}};border-radius:6px;padding:.6em .9em;"
    "margin:.4em 0;max-width:46em;font:14px/1.45 system-ui,sans-serif;overflow-x:auto"
)
CELL = f"text-align:left;vertical-align:top;padding:.2em 1.2em .2em 0;border:0;border-top:{LINE}"


@dataclass(frozen=True, slots=True)
class Mark:
    """An outcome in a cell of a table."""

    outcome: str


Cell = str | Mark


@dataclass(frozen=True, slots=True)
class Card:
    """What a card shows; empty parts are left out.

    Attributes
    ----------
    kind, title : str
        ``"Verdict"``, and the name of the scene.
    outcome : str
        A key of `OUTCOMES`, shown beside the title; empty for what has no outcome.
    summary : str
        The result in one sentence.
    shares : sequence of (str, int)
        Numbers by outcome, drawn as a bar.
    facts : sequence of (str, str)
        Names and values.
    titles, rows : sequence of str, sequence of sequence of str or Mark
        A table.
    notes : sequence of str
        Sentences below the table, at most `MOST_NOTES`.
    foot : str
        The last line: cost and error.
    """

    kind: str
    title: str
    outcome: str = ""
    summary: str = ""
    shares: Sequence[tuple[str, int]] = ()
    facts: Sequence[tuple[str, str]] = ()
    titles: Sequence[str] = ()
    rows: Sequence[Sequence[Cell]] = ()
    notes: Sequence[str] = ()
    foot: str = ""

    def html(self) -> str:
        """Return the card as one ``<div>``.

        Examples
        --------
        >>> Card("Scene", "a<b", facts=[("C", "10 pF")]).html().count("a&lt;b")
        1
        """
        colour = OUTCOMES[self.outcome][1] if self.outcome else "rgba(127,127,127,.6)"
        parts = [_head(self), _bar(self.shares), _facts(self.facts), _table(self)]
        parts += [_note(text) for text in _first(self.notes, MOST_NOTES)]
        parts += [_note(self.foot)] if self.foot else []
        return f'<div style="{BOX.format(colour=colour)}">{"".join(parts)}</div>'


def _text(text: str) -> str:
    """Return `text` for HTML, cut where it is very long."""
    return html.escape(text if len(text) <= LONGEST else text[: LONGEST - 1] + "…")


def _first(texts: Sequence[str], most: int) -> list[str]:
    more = len(texts) - most
    return [*texts] if more <= 0 else [*texts[:most], f"and {more} more"]


def _mark(outcome: str) -> str:
    sign, colour, ink = OUTCOMES[outcome]
    style = f"background:{colour};color:{ink};border-radius:4px;padding:.05em .5em;font-weight:600"
    return f'<span style="{style};white-space:nowrap">{sign} {outcome}</span>'


def _head(card: Card) -> str:
    name = f'<b style="font-size:1.1em">{_text(card.title)}</b>'
    kind = f'<span style="opacity:.7">{_text(card.kind)}</span>'
    outcome = _mark(card.outcome) if card.outcome else ""
    lead = f"<div>{_text(card.summary)}</div>" if card.summary else ""
    return f"<div>{name} {kind} {outcome}</div>{lead}"


def _bar(shares: Sequence[tuple[str, int]]) -> str:
    """Draw the shares of the outcomes, each with its number below."""
    total = sum(number for _, number in shares)
    if not total:
        return ""
    parts = []
    for outcome, number in shares:
        colour = OUTCOMES[outcome][1]
        fill = HATCH.format(colour) if outcome in HATCHED else colour
        width = f"width:{100 * number / total:.4g}%"
        parts.append(f'<div style="{width};background:{fill}"></div>')
    style = f"display:flex;height:.8em;border:{LINE};margin:.5em 0 .2em"
    words = " ".join(f"{number} {_mark(outcome)}" for outcome, number in shares if number)
    return f'<div style="{style}" aria-hidden="true">{"".join(parts)}</div><div>{words}</div>'


def _facts(facts: Sequence[tuple[str, str]]) -> str:
    if not facts:
        return ""
    rows = (
        f'<tr style="background:none"><th scope="row" style="{CELL};font-weight:400;opacity:.75;'
        f'white-space:nowrap">{_text(name)}</th><td style="{CELL}">{_text(value)}</td></tr>'
        for name, value in facts
    )
    return _whole("".join(rows))


def _table(card: Card) -> str:
    if not card.rows:
        return ""
    head = "".join(f'<th scope="col" style="{CELL}">{_text(title)}</th>' for title in card.titles)
    rows = "".join(
        f'<tr style="background:none">{"".join(map(_cell, row))}</tr>'
        for row in card.rows[:MOST_ROWS]
    )
    more = len(card.rows) - MOST_ROWS
    return _whole(f'<tr style="background:none">{head}</tr>{rows}') + (
        _note(f"and {more} more rows") if more > 0 else ""
    )


def _cell(cell: Cell) -> str:
    shown = _mark(cell.outcome) if isinstance(cell, Mark) else _text(cell)
    return f'<td style="{CELL}">{shown}</td>'


def _whole(rows: str) -> str:
    style = "border-collapse:collapse;border:0;margin:.5em 0;width:auto;font-size:1em"
    return f'<table style="{style}"><tbody>{rows}</tbody></table>'


def _note(text: str) -> str:
    return f'<div style="margin-top:.3em;opacity:.85">{_text(text)}</div>'
