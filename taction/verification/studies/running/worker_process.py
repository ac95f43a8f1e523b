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

GRACE = 2.0  # s between the clean-up's start and a hard end
STATUS = 128 + signal.SIGTERM


def serve(pipe: Connection) -> None:
    """Answer calls until the other end closes; the parent handles Ctrl-C and a lost terminal."""
    for name in ("SIGINT", "SIGHUP"):
        if hasattr(signal, name):
            signal.signal(getattr(signal, name), signal.SIG_IGN)

    def unwind(number: int, frame: object) -> None:
        """End through the `finally` clauses, which end a simulator; no answer is sent any more."""
        signal.signal(signal.SIGTERM, signal.SIG_IGN)  # a second one must not stop the clean-up
        hard_end = threading.Timer(GRACE, os._exit, (STATUS,))
        hard_end.daemon = True  # where a library drops the `SystemExit`
        hard_end.start()
        pipe.close()
        sys.exit(STATUS)

    signal.signal(signal.SIGTERM, unwind)
    threading.Thread(target=_end_with_parent, daemon=True).start()
    with suppress(EOFError, OSError):
        pipe.send("ready")
        while True:
            _answer(pipe, pipe.recv_bytes())


def _answer(pipe: Connection, request: bytes) -> None:
    try:
        function, args, kw = pickle.loads(request)  # noqa: S301 - from the parent
        answer = (True, function(*args, **kw))
    except Exception as error:
        answer = (False, error)
    try:
        pipe.send(answer)
    except OSError:
        raise
    except Exception as error:
        pipe.send((False, TypeError(f"{answer[1]!r:.200} cannot be sent: {error}")))


def _end_with_parent() -> None:
    """Wait for the parent's end, also by a kill; then end this process."""
    parent = multiprocessing.parent_process()
    if parent is not None:
        parent.join()
        os.kill(os.getpid(), signal.SIGTERM)
        time.sleep(GRACE)
        os._exit(STATUS)
