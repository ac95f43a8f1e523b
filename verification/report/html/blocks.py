"""What a report is made of: plain values, made by the sections and shown by the template.

A text is plain text, never markup: the template escapes it. The two exceptions are `Drawing.svg`,
which the drawing program writes, and the texts in the specification of a picture, which `Picture`
sections escape by `taction.verification.report.html.pictures.words`.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any, ClassVar

Outcome = str  # "pass", "fail", "inconclusive", or "" for none


@dataclass(frozen=True, slots=True)
class Cell:
    """A cell of a table: its text, the number it sorts by (None: its text), and an outcome."""

    text: str
    number: float | None = None
    outcome: Outcome = ""


@dataclass(frozen=True, slots=True)
class Table:
    """A table; the first cell of a row is its header."""

    kind: ClassVar[str] = "table"
    title: str
    columns: tuple[str, ...]
    rows: tuple[tuple[Cell, ...], ...]
    note: str = ""


@dataclass(frozen=True, slots=True)
class Bar:
    """A value beside its limit.

    Attributes
    ----------
    share : float or None
        The part of the limit that is used: at 1 the limit is reached; None without a number.
    doubt : float
        Bound on the error of `share`.
    value, limit, reason : str
        The same in words.
    """

    name: str
    outcome: Outcome
    share: float | None
    doubt: float
    value: str
    limit: str
    reason: str

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
        """`share` in words."""
        return _percent(self.share or 0.0)

    @property
    def fill(self) -> Outcome:
        """The look of the bar; without an outcome it says whether the limit is exceeded."""
        return self.outcome or ("fail" if (self.share or 0.0) > 1.0 else "pass")


AT_LIMIT, END, SHORTEST = 200.0, 300.0, 2.0  # units


def _place(share: float) -> float:
    return round(min(max(AT_LIMIT * share, 0.0), END), 3)


def _percent(share: float) -> str:
    """Return a fraction as per cent, a large one as a factor."""
    if share >= MANY:
        return f"{share:.3g} times the limit"
    return f"{100 * share:.3g} % of the limit" if share >= LEAST else LITTLE


MANY, LEAST = 10.0, 1e-4
LITTLE = f"below {100 * LEAST:g} % of the limit"


@dataclass(frozen=True, slots=True)
class Bars:
    """Values beside their limits."""

    kind: ClassVar[str] = "bars"
    title: str
    rows: tuple[Bar, ...]
    note: str = ""


@dataclass(frozen=True, slots=True)
class Range:
    """The spread of a quantity; places are fractions of the width, from 0 to 1."""

    name: str
    low: float
    middle: float
    high: float
    limits: tuple[float, ...]  # places of the limits
    outcome: Outcome
    texts: tuple[str, ...]  # the least, the typical and the largest value, and the limits


@dataclass(frozen=True, slots=True)
class Ranges:
    """Spreads of several quantities."""

    kind: ClassVar[str] = "ranges"
    title: str
    rows: tuple[Range, ...]
    note: str = ""


@dataclass(frozen=True, slots=True)
class View:
    """A part of a picture that a button shows: the changes of the layout."""

    name: str
    layout: Mapping[str, Any]


@dataclass(frozen=True, slots=True)
class Picture:
    """A picture with zoom and hover.

    Attributes
    ----------
    spec : mapping
        `data` and `layout` of Plotly. A colour that begins with ``--`` is one of the style sheet.
    summary : str
        What the picture shows, for readers who cannot see it, and as its caption.
    height : int
        Pixels.
    views : tuple of View
        Parts of the picture, the first is shown at the start.
    zoom : bool
        Whether buttons zoom and move along the horizontal axis.
    result : str
        What the picture says, in some words behind its title.
    """

    kind: ClassVar[str] = "picture"
    title: str
    spec: Mapping[str, Any]
    summary: str
    height: int = 380
    views: tuple[View, ...] = ()
    zoom: bool = True
    result: str = ""


@dataclass(frozen=True, slots=True)
class Drawing:
    """A drawing as SVG, which nobody else's text is part of."""

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
    """Sentences."""

    kind: ClassVar[str] = "notes"
    title: str
    lines: tuple[str, ...]


Block = Table | Bars | Ranges | Picture | Drawing | Facts | Code | Notes


@dataclass(frozen=True, slots=True)
class Section:
    """A part of a report with a heading; sections without blocks are left out."""

    title: str
    blocks: tuple[Block, ...]
    lead: str = ""


@dataclass(frozen=True, slots=True)
class Report:
    """A whole report.

    Attributes
    ----------
    title, command : str
        The name of the scene or folder, and the command that made the report.
    outcome : str
        The outcome at the top; empty for a study without one.
    summary : str
        The result in a sentence.
    lines : tuple of str
        What was studied, below the title.
    """

    title: str
    command: str
    outcome: Outcome
    summary: str
    lines: tuple[str, ...]
    sections: tuple[Section, ...]
