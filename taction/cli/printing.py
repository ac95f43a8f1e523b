"""What a command says: JSON on stdout, the console, lines and progress on stderr."""

from __future__ import annotations

import re
import sys
from collections.abc import Iterable, Iterator
from contextlib import contextmanager
from time import monotonic
from typing import TYPE_CHECKING

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
COUNTED = re.compile(r"(\d+) of (\d+)\b")


def say(text: str) -> None:
    """Print a line of text on stderr, below the command's name."""
    click.echo(f"taction: {shortened(visible_lines(text))}", err=True)


def tell(lines: Iterable[str]) -> None:
    """Print lines on stderr as they are."""
    for line in lines:
        click.echo(line, err=True)


def console(*, stderr: bool = False) -> Console:
    """Return the console that results print on."""
    from taction.verification.report.renderers.terminal import Terminal

    return Terminal(stderr=stderr)


def print_json(document: object, schema: str) -> None:
    """Print one JSON document on stdout; NaN and infinities become null.

    Its field `taction` says what made it. `schema` is the name of its schema, such as
    "models-show"; an empty name leaves the document as it is.
    """
    import json

    from taction.system.documents import plain

    if schema:
        from taction.verification.report.documents.document_catalogue import document_head

        document = {**document_head(schema), **plain(document)}
    click.echo(json.dumps(plain(document), indent=2, ensure_ascii=False, allow_nan=False))


class StageLine:
    """Shows the stages of a function on stderr: as a bar, or without a terminal as a few lines.

    These come after 10 s, 15 s, 22 s, ..., at last every five minutes. A `Notice` is always a line
    of its own, and is said once.
    """

    def __init__(self, bar: Progress | None = None) -> None:
        self._bar, self._start, self._due, self._said = bar, monotonic(), FIRST, set[str]()
        self._task = None if bar is None else bar.add_task("starting", total=None)

    def __call__(self, stage: str) -> None:
        """Show a stage."""
        if isinstance(stage, Notice):
            if stage not in self._said:
                self._said.add(stage)
                with self.aside():
                    say(stage)
        elif self._bar is not None and self._task is not None:
            counted = COUNTED.search(stage)
            done, total = map(int, counted.groups()) if counted else (0, None)
            self._bar.update(self._task, completed=done, total=total, description=stage)
        elif (elapsed := monotonic() - self._start) >= self._due:
            self._due = min(elapsed * GROWTH, elapsed + LONGEST)
            say(stage)

    @contextmanager
    def aside(self) -> Iterator[None]:
        """Take the bar away while something else is printed."""
        if self._bar is not None:
            self._bar.stop()
        yield
        if self._bar is not None:
            self._bar.start()


@contextmanager
def display() -> Iterator[StageLine]:
    """Show the stages of a function on stderr."""
    if not sys.stderr.isatty():
        yield StageLine()
        return
    from rich import progress
    from rich.table import Column

    page, column = console(stderr=True), Column(overflow="fold", no_wrap=False)
    bar = [progress.BarColumn(), progress.TimeRemainingColumn()] if page.width >= WIDE else []
    words = progress.TextColumn("{task.description}", table_column=column)
    columns = (progress.SpinnerColumn(), *bar, progress.TimeElapsedColumn(), words)
    with progress.Progress(*columns, console=page, transient=True) as shown:
        yield StageLine(shown)
