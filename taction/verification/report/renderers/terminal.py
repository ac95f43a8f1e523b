"""A page in a terminal, and the same text as a card of HTML, which a notebook shows."""

from __future__ import annotations

import errno
import html
import io
import math
import os
from collections.abc import Callable, Iterable, Iterator, Sequence
from typing import IO, Any, NoReturn

from rich.box import SIMPLE_HEAD
from rich.cells import cell_len
from rich.console import Console, ConsoleOptions, Group, RenderableType, RenderResult
from rich.segment import Segment
from rich.table import Column, Table
from rich.text import Text

from taction.system.charts import OUTCOMES, Chart
from taction.system.foreign_files import escaped, visible, visible_lines
from taction.verification.report import blocks
from taction.verification.report.blocks import NOTEBOOK, TERMINAL, Bars, Page

WIDTH = 160  # columns of a page in a file or a pipe, unless the variable COLUMNS says otherwise
SHORT = 20  # letters of a cell that stays in one line wherever the page is wide enough
LIMIT_AT, BEYOND = 12, 4  # letters of a drawn bar up to its limit, and beyond it
UNMET = {"fail": "FAILS", "inconclusive": "undecided"}
WIDE_GAP, GAP = 3, 2  # columns between two cells of a table
QUOTES = "'''"  # in the place of three backticks
SMALL = str.maketrans({"µ": "u", "Ω": "ohm"})


class Terminal(Console):
    """A console that prints numbers without colours and never cuts a line.

    Where the output is no terminal, lines are not broken: a text that is searched for stands in
    one line. A closed pipe is `BrokenPipeError`; rich would end with 1, a failed check.
    """

    def __init__(self, *, file: IO[str] | None = None, **options: Any) -> None:
        # In a notebook rich would show the text itself, past the file.
        super().__init__(highlight=False, file=file, force_jupyter=False, **options)
        if not self.is_terminal:
            self.soft_wrap = True
            if not os.environ.get("COLUMNS", "").isdigit() and "width" not in options:
                self.width = WIDTH

    def print(self, *objects: Any, **options: Any) -> None:
        """Print as rich does, but never cut a line at the edge of the terminal."""
        super().print(*objects, **{"crop": False, **options})

    def on_broken_pipe(self) -> NoReturn:
        """Raise the error of a closed pipe."""
        raise BrokenPipeError(errno.EPIPE, "closed pipe")


def print_page(page: Page, console: Console) -> None:
    """Print the sections of `page` for a terminal, and the outcome in the last line."""
    for line in page_lines(page):
        console.print(line)


def page_text(page: Page) -> str:
    """Return the text of `print_page` without colours."""
    text = io.StringIO()
    print_page(page, Terminal(file=text))
    return text.getvalue().removesuffix("\n")


def markdown(page: Page, heading: str) -> str:
    """Return a page as Markdown: a heading, and the text of `print_page` as it stands."""
    return f"## {heading}\n\n```\n{page_text(page).replace('```', QUOTES)}\n```\n"


def page_lines(page: Page, medium: str = TERMINAL) -> Iterator[RenderableType]:
    """Yield what `print_page` prints; in another medium without the title and the outcome."""
    colour = OUTCOMES[page.outcome].colour if page.outcome else ""
    if medium == TERMINAL:
        yield Text(plain(page.title), style=f"bold {colour}")
    for line in (*page.lines, page.summary):
        if line:
            yield Text(plain(line))
    for section in page.sections:
        made = section.made(medium)
        if made and section.lead:
            yield Text(plain(section.lead))
        for block in made:
            yield SHOWN[type(block)](block)
    for line in page.foot:
        yield Text(plain(line), style="dim")
    if page.outcome and medium == TERMINAL:
        yield outcome_line(page.outcome, page.last_line)


def outcome_line(outcome: str, words: str = "") -> Text:
    """Return the last line of a page: one word, or other words for the outcome."""
    return Text((words or outcome).upper(), style=f"bold {OUTCOMES[outcome].colour}")


def plain(text: str) -> str:
    """Return `text` in one line, with units as SPICE writes them, for consoles and searching."""
    return "-" if text == "–" else visible(text).translate(SMALL)


def outcome_text(text: str, outcome: str) -> Text:
    """Return a text in the colour of an outcome."""
    return Text(text, style=OUTCOMES[outcome].colour if outcome else "")


def _bars(block: Bars) -> Group:
    """Return a line for each value: its bar up to the limit and beyond it, and its numbers."""
    rows, lines = block.rows, list[Text]()
    longest = max((len(bar.name) for bar in rows), default=0)
    for bar in rows:
        text = Text(f"  {plain(bar.name).ljust(longest)}  ")
        text.append(_bar(bar.share), OUTCOMES[bar.fill].colour)
        text.append(f" {plain(', '.join(filter(None, (bar.value, bar.limit))))}")
        if bar.outcome in UNMET:
            text.append(f": {UNMET[bar.outcome]}", f"bold {OUTCOMES[bar.outcome].colour}")
        elif bar.share is not None:
            text.append(f" ({bar.used.replace(' of the limit', '')})", "dim")
        lines.append(text)
    if not block.brief:
        known = (bar for bar in rows if bar.reason)
        lines += (Text(f" {plain(bar.name)}: {plain(bar.reason)}") for bar in known)
    return _lines(block.title, lines)


def _bar(share: float | None) -> str:
    """Return a bar of letters: ``######......|    `` uses half of the limit."""
    if share is None:
        return " " * (LIMIT_AT + 1 + BEYOND)
    within = min(int(LIMIT_AT * share), LIMIT_AT)
    beyond = min(math.ceil(LIMIT_AT * max(share - 1.0, 0.0)), BEYOND)
    return f"{'#' * within:.<{LIMIT_AT}}|{'#' * beyond:<{BEYOND}}"


