"""How long a study of equal tasks still takes, from the tasks that ended."""

from __future__ import annotations

import time
from collections.abc import Callable

LEAST = 3  # tasks before anything is said
SETTLED = 1.0  # s before anything is said


class Pace:
    """The pace of a study since its first task ended: workers take some seconds to start."""

    def __init__(self, clock: Callable[[], float] = time.perf_counter) -> None:
        self._clock, self._first, self._done = clock, 0.0, 0

    def ended(self, left: int) -> str:
        """Count one task that ended; return the time that the `left` others need.

        Empty for the first tasks, in the first second, and where none is left.

        Examples
        --------
        >>> seconds = iter([0.0, 10.0, 20.0])
        >>> pace = Pace(lambda: next(seconds))
        >>> [pace.ended(left) for left in (602, 601, 600)]
        ['', '', ', about 1:40:00 left']
        """
        self._done += 1
        now = self._clock()
        if self._done == 1:
            self._first = now
        elapsed = now - self._first
        if self._done < LEAST or elapsed < SETTLED or not left:
            return ""
        seconds = round(elapsed / (self._done - 1) * left)
        return f", about {seconds // 3600}:{seconds // 60 % 60:02}:{seconds % 60:02} left"
