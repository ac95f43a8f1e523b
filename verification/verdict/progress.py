"""How much a verification computes, and how far it is: its extent, the wall time of its stages."""

from __future__ import annotations

import time
from collections.abc import Callable
from dataclasses import dataclass

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


@dataclass(frozen=True, slots=True)
class Effort:
    """Results that a verification computes in addition to the checks.

    No outcome and no reading of a check depends on these choices.

    Attributes
    ----------
    details : bool
        Whether to compute the figures of the constraint plane, the error budget and the energy.
    full_margin : bool
        Whether to scan the stability margin up to `REACH`, not only up to the limit of the scene.
    """

    details: bool = True
    full_margin: bool = True


FULL = Effort()
