"""Where the points of a study run: `concurrent.futures.Executor` is the one interface.

`local` is a pool of processes on this machine, `cluster` a Dask cluster; both survive workers
that are killed, at the price of the one point that each was working on.
"""

from __future__ import annotations

import gc
import importlib
import logging
import multiprocessing
import os
import signal
import sys
import threading
import time
from collections import deque
from collections.abc import Callable, Iterator
from concurrent.futures import BrokenExecutor, Executor, Future, ProcessPoolExecutor
from contextlib import AbstractContextManager, contextmanager, suppress
from dataclasses import dataclass, field
from multiprocessing import connection, forkserver, util
from typing import Any

from spice_models.errors import Complaint, InputError
from verification.engines.ngspice.session import end_session
from verification.studies.running.threads import THREADS

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


def workers_on(jobs: int | None, address: str | None) -> AbstractContextManager[Workers]:
    """Return `cluster` where there is an `address`, else `local`."""
    return local(jobs) if address is None else cluster(address)


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


@dataclass(slots=True)
class _Task:
    call: tuple[Any, ...]
    future: Future[Any] = field(default_factory=Future)
    deaths: int = 0


class LocalPool(Executor):
    """One executor of one process a seat: a process that is killed takes its own task with it only.

    (In one executor of several processes the death of one ends all.) A task whose process died
    goes to a new one, up to `ATTEMPTS` times; then its future raises `BrokenExecutor`.
    """

    def __init__(self, jobs: int) -> None:
        self.jobs = jobs
        self._lock = threading.RLock()
        self._waiting: deque[_Task] = deque()
        self._closed = False
        with _one_thread_each():
            self._seats = [_Seat() for _ in range(jobs)]
        self._idle = list(self._seats)

    def submit(self, fn: Callable[..., Any], /, *args: Any, **kwargs: Any) -> Future[Any]:
        """Run ``fn(*args, **kwargs)`` in the next process that is free."""
        task = _Task((fn, args, kwargs))
        with self._lock:
            if self._closed:
                raise RuntimeError("cannot schedule new futures after shutdown")
            self._waiting.append(task)
            self._dispatch()
        return task.future

    def shutdown(self, wait: bool = True, *, cancel_futures: bool = False) -> None:
        """End the pool; without `wait` what runs is ended too, with its simulator."""
        with self._lock:
            self._closed = self._closed or cancel_futures or not wait
            tasks = list(self._waiting) if self._closed else []
            if self._closed:
                self._waiting.clear()
        for task in tasks:
            task.future.cancel()
        for seat in self._seats:
            seat.close(wait)

    def pids(self) -> list[int]:
        """Return the process ids of the workers."""
        return [seat.pid for seat in self._seats]

    def _dispatch(self) -> None:
        while self._idle and self._waiting and not self._closed:
            task = self._waiting.popleft()
            if task.deaths or task.future.set_running_or_notify_cancel():
                self._start(self._idle.pop(), task)

    def _start(self, seat: _Seat, task: _Task) -> None:
        try:
            inner = seat.pool.submit(_guarded, *task.call)
        except BrokenExecutor:  # its process was killed while it had nothing to do
            seat.renew()
            inner = seat.pool.submit(_guarded, *task.call)
        inner.add_done_callback(lambda done: self._finish(seat, task, done))

    def _finish(self, seat: _Seat, task: _Task, done: Future[Any]) -> None:
        error = BrokenExecutor("cancelled") if done.cancelled() else done.exception()
        died = isinstance(error, BrokenExecutor)
        with self._lock:
            if died and not self._closed:
                seat.renew()
                task.deaths += 1
            again = died and task.deaths < ATTEMPTS and not self._closed
            if again:
                self._waiting.append(task)
            self._idle.append(seat)
            self._dispatch()
        if again:
            return
        if error is None:
            task.future.set_result(done.result())
        else:
            task.future.set_exception(error)


class _Seat:
    """One executor of one process, replaced when the process has died."""

    def __init__(self) -> None:
        self.renew()

    def renew(self) -> None:
        """Start a process; the old one, if any, is dead."""
        self.pool = ProcessPoolExecutor(1, mp_context=_context(), initializer=_settle_in)
        self._pid = self.pool.submit(os.getpid)

    @property
    def pid(self) -> int:
        return self._pid.result()

    def close(self, wait: bool) -> None:
        if not wait and self._pid.done() and not self._pid.exception():
            with suppress(ProcessLookupError):
                os.kill(self.pid, signal.SIGTERM)
        self.pool.shutdown(wait=wait, cancel_futures=True)


def _context() -> Any:
    """Return the way to start processes: never a plain fork, which copies held locks."""
    if "forkserver" not in multiprocessing.get_all_start_methods():
        return multiprocessing.get_context("spawn")
    context = multiprocessing.get_context("forkserver")
    context.set_forkserver_preload(PRELOAD)
    return context


@contextmanager
def _one_thread_each() -> Iterator[None]:
    """Start the fork server, whose environment every worker inherits, with one BLAS thread."""
    before = {name: os.environ.get(name) for name in THREADS}
    os.environ.update(dict.fromkeys(THREADS, "1"))
    try:
        if _context().get_start_method() == "forkserver":
            forkserver.ensure_running()
        yield
    finally:
        for name, value in before.items():
            if value is None:
                del os.environ[name]
            else:
                os.environ[name] = value


def _settle_in() -> None:
    """Prepare a worker: Ctrl-C is the parent's business, and its death is the worker's end."""
    gc.freeze()  # what was imported stays: no collection needs to look at it again
    os.environ.update(dict.fromkeys(THREADS, "1"))
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    signal.signal(signal.SIGTERM, _end)
    util.Finalize(None, end_session, exitpriority=0)  # workers end without atexit
    parent = multiprocessing.parent_process()
    if parent is not None:
        threading.Thread(target=_outlive, args=(parent.sentinel,), daemon=True).start()


def _outlive(sentinel: int) -> None:
    """End this process when its parent is gone: its queue never tells, both hold its two ends."""
    connection.wait([sentinel])
    os.kill(os.getpid(), signal.SIGTERM)


_BUSY = threading.Event()  # whether this worker is at a task


def _end(number: int, frame: object) -> None:
    """End this worker; a task is unwound first, which ends its simulator.

    Without a task it ends at once: the executor's own code swallows exceptions.
    """
    if not _BUSY.is_set():
        end_session()
        os._exit(128 + number)
    sys.exit(128 + number)


def _guarded(fn: Callable[..., Any], args: tuple[Any, ...], kwargs: dict[str, Any]) -> Any:
    """Call `fn`; where that is ended by `_end`, end the process."""
    try:
        _BUSY.set()
        return fn(*args, **kwargs)
    except SystemExit as end:  # the executor would send it to the parent and go on
        os._exit(end.code if isinstance(end.code, int) else 1)
    finally:
        _BUSY.clear()
