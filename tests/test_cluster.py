"""A sweep on a real Dask cluster over TCP on loopback, one worker of which is killed."""

from __future__ import annotations

import json
import os
import signal
import subprocess
import sys
import time
from collections.abc import Iterator
from contextlib import ExitStack, contextmanager
from pathlib import Path
from typing import Any

import pytest
from making import NEAR_IDEAL, make_scene

from verification.report.sweep import records
from verification.studies.axes import parse_axes
from verification.studies.executors import cluster
from verification.studies.grid import Plan
from verification.studies.store import Store
from verification.studies.sweep import sweep

ROOT = Path(__file__).parents[1]
DESIGN = {"capacitance": "100pF", "gain": "100kohm", "stray_capacitance": 0, "opamp": NEAR_IDEAL}
POINTS = 60
pytest.importorskip("distributed")


@contextmanager
def dask(*words: str, folder: Path) -> Iterator[subprocess.Popen[bytes]]:
    environment = os.environ | {
        "OMP_NUM_THREADS": "1",
        "DASK_DISTRIBUTED__WORKER__PROFILE__ENABLED": "false",
    }
    with (folder / f"{words[0]}.log").open("ab") as log:
        process = subprocess.Popen(
            [sys.executable, "-m", "dask", *words, "--host", "127.0.0.1", "--no-dashboard"],
            cwd=ROOT,
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
def scheduler(folder: Path) -> Iterator[Path]:
    file = folder / "scheduler.json"
    words = ("scheduler", "--port", "0", "--scheduler-file", str(file))
    with dask(*words, folder=folder):
        end = time.monotonic() + 60
        while not file.exists() and time.monotonic() < end:
            time.sleep(0.02)
        yield file


def worker(stack: ExitStack, file: Path) -> subprocess.Popen[bytes]:
    words = ("worker", "--scheduler-file", str(file), "--nthreads", "1", "--no-nanny")
    local = ("--local-directory", str(file.parent))
    return stack.enter_context(dask(*words, *local, folder=file.parent))


def address(file: Path) -> str:
    found: dict[str, Any] = json.loads(file.read_text())
    return str(found["address"])


def test_a_killed_worker_costs_nothing_but_time(tmp_path: Path) -> None:
    asked = make_scene({"channels": 2, "span": 1.2}, design=DESIGN)
    plan = Plan(asked, parse_axes(asked, [f"C=50p:500p:{POINTS}"]), ("statespace",))
    with ExitStack() as stack:
        file = stack.enter_context(scheduler(tmp_path))
        assert address(file).startswith("tcp://127.0.0.1:")
        victim, _ = (worker(stack, file) for _ in range(2))
        store = stack.enter_context(Store(str(tmp_path / "a.sqlite")))
        workers = stack.enter_context(cluster(address(file)))

        def kill(count: Any) -> None:
            if count.done == 5:  # one leaves in mid-run, another joins
                worker(stack, file)
                os.kill(victim.pid, signal.SIGKILL)

        count = sweep(plan, store, workers, progress=kill)
        rows = list(records(plan, store))
    assert count.outcomes == {"pass": POINTS}
    assert len(rows) == count.ran == POINTS
