"""One limit of time for several runs of another program.

Each run asks how long it may still take; none has a limit of its own beyond that.
"""

from __future__ import annotations

import math
import time
from collections.abc import Iterator
from contextlib import contextmanager
from contextvars import ContextVar

_END: ContextVar[float] = ContextVar("end of all runs", default=math.inf)


@contextmanager
def one_limit(seconds: float) -> Iterator[None]:
    """Give all runs within this block one limit together, s of wall time.

    Examples
    --------
    >>> with one_limit(0.0):
    ...     time_left(20.0)
    0.0
    >>> time_left(20.0)
    20.0
    """
    token = _END.set(min(_END.get(), time.monotonic() + seconds))
    try:
        yield
    finally:
        _END.reset(token)


@contextmanager
def more_time(seconds: float) -> Iterator[None]:
    """Add seconds to the limit for the runs within, such as those of a further value."""
    token = _END.set(_END.get() + seconds)
    try:
        yield
    finally:
        _END.reset(token)


def time_left(seconds: float) -> float:
    """Return how long a run may take that would take at most `seconds`, s; 0 if no time is left."""
    return min(seconds, max(_END.get() - time.monotonic(), 0.0))
