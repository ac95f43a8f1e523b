"""The loop of every study: points go to workers, a few at a time, and their rows come back."""

from __future__ import annotations

import traceback
from collections.abc import Callable, Iterable, Iterator, Sequence
from concurrent.futures import CancelledError, Future
from contextlib import AbstractContextManager
from functools import partial
from importlib import metadata
from itertools import islice
from pathlib import Path
from queue import Empty, SimpleQueue
from typing import Any, TypeVar

from taction.system.errors import MACHINE_FAILURES, Killed, NoVerdictError, TactionError
from taction.system.processes import remove_own_folder
from taction.verification.studies.running.cluster import cluster
from taction.verification.studies.running.pool import Workers, cores, local

K = TypeVar("K")
P = TypeVar("P")
R = TypeVar("R")
T = TypeVar("T")

WATCH = 1.0  # s between two looks at the workers, while none of them answers
AT_ONCE = 16  # largest number of points in a call: a longer one saves no more
SHARES = 4  # least number of calls for each process
INTACT = "The stored results are intact, the same command continues"


def workers_at(
    address: str | None,
    jobs: int | None = None,
    announce: Callable[[str], None] = lambda text: None,
) -> AbstractContextManager[Workers]:
    """Return the cluster at `address`, or `jobs` processes here if `address` is None.

    `announce` receives a line of text when a wait for workers of the cluster begins.
    """
    return local(jobs) if address is None else cluster(address, announce)


def study(
    workers: Workers,
    compute: Callable[..., Sequence[R | None]],
    points: Iterable[tuple[K, P]],
    count: int = 1,
    stopped: Callable[[], bool] = lambda: False,
) -> Iterator[tuple[K, R | BaseException]]:
    """Yield the key and the row of each point as it ends, until `stopped` returns true.

    Points are read only as workers become free. `compute` gets several of about `count` points and
    returns the row of each, or None of a point that needs a call of its own; it raises only what is
    wrong with the worker. A call that killed its workers gives an exception in the place of each
    row.

    NoVerdictError: no worker answers or can compute; the message says that what is stored is
    intact.

    Examples
    --------
    >>> def halves(*points):
    ...     return [x / 2 if x > 1 or len(points) == 1 else None for x in points]
    >>> from taction.verification.studies.running.pool import HERE
    >>> sorted(study(HERE, halves, [("a", 1), ("b", 2), ("c", 4)], 8))
    [('a', 0.5), ('b', 1.0), ('c', 2.0)]
    """
    size = min(max(count // (SHARES * workers.processes), 1), AT_ONCE)
    waiting, alone = iter(points), list[tuple[K, P]]()
    running: dict[Future[Sequence[R | None]], tuple[tuple[K, P], ...]] = {}
    ended: SimpleQueue[Future[Any]] = SimpleQueue()
    try:
        while not stopped():
            while len(running) < workers.processes + workers.spare or not running:
                batch = tuple(islice(waiting, size)) or tuple(alone.pop(0) for _ in alone[:1])
                if not batch:
                    break
                given = (point for _, point in batch)
                future = _ask(workers.executor.submit, compute, *given)
                running[future] = batch
                future.add_done_callback(ended.put)
            if not running:
                return
            while True:  # as long as there are workers
                try:
                    future = ended.get(timeout=WATCH)
                    break
                except Empty:
                    _ask(workers.check)
            batch = running.pop(future)
            for point, row in zip(batch, _rows(future, workers, len(batch)), strict=True):
                if len(batch) > 1 and (row is None or isinstance(row, BaseException)):
                    alone.append(point)
                elif row is not None:
                    yield point[0], row
    finally:
        for future in running:
            future.cancel()


def one_by_one(function: Callable[..., R], *points: tuple[Any, ...]) -> list[R]:
    """Return ``function(*point)`` of each point: what `study` calls where no two share work."""
    return [function(*point) for point in points]


def _ask(method: Callable[..., T], *arguments: Any) -> T:
    """Call a method of the executor or of a future; raise NoVerdictError without workers."""
    try:
        return method(*arguments)
    except NoVerdictError as error:
        raise type(error)(f"{error}. {INTACT}") from error
    except (CancelledError, RuntimeError, OSError) as error:
        reason = str(error) or "the connection is lost"
        raise NoVerdictError(f"the workers are gone ({reason}). {INTACT}") from error


def _rows(
    future: Future[Sequence[R | None]], workers: Workers, count: int
) -> Sequence[R | BaseException | None]:
    """Return the rows of a call, its error for each if it killed its workers; raise any other."""
    error = _ask(future.exception)
    if error is None:
        return future.result()
    if isinstance(error, NoVerdictError):
        raise type(error)(f"{error}. {INTACT}") from error
    if isinstance(error, workers.lost):
        return [error] * count
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

    `function` can be pickled and raises no exception of one file. One file, or one of `jobs`, is
    computed in this process. The result is an exception where a call killed its process again and
    again, and None where Ctrl-C came before it.
    """
    results: list[R | BaseException | None] = [None] * len(files)
    processes = min(jobs or cores(), len(files))
    try:
        if processes <= 1:
            for number, path in enumerate(files):
                progress(f"{number + 1} of {len(files)}: {path.stem}")
                results[number] = function(path, *arguments[number])
            return results
        points = ((k, (path, *arguments[k])) for k, path in enumerate(files))
        with local(processes) as workers:
            progress(f"{len(files)} runs in {processes} processes")
            rows = study(workers, partial(one_by_one, function), points)
            for done, (number, result) in enumerate(rows, 1):
                results[number] = result
                progress(f"{done} of {len(files)} done: {files[number].stem}")
    except KeyboardInterrupt:
        pass
    return results


RUNS = 3  # as often as a point is computed whose simulator is killed


def attempted(function: Callable[[], T], without: Callable[[BaseException, str], T]) -> T:
    """Return ``function()``, or what `without` makes of an error and its words: a failure is a row.

    A defect of taction must not end a study of ten thousand points. A run whose ngspice was killed
    by a signal is repeated. Where this machine can compute nothing, its error is raised.
    """
    for run in range(RUNS):
        try:
            return function()
        except MACHINE_FAILURES:
            raise
        except TactionError as error:
            if not isinstance(error, Killed) or run == RUNS - 1:
                return without(error, str(error))
            if error.folder is not None:  # nobody will be told of this reproducer
                remove_own_folder(error.folder)
        except Exception as error:
            where = traceback.format_tb(error.__traceback__)[-1].strip()
            return without(error, f"unforeseen: {type(error).__name__}: {error}\n{where}")
    raise AssertionError("the last run returns")
