"""The local pool and its processes: results, exceptions, killed workers, an end without remains."""

from __future__ import annotations

import math
import os
import signal
import subprocess
import sys
import time
from collections.abc import Callable, Iterator
from concurrent.futures import BrokenExecutor, wait
from contextlib import suppress
from pathlib import Path

import pytest

from taction.system.errors import NoVerdictError
from taction.verification.studies.running import study as module
from taction.verification.studies.running.study import (
    ATTEMPTS,
    LocalPool,
    Worker,
    WorkerDiedError,
    local,
    study,
)
from tests.support.paths import ROOT
from tests.support.running import is_running, python

HOSTILE = ("random", "platform", "socket", "pickle", "multiprocessing", "verification", "numpy")


@pytest.fixture
def pool() -> Iterator[LocalPool]:
    pool = LocalPool(2)
    for each in pool.workers:
        each.start()
    yield pool
    pool.shutdown(wait=False, cancel_futures=True)


def pids(pool: LocalPool) -> list[int | None]:
    return [worker._process and worker._process.pid for worker in pool.workers]


SCRIPT = """
import sys
from taction.verification.studies.running.study import LocalPool
print("top level", __name__, flush=True)
pool = LocalPool(1)
print(pool.submit(pow, 2, 3).result(60), sys.modules["__main__"].__file__ == __file__)
pool.shutdown(wait=False)
"""


def test_a_script_without_a_guard_runs_once(tmp_path: Path) -> None:
    script = tmp_path / "study.py"
    script.write_text(SCRIPT)
    ended = python(str(script))
    assert ended.stdout.splitlines() == ["top level __main__", "8 True"]


def test_one_blas_thread_a_worker(pool: LocalPool) -> None:
    assert pool.submit(os.getenv, "OMP_NUM_THREADS").result(60) == "1"
    assert pool.submit(os.getenv, "OPENBLAS_NUM_THREADS").result(60) == "1"


def test_a_killed_worker_costs_its_own_task_only(pool: LocalPool, tmp_path: Path) -> None:
    victim, other = pids(pool)
    log = tmp_path / "log"
    futures = [pool.submit(_note, str(log), k) for k in range(12)]
    os.kill(victim, signal.SIGKILL)
    assert sorted(future.result(60) for future in futures) == list(range(12))
    assert other in pids(pool)
    assert victim not in pids(pool)
    assert len(log.read_text().split()) <= 13


def _note(log: str, number: int) -> int:
    with Path(log).open("a") as file:
        file.write(f"{number}\n")
    time.sleep(0.05)
    return number


def test_a_task_that_kills_every_worker_is_given_up(pool: LocalPool) -> None:
    poison = pool.submit(os.abort)
    sound = [pool.submit(pow, 2, k) for k in range(6)]
    with pytest.raises(BrokenExecutor):
        poison.result(60)
    assert ATTEMPTS == 3
    assert [future.result(60) for future in sound] == [2**k for k in range(6)]


def test_a_study_without_processes_ends(monkeypatch: pytest.MonkeyPatch) -> None:
    """The 1st failure to start is the end: no point can be computed."""

    def refuse() -> None:
        raise OSError("no process")

    monkeypatch.setattr(module.multiprocessing, "Pipe", refuse)
    with local(2) as workers, pytest.raises(NoVerdictError, match="did not start: no process"):
        list(study(workers, max, [(k, (k,)) for k in range(4)], max))


def test_no_module_of_the_working_folder_is_imported(tmp_path: Path) -> None:
    for name in HOSTILE:
        (tmp_path / f"{name}.py").write_text(f"open({str(tmp_path / 'ran')!r}, 'w').close()\n")
    code = """
import sys
sys.path[:] = [each for each in sys.path if each]
from taction.verification.studies.running.cluster import cluster
from taction.verification.studies.running.study import LocalPool
pool = LocalPool(1)
print(pool.submit(pow, 2, 5).result(60))
pool.shutdown()
"""
    done = python("-P", "-c", code, cwd=tmp_path)
    assert done.stdout == "32\n", done.stderr
    assert not (tmp_path / "ran").exists()


