"""A Python process that runs one call after the other and can be stopped.

The pool of a study has several workers; the work-precision study has one worker, because an
integration in the study's own process cannot be interrupted when its time is up.
"""

from __future__ import annotations

import gc
import multiprocessing
import os
import pickle
import signal
import sys
import threading
import time
from collections.abc import Callable, Iterator, Mapping
from concurrent.futures import BrokenExecutor
from contextlib import contextmanager, suppress
from multiprocessing import connection, util
from multiprocessing.connection import Connection
from typing import Any, TypeVar

from spice_models.errors import NoVerdictError
from verification.engines.ngspice.session import end_session

T = TypeVar("T")

START_UP = 60.0  # s to start Python and load SciPy on a busy machine
STARTS = 5  # attempts to start a process
PAUSE = 0.05  # s after the first failed attempt, then twice as long each time
GRACE = 2.0  # s between SIGTERM and SIGKILL
_STARTING = threading.Lock()  # all threads share the environment


class WorkerDiedError(BrokenExecutor):
    """The process ended before the call was complete."""


# Errors of one computation or its process; the next computation may succeed.
FAILURES = (NoVerdictError, ArithmeticError, MemoryError, ValueError, WorkerDiedError)


class Worker:
    """One process, started by the first call and again after a call that ended the process.

    Parameters
    ----------
    context : multiprocessing context, optional
        Start method of the process; by default a new interpreter.
    variables : mapping of str to str
        Environment variables of the process, and of the fork server if this worker starts it.
    """

    def __init__(self, context: Any = None, variables: Mapping[str, str] | None = None) -> None:
        self._variables = variables or {}
        self._context = context or multiprocessing.get_context("spawn")
        self._ended = False
        self._process: multiprocessing.process.BaseProcess | None = None
        self._pipe: Connection | None = None

    def __enter__(self) -> Worker:
        return self

    def __exit__(self, *error: object) -> None:
        self.stop()

    @property
    def pid(self) -> int | None:
        """Process id; None before the first call."""
        return None if self._process is None else self._process.pid

    def call(self, timeout: float | None, function: Callable[..., T], *args: Any, **kw: Any) -> T:
        """Return ``function(*args, **kw)``, computed in the process, or raise its exception.

        Parameters
        ----------
        timeout : float or None
            s, None for no limit; the time to start the process does not count.
        function : callable
            Can be pickled, as its arguments and its result.

        Raises
        ------
        TimeoutError
            The call took longer; the process was stopped.
        WorkerDiedError
            The process ended, or did not start.
        """
        pipe = self.start()
        if self._ended:  # by another thread while the process started
            self.stop()
            raise WorkerDiedError("the process was ended")
        try:
            pipe.send((function, args, kw))
            in_time = pipe.poll(None if timeout is None else max(timeout, 0.0))
            answer: tuple[bool, Any] = pipe.recv() if in_time else (False, None)
        except (EOFError, OSError):
            self.stop()
            raise WorkerDiedError("the process died during the call") from None
        if not in_time:
            self.stop()
            raise TimeoutError(f"not done after {timeout:.3g} s")
        done, value = answer
        if not done:
            raise value
        result: T = value
        return result

    def start(self) -> Connection:
        """Start the process, unless it is running; raise WorkerDiedError if it does not start."""
        if self._pipe is not None and self._process is not None and self._process.is_alive():
            return self._pipe
        failure: Exception | None = None
        for attempt in range(STARTS):
            try:
                return self._start()
            except (EOFError, OSError) as error:
                self.stop()
                failure = error
                if self._ended:
                    break
                # A killed fork server refuses connections until the kernel has ended the server.
                time.sleep(PAUSE * 2**attempt)
        raise WorkerDiedError(f"a second Python process did not start: {failure}") from failure

    def _start(self) -> Connection:
        self.stop()
        self._pipe, theirs = self._context.Pipe()
        with theirs, _STARTING, _environment(self._variables):
            process = self._context.Process(target=_serve, args=(theirs,), daemon=True)
            process.start()
        self._process = process
        if not self._pipe.poll(START_UP):
            raise EOFError(f"no answer within {START_UP:g} s")
        self._pipe.recv()
        return self._pipe

    def stop(self) -> None:
        """End the process; its `finally` clauses run first and end its simulator."""
        if self._process is not None:
            self._process.terminate()
        if self._pipe is not None:
            self._pipe.close()
        if self._process is not None:
            self._process.join(GRACE)
            self._process.kill()
            self._process.join()
            self._process.close()
        self._process = self._pipe = None

    def end(self) -> None:
        """End the process for good, from any thread; a running call is lost."""
        self._ended, process = True, self._process
        with suppress(AttributeError, ValueError):  # no process, or it was just closed
            process.terminate()  # type: ignore[union-attr]


@contextmanager
def _environment(variables: Mapping[str, str]) -> Iterator[None]:
    before = {name: os.environ[name] for name in variables if name in os.environ}
    os.environ.update(variables)
    try:
        yield
    finally:
        for name in variables:
            del os.environ[name]
        os.environ.update(before)


def _serve(pipe: Connection) -> None:
    """Answer calls until the other end closes; the parent handles Ctrl-C."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    signal.signal(signal.SIGTERM, _unwind)
    parent = multiprocessing.parent_process()
    if parent is not None:
        threading.Thread(target=_end_after, args=(parent.sentinel,), daemon=True).start()
    util.Finalize(None, end_session, exitpriority=0)  # atexit does not run in workers
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
