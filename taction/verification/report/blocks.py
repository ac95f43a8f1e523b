"""What a result shows: a page of sections with blocks, plain values for every renderer.

`view(result)` in `report/views/` makes a `Page`; the renderers of `report/renderers/` show it in a
terminal, as an HTML page, as a picture and in a notebook. A text is plain text, never markup: the
renderers escape it.
Quantities are written with µ and Ω; the terminal writes them as SPICE does.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Mapping
from dataclasses import dataclass, field, replace
from itertools import groupby
from typing import Any, ClassVar

from taction.system.charts import Chart, Outcome
from taction.system.progress import attempt
from taction.verification.report.texts import Cell as Cell
from taction.verification.report.texts import Column, cell, shown_by
from taction.verification.report.texts import Shown as Shown

TERMINAL, PAGE, NOTEBOOK, PICTURE = "terminal", "page", "notebook", "picture"
MOST = {NOTEBOOK: 40}  # rows of a table, by the medium


@dataclass(frozen=True, slots=True)
class Table:
    """A table; the first cell of a row is its header."""

    kind: ClassVar[str] = "table"
    title: str
    columns: tuple[str, ...]
    rows: tuple[tuple[Cell, ...], ...]
    note: str = ""
    most: Mapping[str, int] = field(default_factory=dict)  # rows that a medium shows; others all
    more: str = "{} more: --json has all."  # added to `note` where rows are left out
    heads: int = 1  # first columns that say what a row is about

    @classmethod
    def of(
        cls,
        title: str,
        records: Iterable[Any],
        columns: Mapping[str, Column],
        note: str = "",
        most: Mapping[str, int] | None = None,
        more: str = "{} more: --json has all.",
    ) -> Table:
        """Return a table with a row for each record and a column for each of `columns`."""
        shown = [shown_by(column) for column in columns.values()]
        rows = tuple(tuple(cell(show(each)) for show in shown) for each in records)
        return cls(title, tuple(columns), rows, note, most or {}, more)

    def shortened(self, medium: str) -> Table:
        """Return the first rows of the table, as many as the medium shows."""
        left = len(self.rows) - self.most.get(medium, MOST.get(medium, len(self.rows)))
        if left <= 0:
            return self
        note = f"{self.note} {self.more.format(left)}".strip()
        return replace(self, rows=self.rows[:-left], note=note)


@dataclass(frozen=True, slots=True)
class Bar:
    """A value beside its limit, in numbers and in words; the value with its uncertainty."""

    name: str
    outcome: Outcome
    share: float | None  # of the limit that is used: at 1 it is reached; None without a number
    doubt: float  # bound on the error of `share`
    value: str
    limit: str
    reason: str = ""

    @property
    def width(self) -> float:
        """Length of the bar, of 300 units; the limit is at `AT_LIMIT`."""
        return _place(self.share or 0.0)

    @property
    def whisker(self) -> tuple[float, float] | None:
        """Ends of the line that shows `doubt`; None where it would be too short to see."""
        share = self.share or 0.0
        low, high = _place(share - self.doubt), _place(share + self.doubt)
        return (low, high) if high - low > SHORTEST else None

    @property
    def used(self) -> str:
        """`share` in words: a fraction as per cent, a large one as a factor."""
        share = self.share or 0.0
        if share >= MANY:
            return f"{share:.3g} times the limit"
        return f"{100 * share:.3g} % of the limit" if share >= LEAST else LITTLE

    @property
    def fill(self) -> Outcome:
        """The look of the bar; without an outcome it says whether the limit is exceeded."""
        return self.outcome or ("fail" if (self.share or 0.0) > 1.0 else "pass")


AT_LIMIT, END, SHORTEST = 200.0, 300.0, 2.0  # units


def _place(share: float) -> float:
    return round(min(max(AT_LIMIT * share, 0.0), END), 3)


MANY, LEAST = 10.0, 1e-4
LITTLE = f"below {100 * LEAST:g} % of the limit"


@dataclass(frozen=True, slots=True)
class Bars:
    """Values beside their limits; `brief`: a terminal leaves out the reasons."""

    kind: ClassVar[str] = "bars"
    title: str
    rows: tuple[Bar, ...]
    note: str = ""
    brief: bool = False


@dataclass(frozen=True, slots=True)
class Drawing:
    """A drawing as SVG, which escapes its texts; `summary` says what it shows."""

    kind: ClassVar[str] = "drawing"
    title: str
    svg: str
    summary: str


@dataclass(frozen=True, slots=True)
class Facts:
    """Names and values."""

    kind: ClassVar[str] = "facts"
    title: str
    rows: tuple[tuple[str, str], ...]


@dataclass(frozen=True, slots=True)
class Code:
    """A text to copy."""

    kind: ClassVar[str] = "code"
    title: str
    text: str
    note: str = ""


@dataclass(frozen=True, slots=True)
class Notes:
    """Sentences; with an outcome, they are shown in its colour."""

    kind: ClassVar[str] = "notes"
    title: str
    lines: tuple[str, ...]
    outcome: Outcome = ""


Block = Table | Bars | Chart | Drawing | Facts | Code | Notes
Content = Block | str | Mapping[str, str] | None
"""What stands in a section: a text is a line of notes, a mapping has names and values."""


@dataclass(frozen=True, slots=True)
class Section:
    """A part of a page with a heading; sections without blocks are left out.

    A function in the place of the blocks is called only by the renderers of `media`, so that a
    terminal does not wait for what only an HTML page shows. None, empty texts, and blocks without
    rows are left out; neighbouring texts are the lines of one block.
    """

    title: str
    blocks: Content | Iterable[Content] | Callable[[], Content | Iterable[Content]]
    lead: str = ""  # a sentence above the blocks
    media: str = "terminal page"  # who shows the section, in words

    def made(self, medium: str) -> tuple[Block, ...]:
        """Return the blocks for a medium; none if it does not show this section."""
        if medium not in self.media.split():
            return ()
        failures: list[str] = []
        nothing: tuple[Block, ...] = ()
        found = attempt(f"{self.title!r}", self._all, nothing, failures.append)
        return tuple(
            each.shortened(medium) if isinstance(each, Table) else each
            for each in (*found, Notes("", tuple(failures)))
            if getattr(each, "rows", getattr(each, "lines", True))
        )

    def _all(self) -> tuple[Block, ...]:
        found: Any = self.blocks() if callable(self.blocks) else self.blocks
        one = isinstance(found, str | Mapping) or not isinstance(found, Iterable)
        contents = [each for each in ([found] if one else found) if each not in (None, "")]
        made: list[Block] = []
        for are_texts, group in groupby(contents, key=lambda each: isinstance(each, str)):
            if are_texts:
                made.append(Notes("", tuple(group)))
            else:
                made += (Facts("", (*e.items(),)) if isinstance(e, Mapping) else e for e in group)
        return tuple(made)


@dataclass(frozen=True, slots=True)
class Page:
    """A whole result."""

    title: str  # the name of the scene or folder
    command: str  # what made the result
    outcome: Outcome = ""  # at the top; empty for a study without one
    summary: str = ""  # the result in a sentence
    lines: tuple[str, ...] = ()  # what was studied, below the title
    sections: tuple[Section, ...] = ()
    foot: tuple[str, ...] = ()  # last lines of a terminal and a notebook: cost and error
    last_line: str = ""  # what the terminal ends with; by default the outcome

    def blocks(self, medium: str = PAGE) -> Iterator[Block]:
        """Yield the blocks for a medium, of all sections."""
        for section in self.sections:
            yield from section.made(medium)
