"""How far a job is: its stages as lines of text, and the wall time of each.

A simulation does not know who waits for it. It calls `reached` with the share that is done;
`shares_to` names the receiver of these calls, and without one nothing happens.

What follows a result runs in `attempt`: a step that fails costs that step, never the result. A
verdict is complete before changes are searched, warnings collected, pictures drawn and reports
written. Each of these is optional.
"""

from __future__ import annotations

import time
from collections.abc import Callable, Iterable, Iterator
from contextlib import contextmanager
from contextvars import ContextVar
from typing import TypeVar

from taction.system.foreign_files import shortened, visible

Progress = Callable[[str], None]

BETWEEN_SHARES = 1.0  # s

_receiver: ContextVar[Callable[[float], None] | None] = ContextVar("receiver", default=None)


def reached(share: float) -> None:
    """Say that a share of the simulation that runs is done, 0 to 1."""
    receiver = _receiver.get()
    if receiver is not None and 0.0 <= share <= 1.0:
        receiver(share)


@contextmanager
def shares_to(receiver: Callable[[float], None]) -> Iterator[None]:
    """Within the block, hand every share that is `reached` to `receiver`."""
    token = _receiver.set(receiver)
    try:
        yield
    finally:
        _receiver.reset(token)


class Notice(str):
    """A line of progress that is shown even where stages are not, such as how long a run takes."""

    __slots__ = ()


def ask(questions: Iterable[str], progress: Progress) -> None:
    """Ask what may be a slip in the input; nobody waits for an answer."""
    for question in questions:
        progress(Notice(f"question: {question}"))


class Clock:
    """Wall time of each stage, s."""

    def __init__(self, progress: Progress) -> None:
        self.seconds: dict[str, float] = {}
        self._progress = progress
        self._last = time.perf_counter()
        self._stage = ""
        self._said: set[str] = set()

    @contextmanager
    def listening(self) -> Iterator[None]:
        """Within the block, show how far the simulation of a stage is."""
        shown = time.monotonic()

        def show(share: float) -> None:
            nonlocal shown
            now = time.monotonic()
            if self._stage and now - shown >= BETWEEN_SHARES:
                shown = now
                self._progress(f"{self._stage}, {100.0 * share:.0f} of 100 %")

        with shares_to(show):
            yield

    def begin(self, stage: str, beside: str = "", remark: str = "") -> None:
        """End the current stage and begin `stage`, or continue a stage that began before.

        `beside` names a stage whose processes run at the same time; a `remark` is for the reader
        and is said once.
        """
        self._close()
        self._stage = stage
        if remark and remark not in self._said:
            self._said.add(remark)
            self._progress(Notice(f"{stage} ({remark})"))
        self._progress(f"{stage} (while the {beside} runs)" if beside else stage)

    def pause(self) -> None:
        """End the current stage; the time until the next one belongs to none."""
        self._close()
        self._stage = ""

    def end(self) -> None:
        """End the last stage and add the total."""
        self.pause()
        self.seconds["total"] = sum(self.seconds.values())

    def _close(self) -> None:
        now = time.perf_counter()
        if self._stage:
            self.seconds[self._stage] = self.seconds.get(self._stage, 0.0) + now - self._last
        self._last = now


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

    `what`: what the step makes: "the search for changes".
    `tell`: receives the line.
    `passes`: whether an error is not that of the step, such as a reader of stdout who has gone.
      Ctrl-C always passes through.

    Examples
    --------
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
