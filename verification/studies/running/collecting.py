"""Send the calls of a study to its workers, a few at a time, and collect the results."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator
from concurrent.futures import CancelledError, Future
from itertools import islice
from queue import Empty, SimpleQueue
from typing import Any, TypeVar

from taction.system.errors import MACHINE_FAILURES, Complaint, InputError, NoVerdictError
from taction.verification.studies.running.versions import OtherVersionsError
from taction.verification.studies.running.worker import NotStartedError
from taction.verification.studies.running.workers import Workers

K = TypeVar("K")
R = TypeVar("R")
T = TypeVar("T")

WATCH = 1.0  # s between two looks at the workers, while none of them answers
AHEAD = 16  # calls prepared in one go; they share the caches of the preparation


def collected(
    workers: Workers,
    function: Callable[..., R],
    calls: Iterable[tuple[K, tuple[Any, ...]]],
    stopped: Callable[[], bool] = lambda: False,
) -> Iterator[tuple[K, R | BaseException]]:
    """Yield the name and the result of each call as it ends, until `stopped` returns true.

    The result is an exception where the call killed its workers. Memory does not grow with the
    number of calls: `calls` is read only as workers become free.

    Parameters
    ----------
    calls : iterable of (name, arguments)
        Arguments of `function`, which may raise only `OtherVersionsError` and
        `MACHINE_FAILURES`.

    Raises
    ------
    InputError
        A worker has other versions of taction or ngspice.
    SimulatorNotFound, SimulatorTooOld, OutOfDisk
        A worker's machine can run nothing.
    NoVerdictError
        The workers do not answer any more, none has come for a minute, or they cannot run
        `function`.
    """
    remaining = iter(calls)
    running: dict[Future[R], K] = {}
    ended: SimpleQueue[Future[R]] = SimpleQueue()
    try:
        while not stopped():
            window = max(_ask(workers, workers.window), 1)
            if len(running) < window:
                for name, arguments in islice(remaining, window + AHEAD - len(running)):
                    future = _ask(workers, workers.executor.submit, function, *arguments)
                    running[future] = name
                    future.add_done_callback(ended.put)
            if not running:
                return
            future = _next(ended, workers)
            name = running.pop(future)
            yield name, _error(future, workers) or future.result()
    finally:
        for future in running:
            future.cancel()


def _next(ended: SimpleQueue[Future[R]], workers: Workers) -> Future[R]:
    """Wait for the end of a call, as long as there are workers."""
    while True:
        try:
            return ended.get(timeout=WATCH)
        except Empty:
            _ask(workers, workers.check)


def _ask(workers: Workers, method: Callable[..., T], *arguments: Any) -> T:
    """Call a method of the executor or of a future; raise NoVerdictError without workers."""
    closed: tuple[type[BaseException], ...] = (CancelledError, *workers.closed)
    try:
        return method(*arguments)
    except closed as error:
        reason = str(error) or "the connection is lost"
        text = f"the workers are gone ({reason}). The stored results are intact"
        raise NoVerdictError(f"{text}, the same command continues") from error


def _error(future: Future[R], workers: Workers) -> BaseException | None:
    """Return the error of a call that killed its workers; raise any other error."""
    error = _ask(workers, future.exception)
    if isinstance(error, NotStartedError):
        text = f"{error}. The stored results are intact, the same command continues"
        raise NoVerdictError(text) from error
    if isinstance(error, MACHINE_FAILURES):
        raise type(error)(f"{error}. The stored results are intact, the same command continues")
    if error is None or isinstance(error, workers.lost):
        return error
    if isinstance(error, OtherVersionsError):
        text = f"{error}; a study needs equal versions everywhere. The stored results are intact"
        raise InputError("worker", Complaint("versions", "", text))
    text = f"no worker can compute ({type(error).__name__}: {error}); is the same taction installed"
    raise NoVerdictError(f"{text} there, and where the scheduler runs?") from error
