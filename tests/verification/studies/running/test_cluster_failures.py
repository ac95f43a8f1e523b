"""Clusters that cannot be used: each ends with a message, in a stated time, without a traceback."""

from __future__ import annotations

import socket
import time
from contextlib import ExitStack
from pathlib import Path
from typing import Any

import pytest

from taction.netlist_gen.scene.axes import parse_axes
from taction.system.errors import InputError, NoVerdictError
from taction.verification.studies.running import cluster as module
from taction.verification.studies.running.cluster import cluster
from taction.verification.studies.store import Store
from taction.verification.studies.sweep.plan import Plan
from taction.verification.studies.sweep.run import sweep
from tests.support.clusters import address, scheduler, worker
from tests.support.studying import small_scene

pytest.importorskip("distributed")


def small_plan(points: int, engine: str = "statespace") -> Plan:
    scene = small_scene()
    return Plan(scene, parse_axes(scene, [f"C=50p:500p:{points}"]), (engine,))


@pytest.mark.parametrize(
    "text",
    [
        "",
        "nonsense",
        "tcp://127.0.0.1",
        "tcp://127.0.0.1:0",
        "tcp://127.0.0.1:99999",
        "tcp://127.0.0.1:abc",
        "tcp://:8786",
        "http://127.0.0.1:80",
        "inproc://x",
        "tcp://127.0.0.1:8786\n",
    ],
)
def test_an_address_that_cannot_be_one_is_refused_before_dask_is_asked(
    text: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(module.importlib, "import_module", pytest.fail)
    with pytest.raises(InputError) as refused, cluster(text):
        pass
    assert str(refused.value) == f"--cluster: ADDRESS = {text!r}: {module.EXPECTED}"


@pytest.mark.parametrize("text", ["tcp://head_1.site:8786", "tls://[::1]:1", "127.0.0.1:65535"])
def test_addresses_that_dask_knows(text: str) -> None:
    assert module.ADDRESS.fullmatch(text)


def test_a_program_that_never_answers(
    monkeypatch: pytest.MonkeyPatch, capfd: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setattr(module, "PATIENCE", 0.5)
    with socket.create_server(("127.0.0.1", 0)) as silent:
        place = f"tcp://127.0.0.1:{silent.getsockname()[1]}"
        with pytest.raises(InputError, match="no Dask scheduler answers"), cluster(place):
            pass
    assert capfd.readouterr() == ("", "")


def test_a_worker_is_no_scheduler(tmp_path: Path) -> None:
    with ExitStack() as stack:
        file = stack.enter_context(scheduler(tmp_path))
        with socket.create_server(("127.0.0.1", 0)) as free:
            port = free.getsockname()[1]
        worker(stack, file, "--worker-port", str(port))
        end = time.monotonic() + 60
        while time.monotonic() < end:
            try:
                socket.create_connection(("127.0.0.1", port)).close()
                break
            except ConnectionRefusedError:
                time.sleep(0.05)
        with pytest.raises(InputError, match="a Dask worker answers there; expected the scheduler"):
            stack.enter_context(cluster(f"tcp://127.0.0.1:{port}"))


def test_no_worker_comes(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(module, "WORKER_PATIENCE", 0.5)
    said: list[str] = []
    with ExitStack() as stack:
        file = stack.enter_context(scheduler(tmp_path))
        store = stack.enter_context(Store(str(tmp_path / "a.sqlite")))
        workers = stack.enter_context(cluster(address(file), said.append))
        with pytest.raises(NoVerdictError, match=r"no worker for 0\.5 s; start one with `dask wor"):
            sweep(small_plan(2), store, workers)
        assert store.count() == 0
    assert said == ["the cluster has no worker: waiting for one, 0.5 s"]


@pytest.mark.parametrize("victim", ["scheduler", "worker"])
def test_a_cluster_that_dies_keeps_what_is_stored(
    victim: str,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    capfd: pytest.CaptureFixture[str],
) -> None:
    monkeypatch.setattr(module, "WORKER_PATIENCE", 0.5)
    expected = {"scheduler": "the workers are gone", "worker": "the cluster had no worker"}
    with ExitStack() as stack:
        database = stack.enter_context(Store(str(tmp_path / "a.sqlite")))
        cluster_stack = stack.enter_context(ExitStack())
        processes: dict[str, Any] = {}
        file = cluster_stack.enter_context(scheduler(tmp_path, processes))
        processes["worker"] = worker(cluster_stack, file)
        workers = stack.enter_context(cluster(address(file)))

        def kill(count: Any) -> None:
            if count.done == 5:
                processes[victim].kill()

        with pytest.raises(NoVerdictError, match=expected[victim]) as ended:
            sweep(small_plan(400), database, workers, progress=kill)
        assert "The stored results are intact, the same command continues" in str(ended.value)
        assert 5 <= database.count() < 400
    assert capfd.readouterr().err == ""


def test_a_worker_without_ngspice_is_refused_like_one_of_another_version(
    tmp_path: Path, ngspice: str
) -> None:
    assert ngspice
    with ExitStack() as stack:
        file = stack.enter_context(scheduler(tmp_path))
        worker(stack, file, TACTION_NGSPICE="/missing/ngspice")
        store = stack.enter_context(Store(str(tmp_path / "a.sqlite")))
        workers = stack.enter_context(cluster(address(file)))
        text = "no usable ngspice .no executable '/missing/ngspice'. instead of ngspice-"
        with pytest.raises(InputError, match=text):
            sweep(small_plan(2, "ngspice"), store, workers)
        assert store.count() == 0
