"""The process side of a worker: answer calls until the parent ends or closes the pipe."""

from __future__ import annotations

import multiprocessing
import os
import pickle
import signal
import sys
import threading
import time
from contextlib import suppress
from multiprocessing.connection import Connection

from taction.system.processes import Ended, ending_signals

GRACE = 2.0  # s between the clean-up's start and a hard end
STATUS = 128 + signal.SIGTERM


def serve(pipe: Connection) -> None:
    """Answer calls until the other end closes; the parent handles Ctrl-C and a lost terminal.

    SIGTERM ends a call through its `finally` clauses, which end a simulator.
    """
    for name in ("SIGINT", "SIGHUP"):
        if hasattr(signal, name):
            signal.signal(getattr(signal, name), signal.SIG_IGN)
    with suppress(EOFError, OSError, Ended), ending_signals() as received:
        threading.Thread(target=_end_with_parent, daemon=True).start()
        pipe.send("ready")
        while not received:
            done, value = _answer(pipe.recv_bytes())
            if not received:  # a call may drop the exception, and go on
                _send(pipe, done, value)
    if received:
        sys.exit(STATUS)


def _answer(request: bytes) -> tuple[bool, object]:
    """Return whether a call came to its end, and its result or its error."""
    try:
        function, args, kw = pickle.loads(request)  # noqa: S301 - from the parent
        return True, function(*args, **kw)
    except Exception as error:
        return False, error


def _send(pipe: Connection, done: bool, value: object) -> None:
    """Send an answer, or the error that it cannot be sent."""
    try:
        pipe.send((done, value))
    except OSError:
        raise
    except Exception as error:
        pipe.send((False, TypeError(f"{value!r:.200} cannot be sent: {error}")))


def _end_with_parent() -> None:
    """Wait for the parent's end, also by a kill; then end this process."""
    parent = multiprocessing.parent_process()
    if parent is not None:
        parent.join()
        os.kill(os.getpid(), signal.SIGTERM)
        time.sleep(GRACE)
        os._exit(STATUS)
