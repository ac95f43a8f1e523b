"""The process side of a worker: answer calls until the parent ends or closes the pipe."""

from __future__ import annotations

import gc
import multiprocessing
import os
import pickle
import signal
import socket
import sys
import threading
from collections.abc import Mapping
from contextlib import suppress
from multiprocessing import connection
from multiprocessing.connection import Connection

GRACE = 2.0  # s between the clean-up's start and a hard end
STATUS = 128 + signal.SIGTERM


def serve(pipe: Connection, variables: Mapping[str, str]) -> None:
    """Answer calls until the other end closes; the parent handles Ctrl-C and a lost terminal.

    `variables` is the environment of the parent: a fork server has that of its own start.
    """
    os.environ.clear()
    os.environ.update(variables)
    for name in ("SIGINT", "SIGHUP"):
        if hasattr(signal, name):
            signal.signal(getattr(signal, name), signal.SIG_IGN)
    ending = threading.Event()
    _end_within_grace(ending)
    gc.freeze()  # no collection needs to visit the imported modules again
    with suppress(EOFError, OSError):
        pipe.send("ready")
        while True:
            _answer(pipe, pipe.recv_bytes(), ending)


def _answer(pipe: Connection, request: bytes, ending: threading.Event) -> None:
    try:
        function, args, kw = pickle.loads(request)  # noqa: S301 - from the parent
        answer = (True, function(*args, **kw))
    except Exception as error:
        answer = (False, error)
    if ending.is_set():  # a library caught the `SystemExit`, as pydantic's serializers do
        sys.exit(STATUS)
    try:
        pipe.send(answer)
    except OSError:
        raise
    except Exception as error:
        pipe.send((False, TypeError(f"{answer[1]!r:.200} cannot be sent: {error}")))


def _end_within_grace(ending: threading.Event) -> None:
    """Let SIGTERM, and the end of the parent, end this process through its `finally` clauses.

    `GRACE` seconds later the process ends anyway: where a library drops the `SystemExit`, where
    compiled code never returns to Python, and where the signal comes just before a read.
    """
    wake, woken = socket.socketpair()
    woken.setblocking(False)
    signal.set_wakeup_fd(woken.fileno(), warn_on_full_buffer=False)

    def unwind(number: int, frame: object) -> None:
        signal.signal(signal.SIGTERM, signal.SIG_IGN)  # a second one must not stop the clean-up
        ending.set()
        sys.exit(STATUS)

    signal.signal(signal.SIGTERM, unwind)
    threading.Thread(target=_watch, args=(wake, woken), daemon=True).start()


def _watch(wake: socket.socket, woken: socket.socket) -> None:
    """Wait for SIGTERM at `wake`, or for the parent's end; then end this process after `GRACE`.

    (`woken` is the other end of the pair, which must stay open.)
    """
    parent = multiprocessing.parent_process()
    ends = [] if parent is None else [parent.sentinel]
    while True:
        ready = connection.wait([wake, *ends])
        if wake in ready and signal.SIGTERM in wake.recv(16):
            break
        if ends and ends[0] in ready:
            os.kill(os.getpid(), signal.SIGTERM)
            break
    threading.Event().wait(GRACE)
    os._exit(STATUS)