def _lines(title: str, lines: Iterable[Text]) -> Group:
    return Group(*((Text(plain(title), style="italic"),) if title else ()), *lines)


def _facts(block: blocks.Facts) -> Group:
    longest = max((len(name) for name, _ in block.rows), default=0)
    rows = (Text(f"{plain(name).ljust(longest)}  {plain(value)}") for name, value in block.rows)
    return _lines(block.title, rows)


def _notes(block: blocks.Notes) -> Group:
    parts = (part for line in block.lines for part in line.split("\n"))
    lines = (outcome_text(plain(part), block.outcome) for part in parts)
    return _lines(block.title, lines)


class FittedTable:
    """A table that fits the width of its page and loses nothing.

    A cell is broken between words, never inside a word.
    Where the page is too narrow, the columns stand in several tables.
    """

    def __init__(self, block: blocks.Table) -> None:
        self.title, self.note, self.heads = plain(block.title), plain(block.note), block.heads
        self.titles = [plain(title) for title in block.columns]
        self.rows = [
            [outcome_text(plain(cell.text), cell.outcome) for cell in row] for row in block.rows
        ]
        self.short = [
            all(cell.number is not None or len(cell.text) <= SHORT for cell in column)
            for column in zip(*block.rows, strict=True)
        ] or [False] * len(self.titles)

    def __rich_console__(self, console: Console, options: ConsoleOptions) -> RenderResult:
        """Yield the table, in several parts where it is too wide, or the list."""
        if self.title:
            yield Text(f"\n{self.title}", style="italic")
        for places, gap in self._parts(options.max_width):
            widths = self._widths(places, options.max_width, gap)
            room = options.update_width(max(options.max_width, _total(widths, gap)))
            for line in console.render_lines(self._table(places, widths, gap), room):
                left = len("".join(segment.text for segment in line).rstrip())
                for text, style, control in line:
                    yield Segment(text[: max(left, 0)], style, control)
                    left -= len(text)
                yield Segment.line()
        if self.note:
            yield Text(f"{self.note}\n", style="dim")

    def _parts(self, width: int) -> list[tuple[list[int], int]]:
        """Return the columns of each part with their gap: the heads, and as many others as fit."""

        def fits(places: list[int], gap: int) -> bool:
            return _total(self._widths(places, width, gap), gap) <= width

        every, heads = list(range(len(self.titles))), list(range(self.heads))
        if fits(every, WIDE_GAP):
            return [(every, WIDE_GAP)]
        parts = [heads]
        for place in every[self.heads :]:
            wider = [*parts[-1], place]
            if len(parts[-1]) > len(heads) and not fits(wider, GAP):
                parts.append([*heads, place])
            else:
                parts[-1] = wider
        return [(part, GAP) for part in parts]

    def _widths(self, places: Sequence[int], width: int, gap: int) -> list[int]:
        """Return the width of each column, such that they fit into `width` if that is possible.

        Rich alone would break words; here the widest columns give way, down to their longest word,
        or to their longest cell where all cells are `short`. A title may be broken between words.
        """
        room = width - _total([0] * len(places), gap)
        natural, least = [], []
        for place in places:
            title = self.titles[place].split("\n")
            lines = [line for row in self.rows for line in row[place].plain.split("\n")]
            words = [word for line in title for word in line.split()]
            parts = lines if self.short[place] else " ".join(lines).split()
            natural.append(max(map(cell_len, (*title, *lines)), default=0))
            least.append(max(map(cell_len, (*words, *parts)), default=0))
        while sum(natural) > room:
            wide = [place for place, low in enumerate(least) if natural[place] > low]
            if not wide:
                break
            natural[max(wide, key=natural.__getitem__)] -= 1
        return natural

    def _table(self, places: Sequence[int], widths: Sequence[int], gap: int) -> Table:
        titles = (Text(self.titles[place]) for place in places)
        columns = (Column(title, width=w) for title, w in zip(titles, widths, strict=True))
        table = Table(*columns, box=SIMPLE_HEAD, pad_edge=False, padding=(0, gap - 2, 0, 1))
        for row in self.rows:
            table.add_row(*(row[place] for place in places))
        return table


def _total(widths: Sequence[int], gap: int) -> int:
    return sum(widths) + gap * (len(widths) - 1) + 2


SHOWN: dict[type, Callable[[Any], RenderableType]] = {
    blocks.Table: FittedTable,
    Bars: _bars,
    blocks.Facts: _facts,
    blocks.Notes: _notes,
    blocks.Code: lambda block: _lines(block.title, [Text(escaped(block.text, "\n\t"))]),
    Chart: lambda block: Text(plain(block.title)),
}


BOX = (
    "border:1px solid rgba(127,127,127,.4);border-left:5px solid {};border-radius:6px;"
    "padding:.6em .9em;margin:.4em 0;max-width:64em;font:14px/1.45 system-ui,sans-serif"
)
PRE = "margin:0;white-space:pre-wrap;background:none;font:13px/1.4 ui-monospace,monospace"
PLAIN = "rgba(127,127,127,.6)"  # border of a card without an outcome
INK = {"pass": "#fff", "fail": "#000", "inconclusive": "#000", "error": "#000"}
CARD_WIDTH, LONGEST = 108, 500  # letters of a line, and of the title


def card(page: Page, kind: str = "") -> str:
    """Return `page` as one ``<div>``; `kind` stands beside the title, by default its command."""
    console = Terminal(file=io.StringIO(), record=True, width=CARD_WIDTH)
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
