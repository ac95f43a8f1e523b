"""A Dask scheduler and its workers as processes, on the loopback address only."""

from __future__ import annotations

import json
import os
import shutil
import subprocess
import sys
import time
from collections.abc import Iterator
from contextlib import ExitStack, contextmanager
from pathlib import Path
from typing import Any

from tests.support.paths import ROOT


@contextmanager
def dask(
    *words: str, folder: Path, source: Path = ROOT, **settings: str
) -> Iterator[subprocess.Popen[bytes]]:
    fixed = {"OMP_NUM_THREADS": "1", "DASK_DISTRIBUTED__WORKER__PROFILE__ENABLED": "false"}
    environment = os.environ | fixed | settings
    with (folder / f"{words[0]}.log").open("ab") as log:
        process = subprocess.Popen(
            [sys.executable, "-m", "dask", *words, "--host", "127.0.0.1", "--no-dashboard"],
            cwd=source,  # where `python -m` looks for taction first
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
def scheduler(folder: Path, processes: dict[str, Any] | None = None) -> Iterator[Path]:
    """Start a scheduler; yield the file with its address. `processes` receives the process."""
    file = folder / "scheduler.json"
    words = ("scheduler", "--port", "0", "--scheduler-file", str(file))
    with dask(*words, folder=folder) as process:
        if processes is not None:
            processes["scheduler"] = process
        end = time.monotonic() + 60
        while not (file.exists() and file.stat().st_size) and time.monotonic() < end:
            time.sleep(0.02)
        yield file


def worker(stack: ExitStack, file: Path, *more: str, **other: Any) -> subprocess.Popen[bytes]:
    words = ("worker", "--scheduler-file", str(file), "--nthreads", "1", "--no-nanny")
    local = ("--local-directory", str(file.parent))
    return stack.enter_context(dask(*words, *local, *more, folder=file.parent, **other))


def another_taction(folder: Path, version: str | None = None, without: str | None = None) -> Path:
    """Copy taction and change a comment where boards are designed; return the copy's folder.

    `version` is that of the copy, by default ours; `without` is a file that the copy lacks.
    """
    # Stored bytecode is good for the copies, too; what another process still writes is left out.
    skipped = shutil.ignore_patterns("*.pyc.*")
    shutil.copytree(ROOT / "taction", folder / "taction", ignore=skipped)
    with (folder / "taction" / "netlist_gen" / "analysis.py").open("a") as file:
        file.write("# another\n")
    if without is not None:
        (folder / "taction" / without).unlink()
    if version is not None:
        about = folder / f"taction-{version}.dist-info"
        about.mkdir()
        lines = f"Metadata-Version: 2.1\nName: taction\nVersion: {version}\n"
        (about / "METADATA").write_text(lines)
    return folder


def address(file: Path) -> str:
    found: dict[str, Any] = json.loads(file.read_text())
    return str(found["address"])
