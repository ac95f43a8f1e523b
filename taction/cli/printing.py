"""What a command says: JSON on stdout, the console, lines and progress on stderr."""

from __future__ import annotations

import re
import sys
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from typing import TYPE_CHECKING, Any

import click

from taction.system.foreign_files import shortened, visible_lines
from taction.system.progress import Notice

if TYPE_CHECKING:
    from rich.console import Console
    from rich.progress import Progress


STATUS = {"pass": 0, "fail": 1, "bad input": 2, "inconclusive": 3}
"""Exit status of an outcome."""
FIRST = 10.0  # s before the first line of progress: a short command says nothing
GROWTH = 1.5  # of the time from one line to the next
LONGEST = 300.0  # s between two lines
WIDE = 100  # columns that hold the bar beside the numbers
COUNTED = re.compile(r"(.*?)(\d+) of (\d+)\b")
SETTLED = 1.0  # s of counting before the time left is said


def say(text: str) -> None:
    """Print a line of text on stderr, below the command's name."""
    click.echo(f"taction: {shortened(visible_lines(text))}", err=True)


def console(*, stderr: bool = False) -> Console:
    """Return the console that results print on."""
    from taction.verification.report.renderers.terminal import Terminal

    return Terminal(stderr=stderr)


def put(*what: Any, **more: Any) -> None:
    """Print on the console of results, as ``rich`` does."""
    console().print(*what, **more)


def print_json(document: object, schema: str | None = None) -> None:
    """Print one JSON document on stdout; NaN and infinities become null.

    Its field `taction` says what made it. `schema` is the name of its schema, by default that of
    the command; an empty name leaves the document as it is.
    """
    import json

    from taction.system.documents import plain

    name = own_name(click.get_current_context(silent=True)) if schema is None else schema
    if name:
        from taction.verification.report.documents.document_catalogue import document_head

        document = {**document_head(name), **plain(document)}
    click.echo(json.dumps(plain(document), indent=2, ensure_ascii=False, allow_nan=False))


def own_name(context: click.Context | None) -> str:
    """Return the name of a command, with that above it: "models-show", whatever was typed.

    The program and its families of commands have no name of their own.
    """
    names: list[str] = []
    while context is not None:
        names.insert(0, context.command.name or "")
        context = context.parent
    return "-".join(filter(None, names))


def duration(seconds: float) -> str:
    """Return a duration for people, about two digits.

    Examples
    --------
    >>> [duration(seconds) for seconds in (0.3, 42.4, 700.0, 9000.0)]
    ['1 s', '42 s', '12 min', '2.5 h']
    """
    if seconds < 100.0:
        return f"{max(round(seconds), 1)} s"
    return f"{seconds / 60.0:.0f} min" if seconds < 6000.0 else f"{seconds / 3600.0:.1f} h"


class TimeLeft:
    """Adds the time left to the stages that count, by their pace since the first of the same name.

    Examples
    --------
    >>> seconds = iter([5.0, 7.0, 9.0])
    >>> left = TimeLeft(lambda: next(seconds))
    >>> [left(f"yield: {done} of 9 samples") for done in (1, 3, 5)][1:]
    ['yield: 3 of 9 samples, about 6 s left', 'yield: 5 of 9 samples, about 4 s left']
    """

    def __init__(self, clock: Callable[[], float] = time.monotonic) -> None:
        self._clock, self._counted, self._began, self._first = clock, ("", ""), 0.0, 0

    def __call__(self, stage: str) -> str:
        """Return the stage with the time left, as far as it is known."""
        if (counted := COUNTED.match(stage)) is None:
            return stage
        name, done, total = counted[1], int(counted[2]), int(counted[3])
        now = self._clock()
        if self._counted != (name, counted[3]) or done <= self._first:
            self._counted, self._began, self._first = (name, counted[3]), now, done
        elapsed, ended = now - self._began, done - self._first
        if not ended or elapsed < SETTLED or done >= total:
            return stage
        return f"{stage}, about {duration((total - done) * elapsed / ended)} left"


class SparseLines:
    """Says a stage now and then: after 10 s, 15 s, 22 s, ..., at last every five minutes.

    Examples
    --------
    >>> seconds = iter([0.0, 1.0, 11.0, 12.0, 20.0])
    >>> lines = SparseLines(print, lambda: next(seconds))
    >>> for count in range(1, 5):
    ...     lines.stage(f"{count} of 9")
    2 of 9
    4 of 9
    """

    def __init__(
        self, say: Callable[[str], None], clock: Callable[[], float] = time.monotonic
    ) -> None:
        self._say, self._clock, self._start, self._due = say, clock, clock(), FIRST

    def stage(self, text: str) -> None:
        """Say `text` if a line is due."""
        elapsed = self._clock() - self._start
        if elapsed >= self._due:
            self._due = min(elapsed * GROWTH, elapsed + LONGEST)
            self._say(text)


class StageLine:
    """Shows the stages of a function on stderr; `bar` is None where stderr is no terminal.

    A `Notice` is always a line of its own, and is said once.
    """

    def __init__(self, show: Callable[[str], None], bar: Progress | None = None) -> None:
        self._show, self._bar, self._left = show, bar, TimeLeft()
        self._said: set[str] = set()

    def __call__(self, stage: str) -> None:
        """Show a stage."""
        if not isinstance(stage, Notice):
            self._show(self._left(stage))
        elif stage not in self._said:
            self._said.add(stage)
            with self.aside():
                say(stage)

    @contextmanager
    def aside(self) -> Iterator[None]:
        """Take the bar away while a line is printed."""
        if self._bar is None:
            yield
            return
        self._bar.stop()
        yield
        self._bar.start()


@contextmanager
def display() -> Iterator[StageLine]:
    """Show the stages of a function on stderr: as a bar, or without a terminal as a few lines."""
    if not sys.stderr.isatty():
        yield StageLine(SparseLines(say).stage)
        return
    from rich.progress import BarColumn, Progress, SpinnerColumn, TextColumn, TimeElapsedColumn
    from rich.table import Column

    page = console(stderr=True)
    bar = [BarColumn()] if page.width >= WIDE else []
    words = TextColumn("{task.description}", table_column=Column(overflow="fold", no_wrap=False))
    columns = (SpinnerColumn(), *bar, TimeElapsedColumn(), words)
    with Progress(*columns, console=page, transient=True) as shown:
        task = shown.add_task("starting", total=None)

        def show(stage: str) -> None:
            counted = COUNTED.match(stage)
            done, total = map(int, counted.groups()[1:]) if counted else (0, None)
            shown.update(task, completed=done, total=total, description=stage)

        yield StageLine(show, shown)
