"""Workers of a Dask cluster: its address, its scheduler, and the wait for its workers.

The scheduler is asked who it is before a client is made, because a client of Dask waits for ever
where something else listens at the port.
"""

from __future__ import annotations

import importlib
import logging
import pickle
import re
import time
import warnings
from collections.abc import Callable, Iterator
from concurrent.futures import Executor, Future
from contextlib import contextmanager, suppress
from functools import partial
from typing import Any, TypeVar

from taction.system.errors import Complaint, InputError, NoVerdictError
from taction.verification.studies.running.worker import Workers

T = TypeVar("T")

PATIENCE = 15.0  # s to wait for an answer of a scheduler
WORKER_PATIENCE = 60.0  # s to wait for a worker, at the start and after the loss of the last one
INTERVAL = 1.0  # s between two counts of the workers
CLOSING = 5.0  # s to take leave of a scheduler
ADDRESS = re.compile(r"(?:(?:tcp|tls)://)?(?:[\w.-]+|\[[0-9A-Fa-f:.%\w]+\]):([0-9]{1,5})", re.ASCII)
EXPECTED = "expected tcp://HOST:PORT or tls://HOST:PORT, with a port from 1 to 65535"
LOGGERS = ("distributed", "tornado", "asyncio")  # our errors say the same
SILENT = logging.CRITICAL + 1


@contextmanager
def cluster(address: str, announce: Callable[[str], None] = lambda text: None) -> Iterator[Workers]:
    """Run points on the Dask cluster whose scheduler is at `address`.

    Parameters
    ----------
    address : str
        ``tcp://HOST:PORT`` or ``tls://HOST:PORT``.
    announce : callable, optional
        Receives a line of text when a wait for workers begins.

    Raises
    ------
    InputError
        The address cannot be one, dask.distributed is not installed, or no scheduler answers at
        `address` within `PATIENCE`.
    """
    check_address(address)
    try:
        distributed: Any = importlib.import_module("distributed")
    except ImportError:
        raise _refusal(address, "needs dask.distributed: pip install 'taction[cluster]'") from None
    with _silent():
        client = _client(distributed, address)
        try:
            threads = _ClusterThreads(client, announce)
            yield Workers(
                _Cluster(client.get_executor()),
                lambda: 2 * threads() + 2,
                lost=(distributed.KilledWorker,),
                closed=(RuntimeError, OSError, distributed.client.ClosedClientError),
                processes=threads,
                check=threads.check,
            )
        finally:
            with suppress(OSError, RuntimeError):  # a scheduler that is gone
                client.close(timeout=CLOSING)


def check_address(address: str) -> None:
    """Refuse what cannot be an address, with `InputError`."""
    found = ADDRESS.fullmatch(address)
    if found is None or not 1 <= int(found[1]) <= 65535:
        raise _refusal(address, EXPECTED)


def _refusal(address: str, text: str) -> InputError:
    return InputError("--cluster", Complaint("ADDRESS", repr(address), text))


def _client(distributed: Any, address: str) -> Any:
    """Return a client of the scheduler at `address`, or raise InputError with the reason."""
    import asyncio  # 30 ms that a study without a cluster does not need

    try:
        kind = asyncio.run(asyncio.wait_for(_kind(distributed, address), PATIENCE))
        if kind != "Scheduler":
            raise _refusal(address, f"a Dask {kind.lower()} answers there; expected the scheduler")
        with warnings.catch_warnings():  # other versions: the workers compare what counts
            warnings.simplefilter("ignore", distributed.versions.VersionMismatchWarning)
            return distributed.Client(address, timeout=PATIENCE, set_as_default=False)
    except InputError:
        raise
    except Exception as error:  # whatever the other program sends: Dask has no list of its errors
        text = f"no Dask scheduler answers within {PATIENCE:g} s ({error or 'no answer'});"
        raise _refusal(address, f"{text} start one with `dask scheduler`") from None


async def _kind(distributed: Any, address: str) -> str:
    """Ask the program at `address` what it is: ``"Scheduler"``, ``"Worker"``."""
    security = distributed.Security().get_connection_args("client")
    async with distributed.rpc(address, timeout=PATIENCE, connection_args=security) as other:
        return str((await other.identity())["type"])


class _Call:
    """A call that unpickling makes, so that Dask itself knows only `pickle.loads` and bytes.

    A worker of Dask ends where it cannot unpickle a task, as where it has another taction. Here
    the task is known everywhere, and what it lacks is the error of the task.
    """

    def __init__(self, function: Callable[..., Any], arguments: tuple[Any, ...]) -> None:
        self._parts = (function, arguments)

    def __reduce__(self) -> tuple[Callable[..., Any], tuple[Any, ...]]:
        return self._parts


class _Cluster(Executor):
    """Dask's executor; see `_Call`."""

    def __init__(self, executor: Any) -> None:
        self._executor = executor

    def submit(self, fn: Callable[..., T], /, *args: Any, **kwargs: Any) -> Future[T]:
        call = pickle.dumps(_Call(partial(fn, **kwargs) if kwargs else fn, args))
        future: Future[T] = self._executor.submit(pickle.loads, call)
        return future


class _ClusterThreads:
    """The threads of a cluster, counted every `INTERVAL`, since workers join and leave."""

    def __init__(self, client: Any, announce: Callable[[str], None]) -> None:
        self._client, self._announce = client, announce
        self._counted, self._threads = -INTERVAL, 0
        self._alone: float | None = None  # when the last worker left

    def __call__(self) -> int:
        """Return the number of threads of all workers; OSError if the scheduler is silent."""
        if time.monotonic() - self._counted > INTERVAL:
            scheduler = self._client.scheduler
            if scheduler is None:
                raise OSError("the connection to the scheduler is closed")
            found = self._client.sync(scheduler.identity, n_workers=-1, callback_timeout=PATIENCE)
            self._threads = sum(worker["nthreads"] for worker in found["workers"].values())
            self._counted = time.monotonic()
        return self._threads

    def check(self) -> None:
        """Say that the cluster has no worker, and raise NoVerdictError after `WORKER_PATIENCE`."""
        if self():
            self._alone = None
            return
        if self._alone is None:
            self._alone = time.monotonic()
            self._announce(f"the cluster has no worker: waiting for one, {WORKER_PATIENCE:g} s")
        if time.monotonic() - self._alone > WORKER_PATIENCE:
            text = f"the cluster had no worker for {WORKER_PATIENCE:g} s; start one with `dask"
            raise NoVerdictError(
                f"{text} worker`. The stored results are intact, the same command continues"
            )


@contextmanager
def _silent() -> Iterator[None]:
    """Silence the log of Dask, whose loggers set their own levels."""
    known = logging.root.manager.loggerDict
    names = [name for name in (*known, *LOGGERS) if name.partition(".")[0] in LOGGERS]
    levels = {name: logging.getLogger(name).level for name in names}
    for name in levels:
        logging.getLogger(name).setLevel(SILENT)
    try:
        yield
    finally:
        for name, level in levels.items():
            logging.getLogger(name).setLevel(level)
