"""A Python process that runs one call after the other and can be stopped; the workers of a study.

The pool of a study has several workers; the work-precision study has one worker, because an
integration in the study's own process cannot be interrupted when its time is up.
"""

from __future__ import annotations

import functools
import math
import multiprocessing
import os
import signal
import sys
import tempfile
import threading
import time
from collections.abc import Callable, Iterator, Mapping
from concurrent.futures import BrokenExecutor, Executor
from contextlib import contextmanager, suppress
from dataclasses import dataclass
from multiprocessing import util
from multiprocessing.connection import Connection
from types import ModuleType
from typing import Any, TypeVar

from taction.system.errors import NoVerdictError
from taction.system.own_folders import MEMORY, make_own_folder, remove_own_folder, temporary_place
from taction.system.processes import is_stopped
from taction.verification.studies.running.worker_process import GRACE, serve

T = TypeVar("T")

START_UP = 60.0  # s to start Python and load SciPy on a busy machine
STARTS = 5  # attempts to start a process
WATCH, STOPPED = 1.0, 30  # s between two looks at a busy process; looks at a stopped process
PAUSE = 0.05  # s after the first failed attempt, then twice as long each time
LONGEST_PLACE = 50  # bytes of a folder's name; the name of a socket has at most 107
SAFE_PATH = {
    "PYTHONSAFEPATH": "1",
    "PYTHONWARNINGS": os.environ.get("PYTHONWARNINGS", "ignore"),
}
"""Of the new Python: it does not import from the working folder, and keeps warnings to itself."""
_STARTING = threading.Lock()  # all threads share the environment


class WorkerDiedError(BrokenExecutor):
    """The process ended before the call was complete."""


class NotStartedError(WorkerDiedError):
    """No process starts: the next call would fail, too."""


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
        self._variables = {**SAFE_PATH, **(variables or {})}
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
            The process ended, or was stopped for half a minute.
        NotStartedError
            No process starts.
        """
        pipe = self.start()
        if self._ended:  # by another thread while the process started
            self.stop()
            raise WorkerDiedError("the process was ended")
        try:
            pipe.send((function, args, kw))
            in_time = self._wait(pipe, math.inf if timeout is None else max(timeout, 0.0))
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

    def _wait(self, pipe: Connection, timeout: float) -> bool:
        """Wait for an answer; a process that somebody has stopped (SIGSTOP) counts as ended."""
        end, stopped = time.monotonic() + timeout, 0
        while (left := end - time.monotonic()) > 0.0:
            if pipe.poll(min(left, WATCH)):
                return True
            if self._ended:
                raise EOFError("the process was ended, and did not end")
            stopped = stopped + 1 if self.pid is not None and is_stopped(self.pid) else 0
            if stopped > STOPPED:
                raise EOFError(f"the process was stopped for {STOPPED * WATCH:g} s")
        return pipe.poll(0.0)

    def start(self) -> Connection:
        """Start the process, unless it is running; raise NotStartedError if it does not start."""
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
        raise NotStartedError(f"a second Python process did not start: {failure}") from failure

    def _start(self) -> Connection:
        self.stop()
        with _STARTING:
            _own_socket_folder(os.getpid())
        self._pipe, theirs = self._context.Pipe()
        with theirs, _STARTING, _environment(self._variables), _script_left_out():
            arguments = (theirs, dict(os.environ))
            process = self._context.Process(target=serve, args=arguments, daemon=True)
            # A fork server that does not answer would keep `start` waiting for ever.
            with _limited(START_UP, _kill_fork_server):
                process.start()
        self._process = process
        if not self._pipe.poll(START_UP):
            raise EOFError(f"no answer within {START_UP:g} s")
        self._pipe.recv()
        return self._pipe

    def stop(self) -> None:
        """End the process; its `finally` clauses run first and end its simulator."""
        if self._process is not None and self._process.is_alive():
            self._process.terminate()
        if self._pipe is not None:
            self._pipe.close()
        if self._process is not None:
            self._process.join(GRACE)
            self._process.kill()
            self._process.join(GRACE)
            if self._process.is_alive():  # as far as a fork server says, which does not answer
                _kill_fork_server()
                self._process.join(GRACE)
            with suppress(ValueError):  # its end is still unknown
                self._process.close()
        self._process = self._pipe = None

    def end(self) -> None:
        """End the process for good, from any thread; a running call is lost."""
        self._ended, process = True, self._process
        # Python's end waits for the process; one that is stopped (SIGSTOP) needs SIGKILL.
        util.Finalize(None, self.stop, exitpriority=1)
        with suppress(AttributeError, ValueError):  # no process, or it was just closed
            process.terminate()  # type: ignore[union-attr]


@functools.cache
def _own_socket_folder(process: int) -> None:
    """Let multiprocessing keep the fork server's socket in a folder that a later run clears."""
    place = temporary_place()
    too_long = len(os.fsencode(place)) > LONGEST_PLACE and os.access(MEMORY, os.W_OK | os.X_OK)
    folder = make_own_folder(MEMORY if too_long else place)
    before, tempfile.tempdir = tempfile.tempdir, str(folder)
    try:
        util.get_temp_dir()  # it is removed with priority -100, and our folder after it
    finally:
        tempfile.tempdir = before
    util.Finalize(None, remove_own_folder, args=(folder,), exitpriority=-101)


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


@contextmanager
def _script_left_out() -> Iterator[None]:
    """Let a new process import nothing of the user's script, whose top level may start a study.

    multiprocessing imports the file and the name of the module ``__main__``. Calls of a study need
    neither: what they pass is taction's. Everything else of the module stays in reach.
    """
    script = sys.modules["__main__"]
    stand_in = ModuleType("__main__")
    stand_in.__dict__.update({**vars(script), "__file__": None, "__spec__": None})
    sys.modules["__main__"] = stand_in
    try:
        yield
    finally:
        sys.modules["__main__"] = script


@contextmanager
def _limited(seconds: float, end: Callable[[], None]) -> Iterator[None]:
    """Call `end` in a thread if the block takes longer than `seconds`."""
    timer = threading.Timer(seconds, end)
    timer.daemon = True
    timer.start()
    try:
        yield
    finally:
        timer.cancel()


def _kill_fork_server() -> None:
    from multiprocessing import forkserver  # not on every system

    pid: int | None = getattr(forkserver._forkserver, "_forkserver_pid", None)
    if pid is not None:
        with suppress(ProcessLookupError):
            os.kill(pid, signal.SIGKILL)


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
    versions: Callable[[], str] = lambda: ""  # the taction of the workers and of this process
