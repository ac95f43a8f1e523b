"""Workers of a Dask cluster, behind the same interface as the processes of this machine."""

from __future__ import annotations

import importlib
import logging
import pickle
import platform
import warnings
from collections.abc import Callable, Iterator
from concurrent.futures import Executor, Future
from contextlib import AbstractContextManager, contextmanager, suppress
from functools import partial
from typing import Any, TypeVar

from taction.system.errors import Complaint, InputError, NoVerdictError, SimulationError
from taction.system.output_files import check_extra
from taction.system.progress import Notice, Progress
from taction.verification.studies.running import study
from taction.verification.studies.running.study import Workers
from taction.verification.studies.running.versions import own_code, simulator_name

T = TypeVar("T")

PATIENCE = 15.0  # s to wait for an answer of a scheduler
WORKER_PATIENCE = 60.0  # s to wait for a worker, at the start and after the loss of the last one
CLOSING = 5.0  # s to take leave of a scheduler
SPARE = 100  # calls that wait for a worker: others may join


@contextmanager
def cluster(address: str, progress: Progress = lambda stage: None) -> Iterator[Workers]:
    """Run points on the Dask cluster whose scheduler is at `address`, such as ``tcp://HOST:PORT``.

    `progress` receives a `Notice` when a wait for workers begins. InputError: no such address, no
    dask.distributed, or no scheduler answers. NoVerdictError: no worker comes.
    """
    check_extra("cluster", "--cluster")
    distributed: Any = importlib.import_module("distributed")
    before, client = logging.root.manager.disable, None
    logging.disable()  # Dask logs what our errors say
    try:
        client = _client(distributed, address)
        check = partial(_wait_for_worker, client, progress)
        try:
            check()
            threads = sum(client.nthreads().values()) or 1
        except OSError as error:
            raise _refusal(address, f"the scheduler is gone ({error})") from None
        lost = (distributed.KilledWorker,)
        yield Workers(_Cluster(client.get_executor()), threads, SPARE, lost, check)
    finally:
        if client is not None:
            with suppress(OSError, RuntimeError):  # a scheduler that is gone
                client.close(timeout=CLOSING)
        logging.disable(before)


def workers_at(
    address: str | None, jobs: int | None = None, progress: Progress = lambda stage: None
) -> AbstractContextManager[Workers]:
    """Return the cluster at `address`, or `jobs` processes here if it is None."""
    return study.local(jobs) if address is None else cluster(address, progress)


def _refusal(address: str, text: str) -> InputError:
    return InputError("--cluster", Complaint("ADDRESS", repr(address), text))


def _client(distributed: Any, address: str) -> Any:
    """Return a client of the scheduler at `address`, or raise InputError with the reason.

    A client of Dask waits for ever where something else listens, so the program is asked what it
    is.
    """
    import asyncio  # 30 ms that a study without a cluster does not need

    async def kind() -> str:
        security = distributed.Security().get_connection_args("client")
        async with distributed.rpc(address, timeout=PATIENCE, connection_args=security) as other:
            return str((await other.identity())["type"])

    try:
        found = asyncio.run(asyncio.wait_for(kind(), PATIENCE))
        if found == "Scheduler":
            with warnings.catch_warnings():  # other versions: the workers compare what counts
                warnings.simplefilter("ignore", distributed.versions.VersionMismatchWarning)
                return distributed.Client(address, timeout=PATIENCE, set_as_default=False)
    except Exception as error:  # whatever the other program sends: Dask has no list of its errors
        reason = str(error) or f"nothing within {PATIENCE:g} s"
        text = f"no Dask scheduler answers there ({reason}); start one with `dask scheduler`"
        raise _refusal(address, text) from None
    raise _refusal(address, f"a Dask {found.lower()} answers there; expected the scheduler")


def _wait_for_worker(client: Any, progress: Progress) -> None:
    """Return if the cluster has a worker, or as soon as one comes; else raise NoVerdictError."""
    if client.scheduler is None:
        raise OSError("the connection to the scheduler is closed")
    if client.sync(client.scheduler.ncores, callback_timeout=PATIENCE):
        return
    progress(Notice(f"the cluster has no worker: waiting for one, {WORKER_PATIENCE:g} s"))
    try:
        client.wait_for_workers(1, timeout=WORKER_PATIENCE)
    except TimeoutError:
        text = f"the cluster had no worker for {WORKER_PATIENCE:g} s; start one with `dask worker`"
        raise NoVerdictError(text) from None


class _Call:
    """A call that unpickling makes, so that Dask itself knows only `pickle.loads` and bytes.

    A worker of Dask ends where it cannot unpickle a task; here that is the error of the task.
    """

    def __init__(self, *parts: Any) -> None:
        self._parts = parts

    def __reduce__(self) -> tuple[Callable[..., Any], tuple[Any, ...]]:
        return self._parts[0], self._parts[1:]


def _versions() -> tuple[str, str]:
    """Return the source of taction, and ngspice; the latter is empty where there is none."""
    simulator = ""
    with suppress(SimulationError):
        simulator = simulator_name()
    return f"taction {own_code().hex()[:8]}", simulator


def _computed(versions: tuple[str, str], function: Callable[..., T], *args: Any) -> T:
    """Call a function in a worker; NoVerdictError where taction or ngspice is another one."""
    here = _versions()
    if here[0] != versions[0] or (here[1] and versions[1] and here[1] != versions[1]):
        text = f"{platform.node()} has {', '.join(here)} instead of {', '.join(versions)}"
        raise NoVerdictError(f"{text}; a study needs equal versions everywhere")
    return function(*args)


class _Cluster(Executor):
    """Dask's executor; see `_Call`."""

    def __init__(self, executor: Any) -> None:
        self._executor, self._versions = executor, _versions()

    def submit(self, fn: Callable[..., T], /, *args: Any, **kwargs: Any) -> Future[T]:
        call = pickle.dumps(_Call(_computed, self._versions, fn, *args))
        try:
            future: Future[T] = self._executor.submit(pickle.loads, call)
        except Exception as error:  # that of a closed client has no base class of its own
            raise OSError(f"{type(error).__name__}: {error}") from error
        return future
