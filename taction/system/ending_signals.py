"""Signals that end a process raise an exception in it, so that all clean-up runs."""

from __future__ import annotations

import os
import signal
import sys
import threading
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from types import FrameType
from typing import Any

ENDING = ("SIGINT", "SIGTERM", "SIGHUP")
AGAIN = 0.02  # s until a signal comes again whose exception was lost


class Ended(KeyboardInterrupt):
    """A signal of `ENDING`; after a plain `KeyboardInterrupt` Python may end itself by SIGINT."""


@contextmanager
def ending_signals() -> Iterator[list[int]]:
    """Raise `Ended` once at a signal of `ENDING`; the list receives the numbers of the signals.

    A signal that the process ignores, as below nohup, stays ignored. After the first signal a
    second one of its kind cannot stop the clean-up, nor the end of Python.
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
