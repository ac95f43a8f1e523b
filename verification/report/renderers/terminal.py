"""A page in a terminal: text, tables that lose nothing at any width, and the console itself."""

from __future__ import annotations

import errno
import io
import itertools
import os
import re
from collections.abc import Callable, Iterable, Iterator, Sequence
from typing import IO, Any, NoReturn

from rich.box import SIMPLE_HEAD
from rich.cells import cell_len
from rich.console import Console, ConsoleOptions, Group, RenderableType, RenderResult
from rich.segment import Segment
from rich.table import Column, Table
from rich.text import Text

from taction.verification.report import blocks
from taction.verification.report.blocks import TERMINAL, Bars, Block, Page
from taction.verification.report.charts import OUTCOMES, Chart

WIDTH = 160  # columns of a page in a file or a pipe, unless the variable COLUMNS says otherwise
MOST_LINES = 8  # of a cell; a table of narrow columns is harder to read than a list
GLUE = "\ue000"  # stands between a number and its unit while lines are broken
NUMBER = r"(?<![\w.])([(≥≤±<]?[-+−]?\d[\d.]*(?:e[-+]?\d+)?)"
UNIT = re.compile(NUMBER + r" (?=(?:%|/s|[a-zA-Zµ]{1,5}(?:/(?:us|rtHz|s))?)[),;]?(?:\s|$))")
SMALL = str.maketrans({"µ": "u", "Ω": "ohm"})


class Terminal(Console):
    """A console that prints numbers without colours and never cuts a line.

    Where the output is no terminal, lines are not broken: a text that is searched for stands in
    one line. A closed pipe is `BrokenPipeError`; rich would end with 1, a failed check.
    """

    def __init__(self, *, stderr: bool = False, file: IO[str] | None = None) -> None:
        # In a notebook rich would show the text itself, past the file.
        super().__init__(highlight=False, stderr=stderr, file=file, force_jupyter=False)
        if not self.is_terminal:
            self.soft_wrap = True
            if not os.environ.get("COLUMNS", "").isdigit():
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


def page_lines(page: Page) -> Iterator[RenderableType]:
    """Yield what `print_page` prints."""
    yield Text(page.title, style="bold")
    for line in (*page.lines, page.summary):
        if line:
            yield Text(plain(line))
    for section in page.sections:
        made = section.made(TERMINAL)
        if made and section.lead:
            yield Text(plain(section.lead))
        for block in made:
            yield shown(block)
    for line in page.foot:
        yield Text(plain(line), style="dim")
    if page.outcome:
        yield Text(page.outcome.upper(), style=f"bold {OUTCOMES[page.outcome].colour}")


def shown(block: Block) -> RenderableType:
    """Return a block for a console."""
    return SHOWN[type(block)](block)


def plain(text: str) -> str:
    """Return `text` with the units as SPICE writes them, for consoles and for searching.

    Examples
    --------
    >>> plain("12.3 µs at 10 kΩ"), plain("–")
    ('12.3 us at 10 kohm', '-')
    """
    return "-" if text == "–" else text.translate(SMALL)


def outcome_text(text: str, outcome: str) -> Text:
    """Return a text in the colour of an outcome."""
    return Text(text, style=OUTCOMES[outcome].colour if outcome else "")


def _table(block: blocks.Table) -> FittedTable:
    rows = [[outcome_text(plain(cell.text), cell.outcome) for cell in row] for row in block.rows]
    numbers = [
        all(cell.number is not None or len(cell.text) <= SHORT for cell in column)
        for column in zip(*block.rows, strict=True)
    ]
    columns = [
        Column(plain(title), no_wrap=bool(numbers) and numbers[place])
        for place, title in enumerate(block.columns)
    ]
    return FittedTable(columns, rows, plain(block.title), plain(block.note))


SHORT = 20  # letters of a cell that stays in one line wherever the page is wide enough


