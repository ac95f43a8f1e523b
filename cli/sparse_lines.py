"""The stages of a long command where stderr is no terminal: a few lines, ever further apart."""

from __future__ import annotations

import time
from collections.abc import Callable

FIRST = 10.0  # s before the first line: a short command says nothing
GROWTH = 1.5  # of the time from one line to the next
LONGEST = 300.0  # s between two lines


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
