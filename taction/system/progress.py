"""How far a job is: its stages as lines of text, and the wall time of each.

What follows a result runs in `attempt`: a step that fails costs that step, never the result. A
verdict is complete before changes are searched, warnings collected, pictures drawn and reports
written. Each of these is optional.
"""

from __future__ import annotations

import time
from collections.abc import Callable
from typing import TypeVar

from taction.system.foreign_files import shortened, visible

Progress = Callable[[str], None]


class Notice(str):
    """A line of progress that is shown even where stages are not, such as how long a run takes."""

    __slots__ = ()


class Clock:
    """Wall time of each stage, s."""

    def __init__(self, progress: Progress) -> None:
        self.seconds: dict[str, float] = {}
        self._progress, self._stage, self._since = progress, "", time.perf_counter()

    def begin(self, stage: str) -> None:
        """End the current stage and begin `stage`, or go on with one that began before."""
        now = time.perf_counter()
        if self._stage:
            self.seconds[self._stage] = self.seconds.get(self._stage, 0.0) + now - self._since
        self._stage, self._since = stage, now
        if stage:
            self._progress(stage)

    def end(self) -> None:
        """End the last stage and add the total."""
        self.begin("")
        self.seconds["total"] = sum(self.seconds.values())


T = TypeVar("T")
LONGEST = 400  # characters of what went wrong
FAILURES: tuple[type[Exception], ...] = (Exception,)
"""What costs a step alone; the tests empty it, so that no mistake stays unseen."""


def attempt(
    what: str,
    step: Callable[[], T],
    otherwise: T,
    tell: Callable[[str], object],
    passes: Callable[[Exception], bool] = lambda error: False,
) -> T:
    """Return what a step returns; if it fails, tell it in one line and return `otherwise`.

    `passes` says which errors are not those of the step, such as a reader of stdout who has gone.

    >>> attempt("the number", lambda: float("1V"), None, print)
    the number failed, the result stands: ValueError: could not convert string to float: '1V'
    """
    try:
        return step()
    except FAILURES as error:
        if passes(error):
            raise
        text = f"{type(error).__name__}: {error}" if str(error) else type(error).__name__
        tell(f"{what} failed, the result stands: {shortened(visible(text), LONGEST)}")
        return otherwise
