"""Processes that compute the points of a study, and the loop that hands them points.

Each worker has its own pipe, so that a process which is killed while it answers spoils no answer of
another one: the pools of `concurrent.futures` and of pebble share a pipe among all processes. A
worker answers calls (`serve`) until the parent ends or closes the pipe.
"""

from __future__ import annotations

import math
import multiprocessing
import os
import pickle
import signal
import subprocess
import sys
import threading
import time
import traceback
from collections.abc import Callable, Iterable, Iterator, Sequence
from concurrent.futures import (
    FIRST_COMPLETED,
    BrokenExecutor,
    CancelledError,
    Executor,
    Future,
    ThreadPoolExecutor,
    wait,
)
from contextlib import AbstractContextManager, contextmanager, nullcontext, suppress
from dataclasses import dataclass
from importlib import metadata
from itertools import islice
from multiprocessing.connection import Connection
from queue import SimpleQueue
from typing import Any, TypeVar, cast

from taction.system.errors import MACHINE_FAILURES, Killed, NoVerdictError, TactionError
from taction.system.processes import THREADS, Ended, ending_signals, remove_own_folder

GRACE = 2.0  # s between the clean-up's start and a hard end
STATUS = 128 + signal.SIGTERM


def serve(handle: int) -> None:
    """Answer calls until the pipe closes; SIGTERM ends one through its `finally` clauses."""
    for name in ("SIGINT", "SIGHUP"):
        if hasattr(signal, name):
            signal.signal(getattr(signal, name), signal.SIG_IGN)
    pipe = Connection(handle)
    with suppress(EOFError, OSError, Ended), ending_signals() as received:
        threading.Thread(target=_end_with_parent, daemon=True).start()
        pipe.send("ready")
        while not received:
            request = pipe.recv_bytes()
            try:
                function, args, kw = pickle.loads(request)  # noqa: S301 - from the parent
                answer = pickle.dumps((True, function(*args, **kw)))
            except Exception as error:
                answer = pickle.dumps((False, error))
            if not received:  # a call may drop the exception, and go on
                pipe.send_bytes(answer)
    if received:
        sys.exit(STATUS)


def _end_with_parent() -> None:
    """Wait for the parent's end, also by a kill, which closes stdin; then end this process."""
    os.read(0, 1)
    os.kill(os.getpid(), signal.SIGTERM)
    time.sleep(GRACE)
    os._exit(STATUS)


K = TypeVar("K")
R = TypeVar("R")
T = TypeVar("T")

START_UP = 60.0  # s to start Python and load SciPy on a busy machine
ATTEMPTS = 3  # to compute a point whose worker is killed
ENVIRONMENT = {
    "PYTHONSAFEPATH": "1",  # Python does not import from the working folder
    "PYTHONWARNINGS": os.environ.get("PYTHONWARNINGS", "ignore"),
}
SERVE = (  # multiprocessing would run the user's script again, whose top level may be a study
    f"import sys; sys.path[:] = sys.argv[2:]; from {__name__} import serve; serve(int(sys.argv[1]))"
)


class WorkerDiedError(BrokenExecutor):
    """The process ended before the call was complete."""


class NotStartedError(WorkerDiedError, NoVerdictError):
    """No process starts: the next call would fail, too."""


# Errors of one computation or its process; the next computation may succeed.
FAILURES = (NoVerdictError, ArithmeticError, MemoryError, ValueError, WorkerDiedError)


@dataclass(frozen=True, slots=True)
class Workers:
    """An executor, and what a study must know of it."""

    executor: Executor
    processes: int  # number of calls that are computed at a time
    spare: int = 2  # number of calls that wait beside them, so that no worker does
    lost: tuple[type[BaseException], ...] = (WorkerDiedError,)  # of a call that killed its workers
    check: Callable[[], None] = lambda: None  # raises NoVerdictError if no worker will answer