def _bars(block: Bars) -> Group:
    """Return the values beside their limits as a table, and the reasons below: they are long."""
    rows = [
        [
            Text(plain(bar.name)),
            outcome_text(bar.outcome, bar.outcome),
            *(Text(plain(text)) for text in (bar.value, bar.limit, _used(bar))),
        ]
        for bar in block.rows
    ]
    columns = [Column(title, no_wrap=True) for title in ("", "outcome", "value", "limit", "used")]
    if not any(bar.outcome for bar in block.rows):
        columns, rows = _without(columns, 1), [_without(row, 1) for row in rows]
    reasons = (Text(f" {plain(bar.name)}: {plain(bar.reason)}") for bar in block.rows if bar.reason)
    return Group(FittedTable(columns, rows, plain(block.title)), *reasons)


def _used(bar: blocks.Bar) -> str:
    return "" if bar.share is None else bar.used.replace(" of the limit", "")


def _without(row: Sequence[Any], place: int) -> list[Any]:
    return [*row[:place], *row[place + 1 :]]


def _ranges(block: blocks.Ranges) -> FittedTable:
    rows = [
        [
            Text(plain(each.name)),
            outcome_text(each.outcome, each.outcome),
            Text(plain(", ".join(each.texts))),
        ]
        for each in block.rows
    ]
    columns = [Column("quantity", no_wrap=True), Column("outcome", no_wrap=True), Column("range")]
    return FittedTable(columns, rows, plain(block.title), plain(block.note))


def _shares(block: blocks.Shares) -> Text:
    text = Text(f"{block.title}: " if block.title else "")
    for place, (outcome, number) in enumerate(block.rows):
        text.append(", " * bool(place)).append_text(outcome_text(f"{number} {outcome}", outcome))
    return text


def _facts(block: blocks.Facts) -> Group:
    longest = max((len(name) for name, _ in block.rows), default=0)
    rows = (Text(f"{plain(name).ljust(longest)}  {plain(value)}") for name, value in block.rows)
    return Group(*_title(block.title), *rows)


def _notes(block: blocks.Notes) -> Group:
    lines = (outcome_text(plain(line), block.outcome) for line in block.lines)
    return Group(*_title(block.title), *lines)


def _title(text: str) -> Iterable[Text]:
    return (Text(plain(text), style="italic"),) if text else ()


def _code(block: blocks.Code) -> Group:
    return Group(*_title(block.title), Text(block.text))


def _chart(block: Chart) -> Text:
    return Text(plain(block.heading))


def _drawing(block: blocks.Drawing) -> Text:
    return Text(plain(block.summary))


SHOWN: dict[type, Callable[[Any], RenderableType]] = {
    blocks.Table: _table,
    Bars: _bars,
    blocks.Ranges: _ranges,
    blocks.Shares: _shares,
    blocks.Facts: _facts,
    blocks.Notes: _notes,
    blocks.Code: _code,
    Chart: _chart,
    blocks.Drawing: _drawing,
}


