"""Where the points of a study run: `concurrent.futures.Executor` is the one interface.

`local` is a pool of processes on this machine, `cluster` a Dask cluster; both survive workers
that are killed, at the price of the one point that each was working on.
"""

from __future__ import annotations

import importlib
import logging
import multiprocessing
import os
import sys
import time
from collections.abc import Callable, Iterator
from concurrent.futures import BrokenExecutor, Executor, Future, ThreadPoolExecutor
from contextlib import AbstractContextManager, contextmanager
from dataclasses import dataclass
from queue import SimpleQueue
from typing import Any, TypeVar

from spice_models.errors import Complaint, InputError
from verification.studies.running.threads import THREADS
from verification.studies.running.worker import Worker, WorkerDiedError

T = TypeVar("T")

ATTEMPTS = 3  # deaths of a worker until its point is given up
PATIENCE = 15.0  # s until an address without a scheduler is given up
NEWS = 1.0  # s between two looks at how many workers a cluster has
_ROOT = __name__.removesuffix(".studies.running.executors")
PRELOAD = [f"{_ROOT}.studies.sweep.point", f"{_ROOT}.engines.statespace.transients.exact"]


@dataclass(frozen=True, slots=True)
class Workers:
    """An executor, and what a study must know of it.

    Attributes
    ----------
    executor : Executor
        Runs the points.
    window : callable
        How many points to have under way at a time, so that no worker waits.
    lost : tuple of exception types
        What a point raises that its workers did not survive.
    closed : tuple of exception types
        What the executor and `window` raise when there is nothing left to run points.
    """

    executor: Executor
    window: Callable[[], int]
    lost: tuple[type[BaseException], ...]
    closed: tuple[type[BaseException], ...] = (RuntimeError,)


def cores() -> int:
    """Return the number of cores that this process may use."""
    return len(os.sched_getaffinity(0)) if sys.platform == "linux" else os.cpu_count() or 1


def workers_at(address: str | None, jobs: int | None = None) -> AbstractContextManager[Workers]:
    """Return the cluster at `address`, or where there is none, `jobs` processes here."""
    return local(jobs) if address is None else cluster(address)


@contextmanager
def local(jobs: int | None = None) -> Iterator[Workers]:
    """Run points in `jobs` processes on this machine, one a core if not given."""
    pool = LocalPool(jobs or cores())
    try:
        yield Workers(pool, lambda: pool.jobs + 2, (BrokenExecutor,))
    finally:
        pool.shutdown(wait=False, cancel_futures=True)


@contextmanager
def cluster(address: str) -> Iterator[Workers]:
    """Run points on the Dask cluster whose scheduler is at `address`, ``tcp://host:port``.

    Raises
    ------
    InputError
        dask.distributed is not installed, or no scheduler answers there.
    """
    try:
        distributed: Any = importlib.import_module("distributed")
    except ImportError:
        text = "needs dask.distributed: pip install 'taction[cluster]'"
        raise InputError("--cluster", Complaint("ADDRESS", repr(address), text)) from None
    logging.getLogger("distributed").setLevel(logging.CRITICAL)  # we say it in our own words
    try:
        client = distributed.Client(address, timeout=PATIENCE, set_as_default=False)
    except (OSError, ValueError) as error:  # TimeoutError is an OSError
        text = f"no Dask scheduler answers ({error}); start one with `dask scheduler`"
        raise InputError("--cluster", Complaint("ADDRESS", repr(address), text)) from None
    with client:
        closed = (RuntimeError, OSError, distributed.client.ClosedClientError)
        lost = (distributed.KilledWorker,)
        yield Workers(client.get_executor(), _Census(client), lost, closed)


class _Census:
    """Twice the threads of a cluster, counted anew now and then: workers join and leave."""

    def __init__(self, client: Any) -> None:
        self._client, self._counted, self._found = client, -NEWS, 0

    def __call__(self) -> int:
        if time.monotonic() - self._counted > NEWS:
            workers = self._client.scheduler_info(n_workers=-1)["workers"].values()
            self._found = sum(worker["nthreads"] for worker in workers)
            self._counted = time.monotonic()
        return 2 * self._found + 2


class LocalPool(ThreadPoolExecutor):
    """One thread for each process: a process that is killed takes its own call with it only.

    (In one executor of several processes the death of one ends all.) A call whose process died
    goes to a new one, up to `ATTEMPTS` times; then its future raises `BrokenExecutor`.
    """

    def __init__(self, jobs: int) -> None:
        super().__init__(jobs)
        self.jobs = jobs
        self._closed = False
        self._idle: SimpleQueue[Worker] = SimpleQueue()
        self._all: list[Worker] = []

    def start(self) -> None:
        """Start the processes, unless they run; the first call does so, too."""
        if self._all or self._closed:
            return
        one_thread_each = dict.fromkeys(THREADS, "1")
        self._all = [Worker(_context(), one_thread_each) for _ in range(self.jobs)]
        for worker in self._all:
            self._idle.put(worker)
        for worker in self._all:
            worker.start()

    def submit(self, fn: Callable[..., T], /, *args: Any, **kwargs: Any) -> Future[T]:
        """Run ``fn(*args, **kwargs)`` in the next process that is free."""
        self.start()
        return super().submit(self._run, fn, *args, **kwargs)

    def shutdown(self, wait: bool = True, *, cancel_futures: bool = False) -> None:
        """End the pool; without `wait` what runs is ended too, with its simulator."""
        self._closed = True
        super().shutdown(wait=wait, cancel_futures=cancel_futures or not wait)
        for worker in self._all:
            worker.end()

    def pids(self) -> list[int | None]:
        """Return the process ids of the workers."""
        self.start()
        return [worker.pid for worker in self._all]

    def _run(self, fn: Callable[..., T], *args: Any, **kwargs: Any) -> T:
        worker = self._idle.get()
        try:
            for _ in range(ATTEMPTS - 1):
                try:
                    return worker.call(None, fn, *args, **kwargs)
                except WorkerDiedError:
                    if self._closed:
                        raise
            return worker.call(None, fn, *args, **kwargs)
        finally:
            self._idle.put(worker)


def _context() -> Any:
    """Return the way to start processes: never a plain fork, which copies held locks."""
    if "forkserver" not in multiprocessing.get_all_start_methods():
        return multiprocessing.get_context("spawn")
    context = multiprocessing.get_context("forkserver")
    context.set_forkserver_preload(PRELOAD)
    return context