class Worker(AbstractContextManager["Worker"]):
    """One process, started by the first call and again after a call that ended the process."""

    def __init__(self, threads: int | None = None) -> None:
        limits = {} if threads is None else dict.fromkeys(THREADS, str(threads))
        self._variables, self._ended = {**ENVIRONMENT, **limits}, False
        self._process: subprocess.Popen[bytes] | None = None
        self._pipe: Connection | None = None

    def __exit__(self, *error: object) -> None:
        self._stop()

    def call(self, timeout: float | None, function: Callable[..., T], *args: Any, **kw: Any) -> T:
        """Return ``function(*args, **kw)``, computed in the process, or raise its exception.

        TimeoutError: it took longer than `timeout`, s, beside the start; the process was stopped.
        WorkerDiedError: the process ended, or (NotStartedError) it does not start.
        """
        try:
            pipe = self.start()
            pipe.send((function, args, kw))
            in_time = pipe.poll(None if timeout in (None, math.inf) else max(timeout or 0.0, 0.0))
            answer: tuple[bool, Any] = pipe.recv() if in_time else (False, None)
        except (EOFError, OSError):
            self._stop()
            raise WorkerDiedError("the process died during the call") from None
        if not in_time:
            self._stop()
            raise TimeoutError(f"not done after {timeout:.3g} s")
        done, value = answer
        if not done:
            raise value
        return cast(T, value)

    def start(self) -> Connection:
        """Start the process, unless it is running; raise NotStartedError if it does not start."""
        if self._pipe is not None and self._process is not None and self._process.poll() is None:
            return self._pipe
        self._stop()
        try:
            self._pipe, theirs = multiprocessing.Pipe()
            with theirs:
                words = [sys.executable, "-c", SERVE, str(theirs.fileno()), *sys.path]
                variables = {**os.environ, **self._variables}
                self._process = subprocess.Popen(
                    words, stdin=subprocess.PIPE, env=variables, pass_fds=[theirs.fileno()]
                )
        except OSError as error:
            raise NotStartedError(f"a second Python process did not start: {error}") from error
        if self._ended:  # by another thread while the process started
            self._stop()
            raise WorkerDiedError("the process was ended")
        if not self._pipe.poll(START_UP):
            self._stop()
            raise NotStartedError(f"a second Python process gave no answer within {START_UP:g} s")
        self._pipe.recv()
        return self._pipe

    def _stop(self) -> None:
        """End the process; its `finally` clauses run first and end its simulator."""
        process, pipe, self._process, self._pipe = self._process, self._pipe, None, None
        if process is not None:
            _end(process)
        if pipe is not None:
            pipe.close()

    def end(self) -> None:
        """End the process for good, from any thread and without a wait; a running call is lost."""
        self._ended, process = True, self._process
        if process is not None:
            threading.Thread(target=_end, args=(process,), daemon=True).start()


def _end(process: subprocess.Popen[bytes]) -> None:
    process.terminate()
    try:
        process.wait(GRACE)
    except subprocess.TimeoutExpired:
        process.kill()
        process.wait()
    if process.stdin is not None:
        process.stdin.close()


class LocalPool(ThreadPoolExecutor):
    """A pool of threads with one process each; a killed process costs only its own call.

    Such a call is repeated, `ATTEMPTS` times in all; then its future raises `WorkerDiedError`.
    """

    def __init__(self, jobs: int) -> None:
        super().__init__(jobs)
        self._closed, self.workers = False, [Worker(threads=1) for _ in range(jobs)]
        self._idle: SimpleQueue[Worker] = SimpleQueue()
        for worker in self.workers:
            self._idle.put(worker)

    def submit(self, fn: Callable[..., T], /, *args: Any, **kwargs: Any) -> Future[T]:
        """Run ``fn(*args, **kwargs)`` in the next free process."""
        return super().submit(self._run, fn, *args, **kwargs)

    def shutdown(self, wait: bool = True, *, cancel_futures: bool = False) -> None:
        """End the pool; without `wait` end running calls and their simulators, too."""
        self._closed = True
        super().shutdown(wait=wait, cancel_futures=cancel_futures or not wait)
        for worker in self.workers:
            worker.end()

    def _run(self, fn: Callable[..., T], *args: Any, **kwargs: Any) -> T:
        worker = self._idle.get()
        try:
            for attempt in range(1, ATTEMPTS + 1):
                try:
                    return worker.call(None, fn, *args, **kwargs)
                except WorkerDiedError as error:
                    if self._closed or isinstance(error, NotStartedError) or attempt == ATTEMPTS:
                        raise
            raise AssertionError("the last attempt returns")
        finally:
            self._idle.put(worker)


def cores() -> int:
    """Return the number of cores that this process may use."""
    return len(os.sched_getaffinity(0)) if sys.platform == "linux" else os.cpu_count() or 1


@contextmanager
def local(jobs: int | None = None) -> Iterator[Workers]:
    """Run points in `jobs` processes on this machine, by default one process a core."""
    pool = LocalPool(jobs or cores())
    try:
        busy = min(len(pool.workers), cores())
        yield Workers(pool, busy, len(pool.workers) - busy + 2)
    finally:
        pool.shutdown(wait=False)


