"""Executors for the points of a study, with the interface of `concurrent.futures.Executor`.

`local` is a pool of processes on this machine, `cluster` a Dask cluster. A worker that is killed
costs only the point that it was computing.
"""

from __future__ import annotations

import os
import sys
from collections.abc import Callable, Iterator
from concurrent.futures import BrokenExecutor, Executor, Future, ThreadPoolExecutor
from contextlib import AbstractContextManager, contextmanager
from queue import SimpleQueue
from typing import Any, TypeVar

from taction.system.processes import THREADS
from taction.verification.studies.running.cluster import cluster
from taction.verification.studies.running.worker import (
    NotStartedError,
    Worker,
    WorkerDiedError,
    Workers,
)

T = TypeVar("T")

ATTEMPTS = 3  # to compute a point whose worker is killed


def cores() -> int:
    """Return the number of cores that this process may use."""
    return len(os.sched_getaffinity(0)) if sys.platform == "linux" else os.cpu_count() or 1


def workers_at(
    address: str | None,
    jobs: int | None = None,
    announce: Callable[[str], None] = lambda text: None,
) -> AbstractContextManager[Workers]:
    """Return the cluster at `address`, or `jobs` processes here if `address` is None.

    `announce` receives a line of text when a wait for workers of the cluster begins.
    """
    return local(jobs) if address is None else cluster(address, announce)


@contextmanager
def local(jobs: int | None = None) -> Iterator[Workers]:
    """Run points in `jobs` processes on this machine, by default one process a core."""
    pool = LocalPool(jobs or cores())
    try:
        busy = min(pool.jobs, cores())
        yield Workers(pool, lambda: pool.jobs + 2, (BrokenExecutor,), processes=lambda: busy)
    finally:
        pool.shutdown(wait=False, cancel_futures=True)


class LocalPool(ThreadPoolExecutor):
    """A pool of threads with one process each; a killed process costs only its own call.

    A call whose process was killed is repeated in a new process, `ATTEMPTS` times in all; then its
    future raises `BrokenExecutor`.
    """

    def __init__(self, jobs: int) -> None:
        super().__init__(jobs)
        self.jobs = jobs
        self._closed = False
        self._all = [Worker(dict.fromkeys(THREADS, "1")) for _ in range(jobs)]
        self._idle: SimpleQueue[Worker] = SimpleQueue()
        for worker in self._all:
            self._idle.put(worker)

    def submit(self, fn: Callable[..., T], /, *args: Any, **kwargs: Any) -> Future[T]:
        """Run ``fn(*args, **kwargs)`` in the next free process."""
        return super().submit(self._run, fn, *args, **kwargs)

    def shutdown(self, wait: bool = True, *, cancel_futures: bool = False) -> None:
        """End the pool; without `wait` end running calls and their simulators, too."""
        self._closed = True
        super().shutdown(wait=wait, cancel_futures=cancel_futures or not wait)
        for worker in self._all:
            worker.end()

    def pids(self) -> list[int | None]:
        """Return the process ids of the workers, None of one that has not started."""
        return [worker.pid for worker in self._all]

    def _run(self, fn: Callable[..., T], *args: Any, **kwargs: Any) -> T:
        worker = self._idle.get()
        try:
            for _ in range(ATTEMPTS - 1):
                try:
                    return worker.call(None, fn, *args, **kwargs)
                except WorkerDiedError as error:
                    if self._closed or isinstance(error, NotStartedError):
                        raise
            return worker.call(None, fn, *args, **kwargs)
        finally:
            self._idle.put(worker)


class _Here(Executor):
    """Computes each call when it is submitted, in this process."""

    def submit(self, fn: Callable[..., T], /, *args: Any, **kwargs: Any) -> Future[T]:
        """Return the future of a call that has ended."""
        future: Future[T] = Future()
        try:
            future.set_result(fn(*args, **kwargs))
        except Exception as error:
            future.set_exception(error)
        return future


@contextmanager
def in_this_process() -> Iterator[Workers]:
    """Run points in this process, where each takes less time than to start another one.

    Examples
    --------
    >>> with in_this_process() as workers:
    ...     workers.executor.submit(abs, -2.0).result()
    2.0
    """
    yield Workers(_Here(), lambda: 1, ())
