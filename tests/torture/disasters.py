"""Power cuts, two studies on one database, full disks, a clock that jumps."""

from __future__ import annotations

import os
import random
import shutil
import signal
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

from tests.support.paths import ROOT
from tests.torture.killing import Report, again, end
from tests.torture.studies import DATABASE, Place, Study
from tests.torture.victims import wait_for_end

Disaster = Callable[[Study, Path, float, Any, random.Random], Report]


def power_cut(
    study: Study, folder: Path, seconds: float, expected: Any, chance: random.Random
) -> Report:
    """Copy database and log at one instant of a run, lose the end of the log, and go on from there.

    The command is stopped while the two files are copied, so that they are of one instant. A power
    cut loses the end of the log, since the log is not synchronised after every point.
    """
    report = Report(study.name, "power", "cut")
    running, later = (Place.make(folder / name) for name in ("running", "later"))
    process = running.start(study)
    while not running.database.exists() and process.poll() is None:
        time.sleep(0.005)
    time.sleep(chance.random() * seconds)
    os.kill(process.pid, signal.SIGSTOP)
    for ending in ("", "-wal"):
        file = running.work / f"{DATABASE}{ending}"
        if file.exists():
            shutil.copy(file, later.work / file.name)
    os.kill(process.pid, signal.SIGKILL)
    end(report, process, running)
    log = later.work / f"{DATABASE}-wal"
    if log.exists():
        os.truncate(log, chance.randint(0, log.stat().st_size))
    again(report, study, later, expected)
    return report


def two_at_once(
    study: Study, folder: Path, seconds: float, expected: Any, chance: random.Random
) -> Report:
    """Start the same command twice on one database."""
    report = Report(study.name, "none", "two at once")
    place = Place.make(folder)
    first = place.start(study)
    time.sleep(0.5 * chance.random() * seconds)
    second = place.start(study)
    end(report, first, place)
    end(report, second, place)
    again(report, study, place, expected)
    return report


def full_disk(
    study: Study, folder: Path, seconds: float, expected: Any, chance: random.Random
) -> Report:
    """Let no file grow beyond a random size, and run again without this limit."""
    report = Report(study.name, "disk", "full")
    place = Place.make(folder)
    process = place.start(study, largest_file=chance.randint(1_000, 120_000))
    end(report, process, place)
    wait_for_end(place.folder, process.pid, 1.0)
    if report.status not in (0, 3):
        report.faults.append(f"exit status {report.status}")
    again(report, study, place, expected)
    return report


JUMPS = """
import random, time
real = time.time
time.time = lambda: real() + random.choice((-1e8, 0.0, 1e8))
time.time_ns = lambda: int(1e9 * time.time())
"""


def jumping_clock(
    study: Study, folder: Path, seconds: float, expected: Any, chance: random.Random
) -> Report:
    """Let the wall clock of every process jump by three years back and forth at each look."""
    report = Report(study.name, "clock", "jumps")
    place = Place.make(folder)
    site = folder / "site"
    site.mkdir()
    (site / "sitecustomize.py").write_text(JUMPS, encoding="utf-8")
    process = place.start(study, PYTHONPATH=f"{site}{os.pathsep}{ROOT}")
    end(report, process, place)
    if report.status != 0:
        report.faults.append(f"exit status {report.status}")
    again(report, study, place, expected)
    return report


DISASTERS: dict[str, Disaster] = {
    "power cut": power_cut,
    "two at once": two_at_once,
    "full disk": full_disk,
    "jumping clock": jumping_clock,
}
