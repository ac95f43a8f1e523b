"""Send the calls of a study to its workers, a few at a time, and collect the results."""

from __future__ import annotations

import time
import traceback
from collections.abc import Callable, Iterable, Iterator, Sequence
from concurrent.futures import CancelledError, Future
from importlib import metadata
from itertools import islice
from pathlib import Path
from queue import Empty, SimpleQueue
from typing import Any, TypeVar

from taction.system.errors import MACHINE_FAILURES, Killed, NoVerdictError, TactionError
from taction.system.own_folders import remove_own_folder
from taction.verification.studies.running.executors import cores, local
from taction.verification.studies.running.versions import OtherVersionsError
from taction.verification.studies.running.worker import NotStartedError, Workers

K = TypeVar("K")
R = TypeVar("R")
T = TypeVar("T")

WATCH = 1.0  # s between two looks at the workers, while none of them answers
AHEAD = 16  # calls prepared in one go; they share the caches of the preparation
AT_ONCE = 16  # largest number of items in a call: a longer one saves no more
SHARES = 4  # least number of calls for each process


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
    SimulatorNotFound, SimulatorTooOld, OutOfDisk
        A worker's machine can run nothing.
    NoVerdictError
        The workers do not answer any more, none has come for a minute, they cannot run
        `function`, or have other versions of taction or ngspice.
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


def collected_together(
    workers: Workers,
    function: Callable[..., Sequence[R | None]],
    calls: Iterable[tuple[K, Any]],
    size: int,
    stopped: Callable[[], bool] = lambda: False,
) -> Iterator[tuple[K, R | BaseException]]:
    """Yield the results of `calls`, (name, item) each, as `collected`, several in one call.

    Parameters
    ----------
    function : callable
        Gets up to `size` items and returns the result of each, or None of an item that needs a call
        of its own. Such items, and those of a call that killed its workers, come last, one a call.

    Examples
    --------
    >>> from concurrent.futures import Executor
    >>> class Here(Executor):
    ...     def submit(self, function, *items):
    ...         future = Future()
    ...         future.set_result(function(*items))
    ...         return future
    >>> def halves(*items):
    ...     return [x / 2 if x > 1 or len(items) == 1 else None for x in items]
    >>> here = Workers(Here(), lambda: 1, ())
    >>> list(collected_together(here, halves, [("a", 1), ("b", 2), ("c", 4)], 2))
    [('b', 1.0), ('c', 2.0), ('a', 0.5)]
    """
    alone: list[tuple[K, Any]] = []
    remaining = iter(calls)
    together = iter(lambda: tuple(islice(remaining, max(size, 1))), ())
    for several in (together, ((call,) for call in alone)):
        batches = ((batch, tuple(item for _, item in batch)) for batch in several)
        for batch, results in collected(workers, function, batches, stopped):
            lost = [results] * len(batch) if isinstance(results, BaseException) else results
            for call, result in zip(batch, lost, strict=True):
                if len(batch) > 1 and (result is None or isinstance(result, BaseException)):
                    alone.append(call)
                elif result is not None:
                    yield call[0], result


