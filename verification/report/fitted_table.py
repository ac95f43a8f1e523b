"""A table that fits the width of its page and loses nothing.

A cell is broken between words, never inside a word, and never between a number and its unit. Where
even that does not fit, every row becomes a list of titles and values, one below the other.
"""

from __future__ import annotations

import itertools
import re
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field
from typing import Any

from rich.box import SIMPLE_HEAD
from rich.cells import cell_len
from rich.console import Console, ConsoleOptions, RenderResult
from rich.table import Column, Table
from rich.text import Text

NATURAL = 10_000  # columns: enough for any table
MOST_LINES = 8  # of a cell; a table of narrow columns is harder to read than a list
_GAP = re.compile(r"[ \t]+")
_UNIT = re.compile(r"(%|/s|[a-zA-Zµ]{1,5}(/(us|rtHz|s))?)[),;]?")  # behind a number
_NUMBER = re.compile(r"[(≥≤±]?[-+]?\d[\d.]*(e[-+]?\d+)?")


@dataclass(frozen=True, slots=True)
class FittedTable:
    """Rows of cells under titles; `style` goes to `rich.table.Table`.

    A cell of a column with `no_wrap` is broken only where the table does not fit otherwise.
    """

    columns: Sequence[Column]
    rows: Sequence[Sequence[Text]]
    style: dict[str, Any] = field(default_factory=dict)

    def __rich_console__(self, console: Console, options: ConsoleOptions) -> RenderResult:
        """Yield the widest layout that fits."""
        tight = self.style | {"padding": 0}
        for style, broken in ((self.style, ()), (tight, ()), (self.style, (1,)), (tight, (1, 2))):
            for level in broken or (0,):
                widths = self._widths(level, options.max_width - self._frame(console, style))
                if widths is not None and self._readable(widths):
                    yield self._table(widths, style)
                    return
        yield from self._records(options.max_width)

    def _cells(self, number: int) -> list[Text]:
        return [row[number] for row in self.rows]

    def _frame(self, console: Console, style: dict[str, Any]) -> int:
        """Return the width of a table beside that of its columns."""
        widths = [1] * len(self.columns)
        frame = self._table(widths, {k: v for k, v in style.items() if k in FRAME}, rows=False)
        options = console.options.update_width(NATURAL)
        return int(console.measure(frame, options=options).maximum) - sum(widths)

    def _widths(self, level: int, width: int) -> list[int] | None:
        """Return the width of each column; None if they do not fit into `width`.

        Level 0 breaks only titles, 1 also cells without `no_wrap`, and 2 all cells.
        """
        natural, least = [], []
        for number, column in enumerate(self.columns):
            title, cells = Text(str(column.header)), self._cells(number)
            whole = level < 1 + bool(column.no_wrap)
            longest = max(map(_longest_line, cells), default=0)
            natural.append(max(_longest_line(title), longest))
            inside = longest if whole else max(map(_longest_piece, cells), default=0)
            least.append(max(_longest_piece(title), inside))
        if sum(least) > width:
            return None
        while (excess := sum(natural) - width) > 0:
            widest = max((n for n, low in zip(natural, least, strict=True) if n > low))
            place = next(k for k, n in enumerate(natural) if n == widest and natural[k] > least[k])
            rest = [n for n, low in zip(natural, least, strict=True) if n > low and n < widest]
            lower = max((least[place], max(rest, default=0), widest - excess))
            natural[place] = min(lower, widest - 1)
        return natural

    def _readable(self, widths: Sequence[int]) -> bool:
        """Whether no cell has many short lines."""
        return all(
            len(broken(cell, width)) <= MOST_LINES
            for number, width in enumerate(widths)
            for cell in self._cells(number)
        )

    def _table(self, widths: Sequence[int], style: dict[str, Any], *, rows: bool = True) -> Table:
        columns = [
            Column(
                Text("\n").join(broken(Text(str(column.header)), width)),
                justify=column.justify,
                no_wrap=True,
                overflow="ignore",
                width=width,
            )
            for column, width in zip(self.columns, widths, strict=True)
        ]
        table = Table(*columns, box=SIMPLE_HEAD, pad_edge=False, **style)
        for row in self.rows if rows else ():
            cells = zip(row, widths, strict=True)
            table.add_row(*(Text("\n").join(broken(cell, width)) for cell, width in cells))
        return table

    def _records(self, width: int) -> Iterator[Text]:
        """Yield each row as lines of a title and a value."""
        ends: dict[str, Any] = {"no_wrap": True, "overflow": "ignore"}
        titles = [str(column.header).replace("\n", " ") for column in self.columns]
        indent = max(map(cell_len, titles)) + 2
        if title := self.style.get("title"):
            yield Text(f"\n{title}", style="italic", **ends)
        if not self.rows:
            yield Text("\n " + "\n ".join(titles), **ends)
        head = Text("")
        for row in self.rows:
            head = row[0] if row[0].plain else head  # an empty first cell means the one above
            yield Text("", **ends)
            for name, cell in zip(titles, (head, *row[1:]), strict=True):
                first, *others = broken(cell, max(width - indent - 1, 1)) or [Text("")]
                yield Text(f" {name.ljust(indent)}", **ends).append_text(first)
                for line in others:
                    yield Text(" " * (indent + 1), **ends).append_text(line)
        caption = self.style.get("caption")
        yield Text(f"\n{caption}\n" if caption else "", style="dim")


FRAME = ("padding", "collapse_padding")  # keys of a style that change the width of the frame


def broken(cell: Text, width: int) -> list[Text]:
    """Return the lines of a cell of at most `width` columns, if no piece is longer.

    Examples
    --------
    >>> [line.plain for line in broken(Text("settles in 131.6 us at 10 pF"), 12)]
    ['settles in', '131.6 us at', '10 pF']
    """
    lines: list[Text] = []
    for line in cell.split("\n", allow_blank=True):
        if cell_len(line.plain) <= width:
            lines.append(line)
            continue
        start, end = 0, 0
        for piece_start, piece_end in _pieces(line.plain):
            if end > start and cell_len(line.plain[start:piece_end]) > width:
                lines.append(line[start:end])
                start = piece_start
            end = piece_end
        lines.append(line[start:end])
    return lines


def _pieces(text: str) -> Iterator[tuple[int, int]]:
    """Yield start and end of the pieces of a line: words, and numbers with their units."""
    ends = [0, *itertools.chain.from_iterable(m.span() for m in _GAP.finditer(text)), len(text)]
    words = [(a, b) for a, b in zip(ends[::2], ends[1::2], strict=True) if b > a]
    start = None
    for (a, b), after in itertools.zip_longest(words, words[1:]):
        start = a if start is None else start
        unit = after is not None and _UNIT.fullmatch(text[slice(*after)])
        if not (unit and _NUMBER.fullmatch(text[a:b])):
            yield start, b
            start = None


def _longest_piece(cell: Text) -> int:
    lines = cell.plain.split("\n")
    return max(cell_len(line[a:b]) for line in lines for a, b in (*_pieces(line), (0, 0)))


def _longest_line(cell: Text) -> int:
    return max(map(cell_len, cell.plain.split("\n")))
