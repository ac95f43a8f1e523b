"""Studies on a real Dask cluster over TCP on loopback, and clusters that cannot be used."""

from __future__ import annotations

import json
import os
import signal
import socket
import subprocess
import sys
import time
from collections.abc import Iterator
from contextlib import ExitStack, contextmanager
from pathlib import Path
from typing import Any

import pytest

from taction.system.errors import InputError, NoVerdictError
from taction.verification.studies.running import cluster as module
from taction.verification.studies.running.cluster import cluster
from taction.verification.studies.running.store import Store
from taction.verification.studies.running.study import HERE
from taction.verification.studies.sweep import all_records, sweep_points
from tests.support import nightly
from tests.support.entries import grid_plan
from tests.support.paths import ROOT


@contextmanager
def dask(*words: str, folder: Path) -> Iterator[subprocess.Popen[bytes]]:
    fixed = {"OMP_NUM_THREADS": "1", "DASK_DISTRIBUTED__WORKER__PROFILE__ENABLED": "false"}
    environment = os.environ | fixed
    with (folder / f"{words[0]}.log").open("ab") as log:
        process = subprocess.Popen(
            [sys.executable, "-m", "dask", *words, "--host", "127.0.0.1", "--no-dashboard"],
            cwd=ROOT,  # where `python -m` looks for taction first
            env=environment,
            stdin=subprocess.DEVNULL,
            stdout=subprocess.DEVNULL,
            stderr=log,
        )
    try:
        yield process
    finally:
        process.kill()
        process.wait()


@contextmanager
def scheduler(folder: Path) -> Iterator[tuple[Path, subprocess.Popen[bytes]]]:
    """Start a scheduler; yield the file with its address, and its process."""
    file = folder / "scheduler.json"
    words = ("scheduler", "--port", "0", "--scheduler-file", str(file))
    with dask(*words, folder=folder) as process:
        end = time.monotonic() + 60
        while not (file.exists() and file.stat().st_size) and time.monotonic() < end:
            time.sleep(0.02)
        yield file, process


def worker(stack: ExitStack, file: Path) -> subprocess.Popen[bytes]:
    words = ("worker", "--scheduler-file", str(file), "--nthreads", "1", "--no-nanny")
    local = ("--local-directory", str(file.parent))
    return stack.enter_context(dask(*words, *local, folder=file.parent))


def address(file: Path) -> str:
    found: dict[str, Any] = json.loads(file.read_text())
    return str(found["address"])


POINTS = 16
pytest.importorskip("distributed")


def test_a_killed_worker_costs_nothing_but_time(tmp_path: Path) -> None:
    plan = grid_plan(f"C=50p:500p:{POINTS}")
    with ExitStack() as stack:
        file, _ = stack.enter_context(scheduler(tmp_path))
        assert address(file).startswith("tcp://127.0.0.1:")
        victim = worker(stack, file)
        store = stack.enter_context(Store(str(tmp_path / "a.sqlite")))
        workers = stack.enter_context(cluster(address(file)))

        def kill(said: str) -> None:
            if said.startswith("5 of"):  # one leaves in mid-run, another joins
                worker(stack, file)
                os.kill(victim.pid, signal.SIGKILL)

        ran, outcomes = sweep_points(plan, store, workers, progress=kill)
        rows = list(all_records(plan, store))
    assert outcomes == {"pass": POINTS}
    assert len(rows) == ran == POINTS
    with Store(":memory:") as own:
        sweep_points(plan, own, HERE)
        expected = [row["settling_time"] for row in all_records(plan, own)]
    assert [row["settling_time"] for row in rows] == pytest.approx(expected, rel=1e-9)


@pytest.mark.parametrize("text", ["nonsense", "tcp://127.0.0.1", "http://x:80", "inproc://x"])
def test_an_address_that_cannot_be_one_is_refused(text: str) -> None:
    with pytest.raises(InputError, match="no Dask scheduler answers"), cluster(text):
        pass


def test_a_program_that_never_answers(
    monkeypatch: pytest.MonkeyPatch, capfd: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setattr(module, "PATIENCE", 0.5)
    with socket.create_server(("127.0.0.1", 0)) as silent:
        place = f"tcp://127.0.0.1:{silent.getsockname()[1]}"
        for each in (place, "tcp://127.0.0.1:9"):  # it is silent; nobody is there
            with pytest.raises(InputError, match="no Dask scheduler answers"), cluster(each):
                pass
    assert capfd.readouterr() == ("", "")


def test_no_worker_comes(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(module, "WORKER_PATIENCE", 0.5)
    said: list[str] = []
    with ExitStack() as stack:
        file, _ = stack.enter_context(scheduler(tmp_path))
        with pytest.raises(NoVerdictError, match=r"no worker for 0\.5 s; start one with `dask wor"):
            stack.enter_context(cluster(address(file), said.append))
    assert said == ["the cluster has no worker: waiting for one, 0.5 s"]


def test_a_worker_computes_for_its_own_versions_only(monkeypatch: pytest.MonkeyPatch) -> None:
    """One without ngspice computes, too: a point that needs ngspice says so."""
    ours, simulator = module._versions()
    monkeypatch.setattr(module, "simulator_name", lambda: simulator or "ngspice-46 klu")
    for same in ((ours, simulator), (ours, "")):
        assert module._computed(same, max, 1, 2) == 2
    for other in (("taction 0.0.9", simulator), (ours, "ngspice-39 noopiter")):
        with pytest.raises(NoVerdictError, match=f"instead of {other[0][:11]}.*equal versions"):
            module._computed(other, max, 1, 2)


@pytest.mark.parametrize("victim", ["scheduler", *nightly("worker")])
def test_a_cluster_that_dies_keeps_what_is_stored(
    victim: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capfd: pytest.CaptureFixture[str]
) -> None:
    expected = {"scheduler": "the workers are gone", "worker": "the cluster had no worker"}
    with ExitStack() as stack:
        database = stack.enter_context(Store(str(tmp_path / "a.sqlite")))
        cluster_stack = stack.enter_context(ExitStack())
        file, head = cluster_stack.enter_context(scheduler(tmp_path))
        processes = {"scheduler": head, "worker": worker(cluster_stack, file)}
        workers = stack.enter_context(cluster(address(file)))

        def kill(said: str) -> None:
            if said.startswith("5 of"):
                # Not before: the first worker may take long to come.
                monkeypatch.setattr(module, "WORKER_PATIENCE", 0.5)
                processes[victim].kill()

        with pytest.raises(NoVerdictError, match=expected[victim]) as ended:
            sweep_points(grid_plan("C=50p:500p:400"), database, workers, progress=kill)
        assert "The stored results are intact, the same command continues" in str(ended.value)
        assert 5 <= database.count() < 400
    assert capfd.readouterr().err == ""
