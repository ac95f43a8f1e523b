"""Find the processes of a run by their environment, and tell them apart.

Every process carries the mark of its run in its environment, or has its home in the run's folder
for temporary files, as ngspice does. No process is ever found by its name alone.
"""

from __future__ import annotations

import os
import time
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path

from tests.torture.studies import MARK


@dataclass(frozen=True)
class Process:
    """A running process: its number, its start (which tells it from a later one), its kind."""

    pid: int
    started: str
    kind: str  # parent, tracker, worker, ngspice; helper: a program that a study tries


def processes(folder: Path, parent: int) -> list[Process]:
    """Every living process of the run in `folder`, whose command is the process `parent`."""
    mark, home = f"{MARK}={folder}\0".encode(), f"HOME={folder}/".encode()
    found = []
    for name in os.listdir("/proc"):  # noqa: PTH208 - names are enough
        if name.isdigit() and int(name) >= parent:  # a child has a higher number
            with suppress(OSError, IndexError):  # it has just ended
                environment = Path(f"/proc/{name}/environ").read_bytes()
                if mark in environment or home in environment:
                    found.append(_described(int(name), parent, home in environment))
    return [process for process in found if process is not None]


def _described(pid: int, parent: int, simulates: bool) -> Process | None:
    fields = Path(f"/proc/{pid}/stat").read_text().rpartition(")")[2].split()
    if fields[0] in "ZX":
        return None
    words = Path(f"/proc/{pid}/cmdline").read_bytes()
    kind = "ngspice" if simulates else _kind(pid, parent, words)
    return Process(pid, fields[19], kind)


def _kind(pid: int, parent: int, words: bytes) -> str:
    if pid == parent:
        return "parent"
    if b"resource_tracker" in words:
        return "tracker"
    return "worker" if b"spawn_main" in words else "helper"


def handles(pid: int, number: int) -> bool:
    """Whether a process has a handler for a signal."""
    with suppress(OSError):
        text = Path(f"/proc/{pid}/status").read_text()
        mask = int(text.partition("SigCgt:")[2].split()[0], 16)
        return bool(mask >> (number - 1) & 1)
    return False


def send(process: Process, number: int) -> bool:
    """Send a signal to a process that was found before, unless its number has a new owner."""
    with suppress(OSError, IndexError):
        fields = Path(f"/proc/{process.pid}/stat").read_text().rpartition(")")[2].split()
        if fields[19] == process.started:
            os.kill(process.pid, number)
            return True
    return False


def wait_for_end(folder: Path, parent: int, seconds: float) -> list[Process]:
    """Wait until no process of the run is left; return those that are left after `seconds`."""
    end = time.monotonic() + seconds
    while (left := processes(folder, parent)) and time.monotonic() < end:
        time.sleep(0.2)
    return left
