"""What a study knows of its workers: where to send points, how many, and how workers fail."""

from __future__ import annotations

from collections.abc import Callable
from concurrent.futures import Executor
from dataclasses import dataclass


@dataclass(frozen=True, slots=True)
class Workers:
    """An executor with its capacity and its exceptions."""

    executor: Executor
    window: Callable[[], int]  # number of points to submit at a time, so that no worker waits
    lost: tuple[type[BaseException], ...]  # raised by a point that killed its workers
    closed: tuple[type[BaseException], ...] = (RuntimeError,)  # raised without workers
    processes: Callable[[], int] = lambda: 1  # number of points that are computed at a time
    start_up: float = 0.0  # s of processor time before the first point
    check: Callable[[], None] = lambda: None  # raises NoVerdictError if no worker will answer