class FittedTable:
    """A table that fits the width of its page and loses nothing.

    A cell is broken between words, never inside a word, and never between a number and its unit.
    Where even that does not fit, every row becomes a list of titles and values, one below the
    other. A cell of a column with `no_wrap` is broken only where the table does not fit otherwise.

    Parameters
    ----------
    columns : sequence of rich.table.Column
        The titles.
    rows : sequence of sequence of rich.text.Text
        The cells.
    title, note : str
        Above and below the table.
    style : dict
        For `rich.table.Table`.
    """

    def __init__(
        self,
        columns: Sequence[Column],
        rows: Sequence[Sequence[Text]],
        title: str = "",
        note: str = "",
        **style: Any,
    ) -> None:
        self.columns, self.rows, self.title, self.note = columns, rows, title, note
        self.style = style

    def __rich_console__(self, console: Console, options: ConsoleOptions) -> RenderResult:
        """Yield the widest layout that fits."""
        for wrapped, style in itertools.product((False, True), (self.style, {"padding": 0})):
            frame = (style.get("padding", 1) * 2 + 1) * (len(self.columns) - 1) + 2
            widths = self._widths(options.max_width - frame, wrapped=wrapped)
            if widths is None:
                continue
            lines = console.render_lines(self._table(style, widths), options, pad=False)
            if len(lines) > MOST_LINES * (len(self.rows) + 2):
                break
            if self.title:
                yield Text(f"\n{self.title}", style="italic")
            for line in lines:
                text = "".join(segment.text for segment in line)
                yield from (_unglued(segment) for segment in _trimmed(line, text))
                yield Segment.line()
            if self.note:
                yield Text(f"{self.note}\n", style="dim")
            return
        yield from self._records(options.max_width)

    def _widths(self, width: int, *, wrapped: bool) -> list[int] | None:
        """Return the width of each column; None if they do not fit into `width`.

        Rich alone would break words; here the widest columns give way, down to their longest word.
        """
        natural, least = [], []
        for place, column in enumerate(self.columns):
            texts = [_glued(row[place]).plain for row in self.rows]
            title = str(column.header)
            lines = [line for text in (title, *texts) for line in text.split("\n")]
            kept = lines if column.no_wrap and not wrapped else []
            words = [word for line in lines for word in line.split()]
            natural.append(max(map(cell_len, lines), default=0))
            least.append(max(map(cell_len, (*words, *kept)), default=0))
        if sum(least) > width:
            return None
        while sum(natural) > width:
            place = max(
                (k for k, low in enumerate(least) if natural[k] > low), key=natural.__getitem__
            )
            natural[place] -= 1
        return natural

    def _table(self, style: dict[str, Any], widths: Sequence[int]) -> Table:
        table = Table(
            *(
                Column(_glued(Text(str(each.header))), justify=each.justify, width=width)
                for each, width in zip(self.columns, widths, strict=True)
            ),
            box=SIMPLE_HEAD, pad_edge=False, **style,
        )  # fmt: skip
        for row in self.rows:
            table.add_row(*map(_glued, row))
        return table

    def _records(self, width: int) -> Iterator[Text]:
        """Yield each row as lines of a title and a value."""
        titles = [str(column.header).replace("\n", " ") for column in self.columns]
        indent = max(map(len, titles)) + 2
        if self.title:
            yield Text(f"\n{self.title}", style="italic")
        if not self.rows:
            yield Text("\n " + "\n ".join(titles))
        head = Text("")
        for row in self.rows:
            head = row[0] if row[0].plain else head  # an empty first cell means the one above
            yield Text("")
            for name, cell in zip(titles, (head, *row[1:]), strict=True):
                lines = _broken(_glued(cell), max(width - indent - 1, 1)) or [Text("")]
                for place, line in enumerate(lines):
                    start = f" {name.ljust(indent)}" if place == 0 else " " * (indent + 1)
                    yield Text(start, no_wrap=True, overflow="ignore").append_text(line)
        yield Text(f"\n{self.note}\n" if self.note else "", style="dim")


def _glued(cell: Text) -> Text:
    """Return a cell with its numbers bound to their units."""
    text = UNIT.sub(rf"\1{GLUE}", cell.plain)
    return cell if text == cell.plain else Text(text, style=cell.style, spans=cell.spans)


def _unglued(segment: Segment) -> Segment:
    return Segment(segment.text.replace(GLUE, " "), segment.style, segment.control)


def _trimmed(line: Sequence[Segment], text: str) -> Iterator[Segment]:
    """Yield the segments of a line without the blanks at its end."""
    left = len(text.rstrip())
    for segment in line:
        if left <= 0:
            return
        yield Segment(segment.text[:left], segment.style, segment.control)
        left -= len(segment.text)


def _broken(cell: Text, width: int) -> list[Text]:
    """Return the lines of a cell of at most `width` columns, if no word is longer."""
    lines: list[Text] = []
    for line in cell.split("\n", allow_blank=True):
        start, end = 0, 0
        for word in re.finditer(r"\S+", line.plain):
            if end > start and word.end() - start > width:
                lines.append(line[start:end])
                start = word.start()
            end = word.end()
        lines.append(line[start:end])
    return [
        Text(each.plain.replace(GLUE, " "), style=each.style, spans=each.spans) for each in lines
    ]
