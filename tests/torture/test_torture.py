"""Kills and disasters: nothing is lost, and nothing stays.

With every commit one kill; `make torture` runs every kind `TACTION_TORTURE` times, at instants and
with sizes that are drawn anew where `TACTION_SEED` is another.
"""

from __future__ import annotations

import json
import os
import random
import shutil
import signal
import sqlite3
import subprocess
import sys
import time
from collections.abc import Callable, Iterator
from contextlib import closing, suppress
from dataclasses import dataclass
from itertools import product
from pathlib import Path
from typing import Any

import pytest

from taction.system.output_files import PREFIX
from tests.support.paths import ROOT, SCENES
from tests.support.running import NO_BYTECODE

MARK = "TACTION_TORTURE_RUN"  # environment variable of every process that a study starts
TIMES = {"seconds", "estimated_seconds", "timing", "ran"}
DATABASE, SCENE = "results.sqlite", "tuned-breadboard.toml"
FOLDER = (SCENE, "eleven-channel.toml")  # of `regress`
LIMIT, ORPHAN_LIMIT = 300.0, 15.0  # s until a disturbed command, and all its processes, have ended
BAD_WORDS = ("Traceback", "this is a bug", "Exception ignored")
POOL = ("--engine", "ngspice", "--jobs", "2", "-o", DATABASE)
STUDIES = {  # the last two have a database
    "verify": ("verify", SCENE, "--engine", "ngspice"),
    "regress": ("regress", "scenes", "--baseline", "base.json"),
    "sweep": ("sweep", SCENE, "--over", "C=50p:500p:4", *POOL),
    "montecarlo": ("montecarlo", SCENE, "-n", "4", *POOL),
}
STORING = ("sweep", "montecarlo")


@dataclass(frozen=True)
class Process:
    """A running process: its number, its start (which tells it from a later one), its kind."""

    pid: int
    started: str
    kind: str  # parent, tracker, worker, ngspice; helper: a program that a study tries

    def send(self, number: int) -> None:
        """Send a signal, unless the number of the process has a new owner."""
        with suppress(OSError, IndexError):
            if status_of(self.pid)[19] == self.started:
                os.kill(self.pid, number)


def status_of(pid: int) -> list[str]:
    """Return the fields of a process in /proc, from its state on."""
    return Path(f"/proc/{pid}/stat").read_text().rpartition(")")[2].split()


def processes(folder: Path, parent: int) -> Iterator[Process]:
    """Yield every living process of the run in `folder`, whose command is the process `parent`."""
    mark, home = f"{MARK}={folder}\0".encode(), f"HOME={folder}/".encode()
    for pid in (int(name) for name in os.listdir("/proc") if name.isdigit()):  # noqa: PTH208
        with suppress(OSError, IndexError):  # it has just ended
            environment = Path(f"/proc/{pid}/environ").read_bytes()
            fields = status_of(pid)
            if fields[0] not in "ZX" and (mark in environment or home in environment):
                words = Path(f"/proc/{pid}/cmdline").read_bytes()
                kinds = {
                    "ngspice": home in environment,
                    "parent": pid == parent,
                    "tracker": b"resource_tracker" in words,
                    "worker": b"import serve" in words,
                }
                kind = next((name for name, found in kinds.items() if found), "helper")
                yield Process(pid, fields[19], kind)


def ended(process: subprocess.Popen[Any], folder: Path) -> Iterator[str]:
    """Wait for the end of a command and of all its processes; yield what is wrong with it."""
    try:
        process.wait(LIMIT)
    except subprocess.TimeoutExpired:
        yield f"no end within {LIMIT:g} s"
        process.kill()
        process.wait()
    end = time.monotonic() + ORPHAN_LIMIT
    while (left := list(processes(folder, process.pid))) and time.monotonic() < end:
        time.sleep(0.2)
    for orphan in left:
        yield f"an orphan: {orphan.kind}"
        orphan.send(signal.SIGKILL)
    said = (folder / "stderr").read_text(errors="replace")
    yield from (f"{word}: {said[-300:]}" for word in BAD_WORDS if word in said)


