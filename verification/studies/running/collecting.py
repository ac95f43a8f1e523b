"""The calls of a study handed to its workers, a window of them at a time, and their results."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator
from concurrent.futures import CancelledError, Future
from itertools import islice
from queue import SimpleQueue
from typing import Any, TypeVar

from spice_models.errors import Complaint, InputError, NoVerdictError
from verification.studies.running.executors import Workers
from verification.studies.running.versions import OtherVersionsError

K = TypeVar("K")
R = TypeVar("R")
T = TypeVar("T")

AHEAD = 16  # calls prepared in one go: the caches that one warms serve the next


def collected(
    workers: Workers,
    function: Callable[..., R],
    calls: Iterable[tuple[K, tuple[Any, ...]]],
    stopped: Callable[[], bool] = lambda: False,
) -> Iterator[tuple[K, R | BaseException]]:
    """Yield each call's name with its result, as they end, until the study is `stopped`.

    In the place of a result stands the error of a call that its workers did not survive. Memory
    does not grow with the number of calls: `calls` are taken only as workers become free.

    Parameters
    ----------
    calls : iterable of (name, arguments)
        Of `function`, which raises nothing but `OtherVersionsError`.

    Raises
    ------
    InputError
        A worker has other versions of taction or ngspice.
    NoVerdictError
        The workers are gone, or cannot compute anything.
    """
    left = iter(calls)
    running: dict[Future[R], K] = {}
    ended: SimpleQueue[Future[R]] = SimpleQueue()
    try:
        while not stopped():
            window = max(_asked(workers, workers.window), 1)
            if len(running) < window:
                for name, arguments in islice(left, window + AHEAD - len(running)):
                    future = _asked(workers, workers.executor.submit, function, *arguments)
                    running[future] = name
                    future.add_done_callback(ended.put)
            if not running:
                return
            future = ended.get()
            name = running.pop(future)
            error = _error(future, workers)
            yield name, error or future.result()
    finally:
        for future in running:
            future.cancel()


def _asked(workers: Workers, ask: Callable[..., T], *arguments: Any) -> T:
    """Ask the executor, or a future of its; raise in our own words where all workers are gone."""
    gone: tuple[type[BaseException], ...] = (CancelledError, *workers.closed)
    try:
        return ask(*arguments)
    except gone as error:
        text = "the workers are gone; what is stored stays, the same command goes on from there"
        raise NoVerdictError(text) from error


def _error(future: Future[R], workers: Workers) -> BaseException | None:
    """Return what ended a call, if its workers did not survive it."""
    error = _asked(workers, future.exception)
    if error is None or isinstance(error, workers.lost):
        return error
    if isinstance(error, OtherVersionsError):
        text = f"{error}; a study needs the same versions everywhere. What is stored stays"
        raise InputError("--cluster", Complaint("worker", "", text))
    text = f"no worker can compute ({type(error).__name__}: {error}); is the same taction installed"
    raise NoVerdictError(f"{text} there?") from error
