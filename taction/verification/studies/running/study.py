"""The loop of every study: points go to workers, a few at a time, and their rows come back."""

from __future__ import annotations

import traceback
from collections.abc import Callable, Iterable, Iterator, Sequence
from concurrent.futures import CancelledError, Future
from contextlib import AbstractContextManager, nullcontext, suppress
from importlib import metadata
from itertools import islice
from pathlib import Path
from queue import Empty, SimpleQueue
from typing import Any, TypeVar

from taction.system.errors import MACHINE_FAILURES, Killed, NoVerdictError, TactionError
from taction.system.processes import remove_own_folder
from taction.verification.studies.running.cluster import cluster
from taction.verification.studies.running.pool import HERE, Workers, cores, local

K = TypeVar("K")
R = TypeVar("R")
T = TypeVar("T")

WATCH = 1.0  # s between two looks at the workers, while none of them answers
INTACT = "The stored results are intact, the same command continues"


def workers_at(
    address: str | None,
    jobs: int | None = None,
    announce: Callable[[str], None] = lambda text: None,
) -> AbstractContextManager[Workers]:
    """Return the cluster at `address`, or `jobs` processes here if it is None."""
    return local(jobs) if address is None else cluster(address, announce)


def study(
    workers: Workers,
    compute: Callable[..., R],
    points: Iterable[tuple[K, tuple[Any, ...]]],
    stopped: Callable[[], bool] = lambda: False,
) -> Iterator[tuple[K, R | BaseException]]:
    """Yield the key and the row of each point as it ends, until `stopped` returns true.

    Points, keys with the arguments of `compute`, are read only as workers become free. `compute`
    raises only what is wrong with the worker. A call that killed its workers gives an exception in
    the place of its row.

    NoVerdictError: no worker answers or can compute; the message says that what is stored is
    intact.

    Examples
    --------
    >>> from taction.verification.studies.running.pool import HERE
    >>> sorted(study(HERE, max, [("a", (1, 2)), ("b", (4, 3))]))
    [('a', 2), ('b', 4)]
    """
    waiting, running = iter(points), dict[Future[R], K]()
    ended: SimpleQueue[Future[R]] = SimpleQueue()
    try:
        while not stopped():
            free = workers.processes + workers.spare - len(running)
            for key, arguments in islice(waiting, max(free, int(not running))):
                future = _ask(workers.executor.submit, compute, *arguments)
                running[future] = key
                future.add_done_callback(ended.put)
            if not running:
                return
            while True:  # as long as there are workers
                try:
                    future = ended.get(timeout=WATCH)
                    break
                except Empty:
                    _ask(workers.check)
            row = _row(future, workers)
            yield running.pop(future), row
    finally:
        for future in running:
            future.cancel()


def _ask(method: Callable[..., T], *arguments: Any) -> T:
    """Call a method of the executor or of a future; raise NoVerdictError without workers."""
    try:
        return method(*arguments)
    except NoVerdictError as error:
        raise type(error)(f"{error}. {INTACT}") from error
    except (CancelledError, RuntimeError, OSError) as error:
        reason = str(error) or "the connection is lost"
        raise NoVerdictError(f"the workers are gone ({reason}). {INTACT}") from error


def _row(future: Future[R], workers: Workers) -> R | BaseException:
    """Return the row of a call, or its error if it killed its workers; raise any other."""
    error = _ask(future.exception)
    if error is None:
        return future.result()
    if isinstance(error, NoVerdictError):
        raise type(error)(f"{error}. {INTACT}") from error
    if isinstance(error, workers.lost):
        return error
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
    points = ((k, (path, *arguments[k])) for k, path in enumerate(files))
    with (
        suppress(KeyboardInterrupt),
        nullcontext(HERE) if processes <= 1 else local(processes) as workers,
    ):
        progress(f"{len(files)} runs in {processes} processes")
        for done, (number, result) in enumerate(study(workers, function, points), 1):
            results[number] = result
            progress(f"{done} of {len(files)} done: {files[number].stem}")
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