@dataclass(frozen=True)
class Place:
    """A new folder for the runs of one study: scenes, database, folder for temporary files."""

    folder: Path
    study: str

    @classmethod
    def make(cls, folder: Path, study: str) -> Place:
        """Fill the folder."""
        scenes = folder / "work" / "scenes"
        scenes.mkdir(parents=True)
        (folder / "tmp").mkdir()
        baseline = json.loads((SCENES / "baseline.json").read_text(encoding="utf-8"))
        baseline["scenes"] = {name: baseline["scenes"][name] for name in FOLDER}
        (folder / "work" / "base.json").write_text(json.dumps(baseline))
        for name in FOLDER:
            shutil.copy(SCENES / name, scenes / name)
        shutil.copy(SCENES / SCENE, folder / "work" / SCENE)
        return cls(folder, study)

    @property
    def work(self) -> Path:
        return self.folder / "work"

    @property
    def database(self) -> Path:
        return self.work / DATABASE

    @property
    def said(self) -> str:
        return (self.folder / "stderr").read_text(errors="replace")

    def start(self, **variables: str) -> subprocess.Popen[Any]:
        """Start the command."""
        own = {MARK: f"{self.folder}", "PYTHONPATH": f"{ROOT}"}
        own["TMPDIR"] = str(self.folder / "tmp")
        line = [sys.executable, "-m", "taction", *STUDIES[self.study], "--json"]
        with (self.folder / "stdout").open("wb") as out, (self.folder / "stderr").open("wb") as err:
            return subprocess.Popen(
                line,
                cwd=self.work,
                stdin=subprocess.DEVNULL,
                stdout=out,
                stderr=err,
                env=os.environ | own | NO_BYTECODE | variables,
            )

    def rows(self) -> dict[str, Any]:
        """Return every stored point by its key: outcome and record."""
        if not self.database.exists():
            return {}
        name = f"file:{self.database}?mode=ro"
        with closing(sqlite3.connect(name, uri=True, timeout=10)) as connection:
            found = connection.execute("select hex(key), outcome, record from points").fetchall()
        return {key: (outcome, without_times(json.loads(text))) for key, outcome, text in found}

    def result(self) -> tuple[Any, dict[str, Any]]:
        """Return the document on stdout and the rows of the database, without times."""
        text = (self.folder / "stdout").read_text(encoding="utf-8")
        return without_times(json.loads(text)), self.rows()

    def again(self, expected: Any) -> Iterator[str]:
        """Give the same command again, undisturbed; yield what is wrong, also what it leaves.

        A file that was being written at a kill is hidden, and goes after an hour; a folder that a
        message names is the user's.
        """
        process = self.start()
        yield from ended(process, self.folder)
        known = {SCENE, "scenes", "base.json", DATABASE}  # before sqlite opens the database to read
        left = {path.name for path in self.work.iterdir()} - known
        yield from (f"left: {name}" for name in left if not name.startswith(PREFIX))
        left = {path.name for path in (self.folder / "tmp").iterdir()}
        yield from (f"left: {name}" for name in left if not name.startswith("taction-kept-"))
        if process.returncode:
            yield f"the second run ends with {process.returncode}: {self.said[-300:]}"
        elif self.result() != expected:
            yield "the second run has another result"


def without_times(value: Any) -> Any:
    """Return plain data without the entries that differ in each run."""
    if isinstance(value, dict):
        return {key: without_times(item) for key, item in value.items() if key not in TIMES}
    return [without_times(item) for item in value] if isinstance(value, list) else value


pytestmark = [
    pytest.mark.skipif(sys.platform != "linux", reason="finds processes in /proc"),
    pytest.mark.usefixtures("ngspice"),
]
ROUNDS, SEED = (int(os.environ.get(f"TACTION_{name}", "0")) for name in ("TORTURE", "SEED"))
SECTOR = 512  # bytes, which a disk writes whole or not at all
KILLS = {  # by victim: the signals, one after the other
    "parent": (("SIGINT",), ("SIGINT", "SIGINT"), ("SIGTERM",), ("SIGHUP",), ("SIGKILL",)),
    "worker": (("SIGKILL",), ("SIGTERM",)),
    "ngspice": (("SIGKILL",), ("SIGTERM",)),
    "tree": (("SIGKILL",),),
}
EVERY_KILL = [
    (study, victim, signals)
    for study, (victim, choices) in product(STUDIES, KILLS.items())
    for signals in choices
    if study in STORING or victim != "worker"
]
Undisturbed = Callable[[str], tuple[float, Any]]


def some(every: list[tuple[Any, ...]], few: list[tuple[Any, ...]]) -> list[tuple[Any, ...]]:
    """Return what is tested, each with a generator of random numbers of its own."""
    rounds = [(*each, k) for k in range(ROUNDS) for each in every] or [(*each, 0) for each in few]
    return [(*each, random.Random(f"{SEED} {each} {k}")) for *each, k in rounds]  # noqa: S311


