"""What happens to a study besides kills: power cuts, full disks, other versions, a lost ngspice."""

from __future__ import annotations

import os
import random
import shutil
import signal
import subprocess
import time
from collections.abc import Callable
from contextlib import ExitStack, suppress
from dataclasses import replace
from importlib import metadata
from pathlib import Path
from typing import Any

from tests.support import clusters
from tests.torture.killing import LIMIT, Report, again, end
from tests.torture.studies import DATABASE, Place, Study, rows
from tests.torture.victims import wait_for_end

SECTOR = 512  # bytes, which a disk writes whole or not at all
Disaster = Callable[[Study, Path, float, Any, random.Random], Report]


def power_cut(
    study: Study, folder: Path, seconds: float, expected: Any, chance: random.Random
) -> Report:
    """Copy database and log at one instant of a run, lose the end of the log, and go on from there.

    The command is stopped while the two files are copied, so that they are of one instant. A power
    cut loses the end of the log, or sectors of it, since the log is not synchronised after every
    point.
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
        kept = chance.randint(0, log.stat().st_size)
        if chance.random() < 0.5:
            os.truncate(log, kept)
        else:
            with log.open("r+b") as stream:
                stream.seek(kept // SECTOR * SECTOR)
                stream.write(bytes(SECTOR * chance.randint(1, 20)))
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
    with suppress(subprocess.TimeoutExpired):  # which `end` reports
        second.wait(LIMIT)
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


def full_memory_disk(
    study: Study, folder: Path, seconds: float, expected: Any, chance: random.Random
) -> Report:
    """Let /dev/shm, which holds the temporary files, be full, and run again with a free one."""
    report = Report(study.name, "memory disk", "full")
    place = Place.make(folder)
    free = chance.randint(4, 300)
    process = place.start(study, before=in_small_memory(free))
    end(report, process, place)
    if report.status not in (0, 3):
        report.faults.append(f"exit status {report.status} with {free} kB")
    report.faults += points_without_verdict(place)
    again(report, study, place, expected)
    return report


def in_small_memory(size: int) -> list[str]:
    """Return the words before a command whose /dev/shm, also for temporary files, has `size` kB."""
    # In a changed root, "/" is no mount, so /dev/shm alone is kept from the rest of the machine.
    alone = "{ mount --make-rprivate / || mount --make-private /dev/shm; } 2>/dev/null"
    script = f"{alone} && mount -t tmpfs -o size={size}k tmpfs /dev/shm && export TMPDIR=/dev/shm"
    rights = [] if os.geteuid() == 0 else ["-r"]
    own = ["unshare", *rights, "--mount", "--propagation", "unchanged"]
    return [*own, "sh", "-c", f'{script} && exec "$0" "$@"']


def removed_simulator(
    study: Study, folder: Path, seconds: float, expected: Any, chance: random.Random
) -> Report:
    """Remove ngspice in the middle of a run, and run again with it."""
    report = Report(study.name, "ngspice", "removed")
    place = Place.make(folder)
    link = folder / "ngspice"
    link.symlink_to(shutil.which(os.environ.get("TACTION_NGSPICE") or "ngspice") or "ngspice")
    process = place.start(study, TACTION_NGSPICE=str(link))
    time.sleep(chance.random() * seconds)
    link.unlink()
    end(report, process, place)
    if report.status not in (0, 3):
        report.faults.append(f"exit status {report.status}")
    report.faults += points_without_verdict(place)
    again(report, study, place, expected)
    return report


def points_without_verdict(place: Place) -> list[str]:
    """What no failure of the machine may store: points that the next run takes as computed."""
    return [f"stored: {row}" for row in stored(place) if row[0] == "error"]


def stored(place: Place) -> list[Any]:
    """The rows of a place's database, which may be missing."""
    return list(rows(place.database).values()) if place.database.exists() else []


def other_version(
    study: Study, folder: Path, seconds: float, expected: Any, chance: random.Random
) -> Report:
    """Run on a Dask cluster whose only worker has another taction, and run again here."""
    report = Report(study.name, "worker", "another version")
    place = Place.make(folder)
    version, ours = f"0.{chance.randint(2, 9)}.{chance.randint(0, 9)}", metadata.version("taction")
    without = chance.choice((None, "verification/studies/sweep/point.py", "system/errors.py"))
    with ExitStack() as stack:
        (folder / "cluster").mkdir()
        file = stack.enter_context(clusters.scheduler(folder / "cluster"))
        other = clusters.another_taction(folder / "other", version, without)
        clusters.worker(stack, file, source=other)
        there = replace(study, words=(*study.words, "--cluster", clusters.address(file)))
        process = place.start(there)
        end(report, process, place)
    said = (place.folder / "stderr").read_text(errors="replace")
    known = version in said or without is not None  # else no function of ours answers there
    if report.status != 3 or not known or ours not in said:
        report.faults.append(f"exit status {report.status}, without {without}: {said[-300:]}")
    report.faults += [f"stored: {row}" for row in stored(place)]
    again(report, study, place, expected)
    return report


JUMPS = """
import random, time
real = time.time
time.time = lambda: real() + random.choice((-1e8, 0.0, 1e8))
time.time_ns = lambda: int(1e9 * time.time())
"""


DISASTERS: dict[str, Disaster] = {
    "power cut": power_cut,
    "two at once": two_at_once,
    "full disk": full_disk,
    "full memory disk": full_memory_disk,
    "removed simulator": removed_simulator,
    "other version": other_version,
}


def possible() -> list[str]:
    """Return the disasters that can be made on this machine.

    A memory disk of one's own needs the right to mount one, and `mount`, which a minimal Debian
    does not have.
    """
    words = [*in_small_memory(100), "true"]
    try:
        mounts = subprocess.run(words, capture_output=True, check=False).returncode == 0
    except OSError:
        mounts = False
    return [name for name in DISASTERS if mounts or name != "full memory disk"]
