"""The process side of a worker: answer calls until the parent ends or closes the pipe."""

from __future__ import annotations

import gc
import multiprocessing
import os
import pickle
import signal
import sys
import threading
from collections.abc import Mapping
from contextlib import suppress
from multiprocessing import connection
from multiprocessing.connection import Connection

GRACE = 2.0  # s between the clean-up's start and a hard end


def serve(pipe: Connection, variables: Mapping[str, str]) -> None:
    """Answer calls until the other end closes; the parent handles Ctrl-C and a lost terminal.

    `variables` is the environment of the parent: a fork server has that of its own start.
    """
    os.environ.clear()
    os.environ.update(variables)
    for name in ("SIGINT", "SIGHUP"):
        if hasattr(signal, name):
            signal.signal(getattr(signal, name), signal.SIG_IGN)
    signal.signal(signal.SIGTERM, _unwind)
    parent = multiprocessing.parent_process()
    if parent is not None:
        threading.Thread(target=_end_after, args=(parent.sentinel,), daemon=True).start()
    gc.freeze()  # no collection needs to visit the imported modules again
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


def _unwind(number: int, frame: object) -> None:
    """End this process through all its `finally` clauses."""
    signal.signal(signal.SIGTERM, signal.SIG_IGN)  # a second signal must not stop the clean-up
    sys.exit(128 + number)


def _end_after(sentinel: int) -> None:
    """End this process when its parent ends, also during a computation."""
    connection.wait([sentinel])
    os.kill(os.getpid(), signal.SIGTERM)
    threading.Event().wait(GRACE)
    os._exit(128 + signal.SIGTERM)
