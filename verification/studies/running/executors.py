"""Executors for the points of a study, with the interface of `concurrent.futures.Executor`.

`local` is a pool of processes on this machine, `cluster` a Dask cluster. A worker that is killed
costs only the point that it was computing.
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
from verification.studies.running.worker import NotStartedError, Worker, WorkerDiedError

T = TypeVar("T")

ATTEMPTS = 3  # to compute a point whose worker is killed
PATIENCE = 15.0  # s to wait for a scheduler
START_UP = 0.7  # s of processor time to start the fork server and two processes
INTERVAL = 1.0  # s between two counts of the workers of a cluster
_ROOT = __name__.removesuffix(".studies.running.executors")
PRELOAD = [f"{_ROOT}.studies.sweep.point", f"{_ROOT}.engines.statespace.transients.exact"]


@dataclass(frozen=True, slots=True)
class Workers:
    """An executor with its capacity and its exceptions."""

    executor: Executor
    window: Callable[[], int]  # number of points to submit at a time, so that no worker waits
    lost: tuple[type[BaseException], ...]  # raised by a point that killed its workers
    closed: tuple[type[BaseException], ...] = (RuntimeError,)  # raised without workers
    processes: Callable[[], int] = lambda: 1  # number of points that are computed at a time
    start_up: float = 0.0  # s of processor time before the first point


def cores() -> int:
    """Return the number of cores that this process may use."""
    return len(os.sched_getaffinity(0)) if sys.platform == "linux" else os.cpu_count() or 1


def workers_at(address: str | None, jobs: int | None = None) -> AbstractContextManager[Workers]:
    """Return the cluster at `address`, or `jobs` processes here if `address` is None."""
    return local(jobs) if address is None else cluster(address)


@contextmanager
def local(jobs: int | None = None) -> Iterator[Workers]:
    """Run points in `jobs` processes on this machine, by default one process a core."""
    pool = LocalPool(jobs or cores())
    try:
        busy = min(pool.jobs, cores())
        yield Workers(
            pool,
            lambda: pool.jobs + 2,
            (BrokenExecutor,),
            processes=lambda: busy,
            start_up=START_UP,
        )
    finally:
        pool.shutdown(wait=False, cancel_futures=True)


@contextmanager
def cluster(address: str) -> Iterator[Workers]:
    """Run points on the Dask cluster whose scheduler is at `address`, ``tcp://host:port``.

    Raises
    ------
    InputError
        dask.distributed is not installed, or no scheduler answers at `address`.
    """
    try:
        distributed: Any = importlib.import_module("distributed")
    except ImportError:
        text = "needs dask.distributed: pip install 'taction[cluster]'"
        raise InputError("--cluster", Complaint("ADDRESS", repr(address), text)) from None
    logging.getLogger("distributed").setLevel(logging.CRITICAL)  # our errors say the same
    try:
        client = distributed.Client(address, timeout=PATIENCE, set_as_default=False)
    except (OSError, ValueError) as error:  # TimeoutError is an OSError
        text = f"no Dask scheduler answers ({error}); start one with `dask scheduler`"
        raise InputError("--cluster", Complaint("ADDRESS", repr(address), text)) from None
    with client:
        closed = (RuntimeError, OSError, distributed.client.ClosedClientError)
        lost = (distributed.KilledWorker,)
        threads = _ClusterThreads(client)
        yield Workers(
            client.get_executor(), lambda: 2 * threads() + 2, lost, closed, processes=threads
        )


class _ClusterThreads:
    """The threads of a cluster, counted every `INTERVAL`, since workers join and leave."""

    def __init__(self, client: Any) -> None:
        self._client, self._counted, self._threads = client, -INTERVAL, 0

    def __call__(self) -> int:
        if time.monotonic() - self._counted > INTERVAL:
            workers = self._client.scheduler_info(n_workers=-1)["workers"].values()
            self._threads = sum(worker["nthreads"] for worker in workers)
            self._counted = time.monotonic()
        return self._threads


class LocalPool(ThreadPoolExecutor):
    """A pool of threads with one process each; a killed process costs only its own call.

    (In a `ProcessPoolExecutor` one killed process breaks the pool.) A call whose process was killed
    is repeated in a new process, `ATTEMPTS` times in all; then its future raises `BrokenExecutor`.
    """

    def __init__(self, jobs: int) -> None:
        super().__init__(jobs)
        self.jobs = jobs
        self._closed = False
        self._idle: SimpleQueue[Worker] = SimpleQueue()
        self._all: list[Worker] = []

    def start(self) -> None:
        """Start the processes, unless they are running; the first call does the same."""
        if self._all or self._closed:
            return
        self._all = [Worker(_context(), dict.fromkeys(THREADS, "1")) for _ in range(self.jobs)]
        for worker in self._all:
            self._idle.put(worker)
        for worker in self._all:
            worker.start()

    def submit(self, fn: Callable[..., T], /, *args: Any, **kwargs: Any) -> Future[T]:
        """Run ``fn(*args, **kwargs)`` in the next free process."""
        self.start()
        return super().submit(self._run, fn, *args, **kwargs)

    def shutdown(self, wait: bool = True, *, cancel_futures: bool = False) -> None:
        """End the pool; without `wait` end running calls and their simulators, too."""
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
                except WorkerDiedError as error:
                    if self._closed or isinstance(error, NotStartedError):
                        raise
            return worker.call(None, fn, *args, **kwargs)
        finally:
            self._idle.put(worker)


def _context() -> Any:
    """Return the start method of processes: never a plain fork, which copies locked locks."""
    if "forkserver" not in multiprocessing.get_all_start_methods():
        return multiprocessing.get_context("spawn")
    context = multiprocessing.get_context("forkserver")
    context.set_forkserver_preload(PRELOAD)
    return context
