"""A Python process that runs one call after the other and can be stopped; the workers of a study.

Each worker has its own pipe, so that a process which is killed while it answers spoils no answer of
another one. (The pools of `concurrent.futures` and of pebble share a pipe among all processes.)
"""

from __future__ import annotations

import math
import multiprocessing
import os
import sys
import threading
from collections.abc import Callable, Iterator, Mapping
from concurrent.futures import BrokenExecutor, Executor
from contextlib import contextmanager, suppress
from dataclasses import dataclass
from multiprocessing.connection import Connection
from types import ModuleType
from typing import Any, TypeVar

from taction.system.errors import NoVerdictError
from taction.verification.studies.running.worker_process import GRACE, serve

T = TypeVar("T")

START_UP = 60.0  # s to start Python and load SciPy on a busy machine
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
    variables : mapping of str to str
        Environment variables of the process beside those of this one.
    """

    def __init__(self, variables: Mapping[str, str] | None = None) -> None:
        self._variables = {**SAFE_PATH, **(variables or {})}
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
            The process ended.
        NotStartedError
            No process starts.
        """
        try:
            pipe = self.start()
            pipe.send((function, args, kw))
            in_time = pipe.poll(None if timeout in (None, math.inf) else max(timeout or 0.0, 0.0))
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
        """Start the process, unless it is running; raise NotStartedError if it does not start."""
        if self._pipe is not None and self._process is not None and self._process.is_alive():
            return self._pipe
        self.stop()
        try:
            self._pipe, theirs = multiprocessing.Pipe()
            with theirs, _STARTING, _environment(self._variables), _script_left_out():
                context = multiprocessing.get_context("spawn")
                self._process = context.Process(target=serve, args=(theirs,), daemon=True)
                self._process.start()
        except OSError as error:
            self._process = None
            text = f"a second Python process did not start: {error}"
            raise NotStartedError(text) from error
        if self._ended:  # by another thread while the process started
            self.stop()
            raise WorkerDiedError("the process was ended")
        if not self._pipe.poll(START_UP):
            self.stop()
            raise NotStartedError(f"a second Python process gave no answer within {START_UP:g} s")
        self._pipe.recv()
        return self._pipe

    def stop(self) -> None:
        """End the process; its `finally` clauses run first and end its simulator."""
        process, pipe, self._process, self._pipe = self._process, self._pipe, None, None
        if process is not None:
            process.terminate()
            process.join(GRACE)
            process.kill()
            process.join()
        if pipe is not None:
            pipe.close()

    def end(self) -> None:
        """End the process for good, from any thread and without a wait; a running call is lost."""
        self._ended, process = True, self._process
        if process is not None:
            with suppress(AttributeError, ValueError):  # it was just closed
                process.terminate()
                hard_end = threading.Timer(GRACE, process.kill)  # Python's end waits for it
                hard_end.daemon = True
                hard_end.start()


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


@dataclass(frozen=True, slots=True)
class Workers:
    """An executor with its capacity and its exceptions."""

    executor: Executor
    window: Callable[[], int]  # number of points to submit at a time, so that no worker waits
    lost: tuple[type[BaseException], ...]  # raised by a point that killed its workers
    closed: tuple[type[BaseException], ...] = (RuntimeError,)  # raised without workers
    processes: Callable[[], int] = lambda: 1  # number of points that are computed at a time
    check: Callable[[], None] = lambda: None  # raises NoVerdictError if no worker will answer