class _Here(Executor):
    """Computes each call when it is submitted, in this process."""

    def submit(self, fn: Callable[..., T], /, *args: Any, **kwargs: Any) -> Future[T]:
        future: Future[T] = Future()
        try:
            future.set_result(fn(*args, **kwargs))
        except Exception as error:
            future.set_exception(error)
        return future


HERE = Workers(_Here(), 1, spare=-1)
"""Runs points in this process, one at a time, where each takes less time than another process."""

WATCH = 1.0  # s between two looks at the workers, while none of them answers
INTACT = "The stored results are intact, the same command continues"


def study(
    workers: Workers,
    compute: Callable[..., R],
    points: Iterable[tuple[K, tuple[Any, ...]]],
    without: Callable[..., R],
) -> Iterator[tuple[K, R]]:
    """Yield the key and the row of each point as it ends.

    Points, keys with the arguments of `compute`, are read only as workers become free. A failure is
    a row, too: what `without` makes of an error, its words and the arguments, also where the call
    killed its workers.

    NoVerdictError: no worker answers or can compute; the message says that what is stored is
    intact.

    >>> from taction.verification.studies.running.study import HERE
    >>> sorted(study(HERE, max, [("a", (1, 2)), ("b", (4, 3))], without=print))
    [('a', 2), ('b', 4)]
    """
    waiting, running = iter(points), dict[Future[R], tuple[K, tuple[Any, ...]]]()
    try:
        while True:
            free = workers.processes + workers.spare - len(running)
            for key, arguments in islice(waiting, max(free, int(not running))):
                future = _ask(workers.executor.submit, attempted, compute, without, *arguments)
                running[future] = key, arguments
            if not running:
                return
            done = wait(running, WATCH, FIRST_COMPLETED).done
            if not done:
                _ask(workers.check)
            for future in done:
                lost, (key, arguments) = _loss(future, workers), running.pop(future)
                text = f"its process was killed several times (out of memory?): {lost}"
                yield key, without(lost, text, *arguments) if lost else future.result()
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


def _loss(future: Future[R], workers: Workers) -> BaseException | None:
    """Return the error of a call that killed its workers, None of one with a row; raise others."""
    error = _ask(future.exception)
    if isinstance(error, NoVerdictError):
        raise type(error)(f"{error}. {INTACT}") from error
    if error is None or isinstance(error, workers.lost):
        return error
    text = f"a worker failed ({type(error).__name__}: {error}). On a cluster, each one needs"
    raise NoVerdictError(f"{text} taction {metadata.version('taction')}. {INTACT}") from error


def for_each(
    function: Callable[..., R],
    calls: Sequence[tuple[Any, ...]],
    names: Sequence[str],
    without: Callable[..., R],
    *,
    jobs: int | None = None,
    progress: Callable[[str], None] = lambda stage: None,
) -> list[R]:
    """Return ``function(*call)`` of each of `calls`, in their order; `names` are shown.

    `function` and `without` can be pickled. One call, or one of `jobs`, is computed in this
    process. `without` gives the result of a call that failed, as in `study`; its error is None and
    its text empty where Ctrl-C came before the call.
    """
    results = dict[int, R]()
    processes = min(jobs or cores(), len(calls))
    with (
        suppress(KeyboardInterrupt),
        nullcontext(HERE) if processes <= 1 else local(processes) as workers,
    ):
        progress(f"{len(calls)} runs in {processes} processes")
        for number, row in study(workers, function, enumerate(calls), without):
            results[number] = row
            progress(f"{len(results)} of {len(calls)} done: {names[number]}")
    return [results[k] if k in results else without(None, "", *calls[k]) for k in range(len(calls))]


RUNS = 3  # as often as a point is computed whose simulator is killed


def attempted(function: Callable[..., T], without: Callable[..., T], *arguments: Any) -> T:
    """Return ``function(*arguments)``, or ``without(error, words, *arguments)``.

    A defect of taction must not end a study of ten thousand points. A run whose ngspice was killed
    by a signal is repeated. Where this machine can compute nothing, its error is raised.
    """
    for run in range(RUNS):
        try:
            return function(*arguments)
        except MACHINE_FAILURES:
            raise
        except TactionError as error:
            if not isinstance(error, Killed) or run == RUNS - 1:
                return without(error, str(error), *arguments)
            if error.folder is not None:  # nobody will be told of this reproducer
                remove_own_folder(error.folder)
        except Exception as error:
            where = traceback.format_tb(error.__traceback__)[-1].strip()
            words = f"unforeseen: {type(error).__name__}: {error}\n{where}"
            return without(error, words, *arguments)
    raise AssertionError("the last run returns")