def together(items: int, workers: Workers) -> int:
    """Return how many of `items` one call computes, so that all processes are busy to the end."""
    return min(max(items // (SHARES * max(workers.processes(), 1)), 1), AT_ONCE)


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
        raise NoVerdictError(text)
    text = f"no worker can compute ({type(error).__name__}: {error}); is the same taction"
    raise NoVerdictError(f"{text} ({metadata.version('taction')}) installed there?") from error


def for_each_file(
    function: Callable[..., R],
    files: Sequence[Path],
    arguments: Sequence[tuple[Any, ...]],
    *,
    jobs: int | None = None,
    progress: Callable[[str], None] = lambda stage: None,
) -> list[R | BaseException | None]:
    """Return ``function(file, *arguments[i])`` of each file, in the order of `files`.

    Parameters
    ----------
    function : callable
        With several processes it can be pickled, as its arguments and its results. It raises no
        exception of one file.
    arguments : sequence of tuple
        The further arguments for each file.
    jobs : int, optional
        Number of processes; by default one for each core. One file, or one job, is computed in
        this process.

    Returns
    -------
    list
        An exception where a call killed its process again and again; None where Ctrl-C came before
        the result.

    Raises
    ------
    NoVerdictError
        The processes do not start.

    Examples
    --------
    >>> files = [Path("b.toml"), Path("a.toml")]
    >>> for_each_file(lambda path, more: path.stem + more, files, [("1",), ("2",)], jobs=1)
    ['b1', 'a2']
    """
    results: list[R | BaseException | None] = [None] * len(files)
    processes, pace, left = min(jobs or cores(), len(files)), Pace(), ""
    try:
        if processes <= 1:
            for number, path in enumerate(files):
                progress(f"{number + 1} of {len(files)}: {path.stem}{left}")
                results[number] = function(path, *arguments[number])
                left = pace.ended(len(files) - number - 1)
            return results
        calls = ((k, (path, *arguments[k])) for k, path in enumerate(files))
        with local(processes) as workers:
            progress(f"{len(files)} runs in {processes} processes")
            for done, (number, result) in enumerate(collected(workers, function, calls), 1):
                results[number] = result
                left = pace.ended(len(files) - done)
                progress(f"{done} of {len(files)} done: {files[number].stem}{left}")
    except KeyboardInterrupt:
        pass
    return results


LEAST = 3  # tasks before anything is said
SETTLED = 1.0  # s before anything is said


class Pace:
    """The pace of a study since its first task ended: workers take some seconds to start."""

    def __init__(self, clock: Callable[[], float] = time.perf_counter) -> None:
        self._clock, self._first, self._done = clock, 0.0, 0

    def ended(self, left: int) -> str:
        """Count one task that ended; return the time that the `left` others need.

        Empty for the first tasks, in the first second, and where none is left.

        Examples
        --------
        >>> seconds = iter([0.0, 10.0, 20.0])
        >>> pace = Pace(lambda: next(seconds))
        >>> [pace.ended(left) for left in (602, 601, 600)]
        ['', '', ', about 1:40:00 left']
        """
        self._done += 1
        now = self._clock()
        if self._done == 1:
            self._first = now
        elapsed = now - self._first
        if self._done < LEAST or elapsed < SETTLED or not left:
            return ""
        seconds = round(elapsed / (self._done - 1) * left)
        return f", about {seconds // 3600}:{seconds // 60 % 60:02}:{seconds % 60:02} left"


RUNS = 3  # as often as a point is computed whose worker is killed


def repeated_if_killed(function: Callable[[], T]) -> T:
    """Return ``function()``; where a signal ended ngspice, the result of another call.

    Raises
    ------
    Killed
        A signal ended ngspice in each of `RUNS` calls, as where the memory is too small.
    """
    for _ in range(RUNS - 1):
        try:
            return function()
        except Killed as error:
            if error.folder is not None:  # nobody will be told of this reproducer
                remove_own_folder(error.folder)
    return function()


def attempted(function: Callable[[], T], without: Callable[[BaseException, str], T]) -> T:
    """Return ``function()``, or what `without` makes of an error and its words: a failure is a row.

    This is what a worker does with each point and each sample, also with a defect of taction: it
    must not end a study of ten thousand.

    Raises
    ------
    SimulatorNotFound, SimulatorTooOld, OutOfDisk
        This machine can compute nothing; the point itself may be right.

    Examples
    --------
    >>> print(attempted(lambda: [][0], lambda error, text: text).splitlines()[0])
    unforeseen: IndexError: list index out of range
    """
    try:
        return repeated_if_killed(function)
    except MACHINE_FAILURES:
        raise
    except TactionError as error:
        return without(error, str(error))
    except Exception as error:
        where = traceback.format_tb(error.__traceback__)[-1].strip()
        return without(error, f"unforeseen: {type(error).__name__}: {error}\n{where}")