def test_no_result_is_lost_where_workers_are_killed_while_they_send_it(pool: LocalPool) -> None:
    futures = [pool.submit(bytes, 3_000_000) for _ in range(60)]
    for k in (10, 20, 30, 40):
        futures[k].result(60)
        os.kill(pids(pool)[k // 10 % 2], signal.SIGKILL)
    assert {len(future.result(60)) for future in futures} == {3_000_000}


def test_shutdown_ends_what_runs(pool: LocalPool) -> None:
    first = pids(pool)
    running = [pool.submit(time.sleep, 100) for _ in range(2)]
    waiting = pool.submit(pow, 2, 5)
    time.sleep(0.3)
    pool.shutdown(wait=False, cancel_futures=True)
    assert waiting.cancelled()
    wait(running, timeout=20)
    assert not any(is_running(pid, 20.0) for pid in first)
    with pytest.raises(RuntimeError):
        pool.submit(pow, 2, 5)


PARENT = """
import sys, time
from taction.verification.studies.running.study import LocalPool
if __name__ == "__main__":
    pool = LocalPool(2)
    for each in pool.workers:
        each.start()
    print(*(each._process.pid for each in pool.workers), flush=True)
    pool.submit(time.sleep, 100)
    time.sleep(100)
"""


def drop_the_end(began: Path, seconds: float = 60.0) -> str:
    """Sleep, and drop the exception of SIGTERM, as the serializers of pydantic do."""
    began.touch()
    with suppress(KeyboardInterrupt):
        time.sleep(seconds)
    return "an answer after the end"


def never_end(began: Path) -> None:
    while True:
        drop_the_end(began)


@pytest.mark.parametrize("function", [drop_the_end, never_end])
def test_a_worker_ends_whatever_drops_its_end(
    pool: LocalPool, function: Callable[[Path], object], tmp_path: Path
) -> None:
    """Such a process ignores the next SIGTERM, and Python's end waited for the process for ever."""
    first, began = pids(pool), tmp_path / "began"
    running = pool.submit(function, began)
    while not began.exists():
        assert not running.done()
        time.sleep(0.01)
    pool.shutdown(wait=False)
    with pytest.raises(BrokenExecutor):
        running.result(60)
    assert not any(is_running(pid, 60.0) for pid in first)


def test_workers_do_not_outlive_a_killed_parent() -> None:
    parent = subprocess.Popen(
        [sys.executable, "-c", PARENT], cwd=ROOT, stdout=subprocess.PIPE, text=True
    )
    pids = [int(word) for word in parent.stdout.readline().split()]
    parent.stdout.close()
    parent.kill()
    parent.wait()
    assert len(pids) == 2
    assert not any(is_running(pid, 20.0) for pid in pids)


def test_it_answers_from_one_other_process_and_says_what_went_wrong() -> None:
    with Worker() as worker:
        first = worker.call(30.0, os.getpid)
        assert first != os.getpid()
        assert worker.call(30.0, math.hypot, 3.0, 4.0) == 5.0
        with pytest.raises(ValueError, match="could not convert string to float: '12 cm'"):
            worker.call(30.0, float, "12 cm")
        with pytest.raises(TypeError, match="cannot pickle"):  # the answer cannot be sent
            worker.call(30.0, memoryview, b"x")
        with pytest.raises(FileNotFoundError):  # of the call, not of the pipe
            worker.call(30.0, os.stat, "/no/such/file")
        assert worker.call(30.0, os.getpid) == first


def test_a_late_or_dead_process_is_replaced() -> None:
    with Worker() as worker:
        first = worker.call(30.0, os.getpid)
        with pytest.raises(TimeoutError, match="not done after"):
            worker.call(0.05, time.sleep, 60.0)
        second = worker.call(30.0, os.getpid)
        assert second != first
        with pytest.raises(WorkerDiedError, match="died"):
            worker.call(30.0, os._exit, 1)
        assert worker.call(30.0, os.getpid) not in {first, second}
    with pytest.raises(ProcessLookupError):
        os.kill(first, 0)
