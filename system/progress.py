"""How far a job is: its stages as lines of text, and the wall time of each."""

from __future__ import annotations

import time
from collections.abc import Callable

Progress = Callable[[str], None]


class Notice(str):
    """A line of progress that is shown even where stages are not, such as how long a run takes."""

    __slots__ = ()


class Clock:
    """Wall time of each stage, s."""

    def __init__(self, progress: Progress) -> None:
        self.seconds: dict[str, float] = {}
        self._progress = progress
        self._last = time.perf_counter()
        self._stage = ""

    def begin(self, stage: str, beside: str = "", remark: str = "") -> None:
        """End the current stage and begin `stage`, or continue a stage that began before.

        `beside` names a stage whose processes run at the same time; `remark` is for the reader.
        """
        self._close()
        self._stage = stage
        announced = bool(remark) and not beside
        remark = remark or (f"while the {beside} runs" if beside else "")
        text = f"{stage} ({remark})" if remark else stage
        self._progress(Notice(text) if announced else text)

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
