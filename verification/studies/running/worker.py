"""A Python process that answers one call after the other, and that can be stopped.

The pool of a study is several of these; the work-precision study has one, because an integrator
inside its own process could not be stopped when its time is up.
"""

from __future__ import annotations

import gc
import multiprocessing
import os
import pickle
import signal
import sys
import threading
from collections.abc import Callable, Iterator, Mapping
from concurrent.futures import BrokenExecutor
from contextlib import contextmanager, suppress
from multiprocessing import connection, util
from multiprocessing.connection import Connection
from typing import Any, TypeVar

from spice_models.errors import NoVerdictError
from verification.engines.ngspice.session import end_session

T = TypeVar("T")

START_UP = 60.0  # s; a busy machine may take long to start Python and load SciPy
STARTS = 5  # processes that may end while they start, one after the other
GRACE = 2.0  # s that a process has to end what it does, before it is killed
_STARTING = threading.Lock()  # the environment is one for all threads


class WorkerDiedError(BrokenExecutor):
    """The process of a call ended before the call did."""


# What a computation may raise, or its process, that says nothing of the next one.
FAILURES = (NoVerdictError, ArithmeticError, MemoryError, ValueError, WorkerDiedError)


class Worker:
    """One process, started by the first call and again after a call that it did not survive.

    Parameters
    ----------
    context : multiprocessing context, optional
        How the process is started; anew, without anything of this one, if not given.
    variables : mapping of str to str
        Of its environment, and of the fork server's where this is the first to need one.
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
        """Return ``function(*args, **kw)``, computed in the process; what it raises is raised.

        Parameters
        ----------
        timeout : float or None
            s, None for no limit; the start of the process does not count.
        function : callable
            Of a module's top level; arguments and result can be pickled.

        Raises
        ------
        TimeoutError
            The call took longer; the process was ended.
        WorkerDiedError
            The process ended, or did not start.
        """
        pipe = self.start()
        if self._ended:  # another thread said so while the process started
            self.stop()
            raise WorkerDiedError("the process was ended")
        try:
            pipe.send((function, args, kw))
            in_time = pipe.poll(None if timeout is None else max(timeout, 0.0))
            answer: tuple[bool, Any] = pipe.recv() if in_time else (False, None)
        except (EOFError, OSError):
            self.stop()
            name = getattr(function, "__name__", function)
            raise WorkerDiedError(f"the process that ran {name} died") from None
        if not in_time:
            self.stop()
            raise TimeoutError(f"not done after {timeout:.3g} s")
        done, result = answer
        if not done:
            raise result
        found: T = result
        return found

    def start(self) -> Connection:
        """Start the process, unless it runs already.

        Raises
        ------
        WorkerDiedError
            It does not start.
        """
        if self._pipe is not None and self._process is not None and self._process.is_alive():
            return self._pipe
        left = STARTS
        while True:
            try:
                return self._start()
            except (EOFError, OSError) as error:
                self.stop()
                left -= 1
                if self._ended or not left:
                    text = f"a second Python process did not start: {error}"
                    raise WorkerDiedError(text) from error

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
        """End the process; what it does is unwound first, which ends its simulator."""
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
        """End the process for good, from any thread; a call that is under way is lost."""
        self._ended, process = True, self._process
        with suppress(AttributeError, ValueError):  # there is none, or it was closed just now
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
    """Answer calls until the other end closes; Ctrl-C is the parent's business."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    signal.signal(signal.SIGTERM, _unwind)
    parent = multiprocessing.parent_process()
    if parent is not None:
        threading.Thread(target=_end_with, args=(parent.sentinel,), daemon=True).start()
    util.Finalize(None, end_session, exitpriority=0)  # workers end without atexit
    gc.freeze()  # what was imported stays: no collection needs to look at it again
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
    """End this process by way of every `finally` of what it does."""
    signal.signal(signal.SIGTERM, signal.SIG_IGN)  # the way out is not left half-way
    sys.exit(128 + number)


def _end_with(sentinel: int) -> None:
    """End this process when its parent is gone, which a process that computes would not notice."""
    connection.wait([sentinel])
    os.kill(os.getpid(), signal.SIGTERM)
    threading.Event().wait(GRACE)
    os._exit(128 + signal.SIGTERM)