@pytest.fixture(scope="module")
def undisturbed(tmp_path_factory: pytest.TempPathFactory) -> Undisturbed:
    """Wall time, s, and result of a study that nobody disturbs."""
    known: dict[str, tuple[float, Any]] = {}

    def run(study: str) -> tuple[float, Any]:
        if study not in known:
            place, began = Place.make(tmp_path_factory.mktemp("usual") / "run", study), time.time()
            process = place.start()
            assert list(ended(process, place.folder)) == []
            assert process.returncode == 0, place.said
            known[study] = time.time() - began, place.result()
        return known[study]

    return run


def handles(pid: int, number: int) -> bool:
    """Whether a process has a handler for a signal."""
    text = Path(f"/proc/{pid}/status").read_text()
    return bool(int(text.partition("SigCgt:")[2].split()[0], 16) >> (number - 1) & 1)


def strike(
    process: subprocess.Popen[Any], folder: Path, victim: str, signals: tuple[str, ...], wait: float
) -> bool:
    """Wait, and from then on for the victim; return whether there was one.

    Until the command handles signals, Python itself answers SIGINT, with a traceback.
    """
    time.sleep(wait)
    while process.poll() is None:
        found = list(processes(folder, process.pid))
        kind = "ngspice" if victim == "tree" else victim  # of a tree all, while ngspice runs
        victims = [each for each in found if each.kind == kind][:1]
        victims = found if victims and victim == "tree" else victims
        if victims and (signals[0] != "SIGINT" or handles(process.pid, signal.SIGTERM)):
            for number, name in enumerate(signals):
                time.sleep(0.05 * number)
                for each in victims:
                    each.send(getattr(signal, name))
            return True
        time.sleep(0.005)
    return False


@pytest.mark.parametrize(
    ("study", "victim", "signals", "chance"), some(EVERY_KILL, [("sweep", "tree", ("SIGKILL",))])
)
def test_a_kill_loses_nothing(
    study: str, victim: str, signals: tuple[str, ...], chance: random.Random,
    undisturbed: Undisturbed, tmp_path: Path,
) -> None:  # fmt: skip
    seconds, expected = undisturbed(study)
    wait = chance.random() * seconds
    for number in range(5):  # a command may have ended before its instant
        place = Place.make(tmp_path / f"{number}", study)
        process = place.start()
        hit = strike(process, place.folder, victim, signals, wait)
        assert list(ended(process, place.folder)) == []
        assert list(place.again(expected)) == []
        if hit:
            break
        wait *= 0.5
    assert hit


Disaster = Callable[[Place, float, random.Random], Iterator[str]]


def power_cut(place: Place, seconds: float, chance: random.Random) -> Iterator[str]:
    """Copy database and log at one instant of a run, lose the end of the log, or sectors of it.

    The command is stopped while the two files are copied. The log is not synchronised after every
    point.
    """
    running = Place.make(place.folder / "running", place.study)
    process = running.start()
    while not running.database.exists() and process.poll() is None:
        time.sleep(0.005)
    time.sleep(chance.random() * seconds)
    os.kill(process.pid, signal.SIGSTOP)
    log = place.work / f"{place.database.name}-wal"
    for name in (place.database.name, log.name):
        if (running.work / name).exists():
            shutil.copy(running.work / name, place.work / name)
    os.kill(process.pid, signal.SIGKILL)
    yield from ended(process, running.folder)
    if log.exists():
        kept = chance.randint(0, log.stat().st_size)
        if chance.random() < 0.5:
            os.truncate(log, kept)
        else:
            with log.open("r+b") as stream:
                stream.seek(kept // SECTOR * SECTOR)
                stream.write(bytes(SECTOR * chance.randint(1, 20)))


def removed_simulator(place: Place, seconds: float, chance: random.Random) -> Iterator[str]:
    """Remove ngspice in the middle of a run: that is not stored as the result of a point."""
    link = place.folder / "ngspice"
    link.symlink_to(shutil.which(os.environ.get("TACTION_NGSPICE") or "ngspice") or "ngspice")

    process = place.start(TACTION_NGSPICE=str(link))
    time.sleep(chance.random() * seconds)
    link.unlink()
    yield from ended(process, place.folder)
    if process.returncode not in (0, 3):
        yield f"exit status {process.returncode}: {place.said[-300:]}"
    yield from (f"stored: {row}" for row in place.rows().values() if row[0] == "error")


DISASTERS = (power_cut, removed_simulator)


@pytest.mark.parametrize(
    ("disaster", "study", "chance"), some(list(product(DISASTERS, STORING)), [])
)
def test_a_disaster_loses_nothing(
    disaster: Disaster, study: str, chance: random.Random, undisturbed: Undisturbed, tmp_path: Path
) -> None:
    seconds, expected = undisturbed(study)
    place = Place.make(tmp_path / "run", study)
    assert list(disaster(place, seconds, chance)) == []
    assert list(place.again(expected)) == []
