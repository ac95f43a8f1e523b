"""The console that reports print on."""

from __future__ import annotations

import errno
import os
from typing import IO, Any, NoReturn

from rich.console import Console

WIDTH = 160  # columns of a page in a file or a pipe, unless the variable COLUMNS says otherwise


class Page(Console):
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
