"""Processes: a guard of those we start, one limit of time for several, signals that end ours.

With `one_limit` each run asks how long it may still take; none has a limit of its own beyond that.

Signals that end this process raise an exception in it, so that all clean-up runs.
"""

from __future__ import annotations

import functools
import math
import os
import shutil
import signal
import subprocess
import sys
import threading
import time
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from contextvars import ContextVar
from types import FrameType
from typing import Any

THREADS = ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS")
"""The variables that set how many threads the linear algebra libraries use."""

GUARD_OPTIONS = ("--pdeathsig", "KILL")  # of `setpriv`: the signal for a process whose parent ends


@functools.cache
def guard() -> tuple[str, ...]:
    """Return the words before a command that ends with the thread that starts it, also by a kill.

    Empty where the system has no such guard.
    """
    setpriv = shutil.which("setpriv") if sys.platform == "linux" else None
    if setpriv is None:
        return ()
    trial = subprocess.run([setpriv, *GUARD_OPTIONS, "true"], capture_output=True, check=False)
    return (setpriv, *GUARD_OPTIONS) if trial.returncode == 0 else ()


_END: ContextVar[float] = ContextVar("end of all runs", default=math.inf)


@contextmanager
def one_limit(seconds: float) -> Iterator[None]:
    """Give all runs within this block one limit together, s of wall time."""
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


ENDING = ("SIGINT", "SIGTERM", "SIGHUP")
AGAIN = 0.02  # s until a signal comes again whose exception was lost


class Ended(KeyboardInterrupt):
    """A signal of `ENDING`; after a plain `KeyboardInterrupt` Python may end itself by SIGINT."""


@contextmanager
def ending_signals() -> Iterator[list[int]]:
    """Raise `Ended` once at a signal of `ENDING`; the list receives the numbers of the signals.

    A signal that the process ignores, as below nohup, stays ignored. A second one of the same kind
    cannot stop the clean-up, nor the end of Python.
    """
    received: list[int] = []

    def end(number: int, frame: FrameType | None) -> None:
        signal.signal(number, signal.SIG_IGN)
        received.append(number)
        raise Ended

    def show(lost: Any) -> None:
        """Send a signal again whose exception Python has dropped, as in a callback."""
        if not isinstance(lost.exc_value, Ended):
            hook(lost)
            return
        number = received.pop()
        signal.signal(number, end)
        threading.Timer(AGAIN, os.kill, (os.getpid(), number)).start()

    before: dict[int, Any] = {}
    usual = (signal.SIG_DFL, signal.default_int_handler)
    for name in ENDING:
        number = getattr(signal, name, None)  # SIGHUP is unknown on some systems
        if number is not None and signal.getsignal(number) in usual:
            with suppress(ValueError):  # not the main thread
                before[number] = signal.signal(number, end)
    hook, sys.unraisablehook = sys.unraisablehook, show
    try:
        yield received
    finally:
        sys.unraisablehook = hook
        for number in before.keys() - received:
            signal.signal(number, before[number])
