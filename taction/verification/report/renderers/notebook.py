"""A page as a card: a small piece of HTML with the terminal's text, which a notebook shows."""

from __future__ import annotations

import html
import io

from rich.console import Group

from taction.system.charts import OUTCOMES
from taction.system.foreign_files import visible_lines
from taction.verification.report.blocks import NOTEBOOK, Page
from taction.verification.report.renderers.terminal import Terminal, page_lines

BOX = (
    "border:1px solid rgba(127,127,127,.4);border-left:5px solid {};border-radius:6px;"
    "padding:.6em .9em;margin:.4em 0;max-width:64em;font:14px/1.45 system-ui,sans-serif"
)
PRE = "margin:0;white-space:pre-wrap;background:none;font:13px/1.4 ui-monospace,monospace"
PLAIN = "rgba(127,127,127,.6)"  # border of a card without an outcome
INK = {"pass": "#fff", "fail": "#000", "inconclusive": "#000", "error": "#000"}
WIDTH, LONGEST = 108, 500  # letters of a line, and of the title


def card(page: Page, kind: str = "") -> str:
    """Return `page` as one ``<div>``; `kind` stands beside the title, by default its command."""
    console = Terminal(file=io.StringIO(), record=True, width=WIDTH)
    console.print(Group(*page_lines(page, NOTEBOOK)))
    text = console.export_html(code_format="{code}", inline_styles=True).rstrip()
    colour, mark = PLAIN, ""
    if page.outcome:
        look = OUTCOMES[page.outcome]
        colour, style = look.colour, f"background:{look.colour};color:{INK[page.outcome]}"
        mark = f'<b style="{style};padding:.05em .5em">{look.sign} {page.outcome}</b>'
    title, command = (
        html.escape(visible_lines(each)[:LONGEST]) for each in (page.title, kind or page.command)
    )
    head = f"<div><b>{title}</b> <span>{command}</span> {mark}</div>"
    return f'<div style="{BOX.format(colour)}">{head}<pre style="{PRE}">{text}</pre></div>'
