"""The studies that are disturbed: their commands, files, processes, and results without times.

Every process carries the mark of its run in its environment, or has its home in the run's folder
for temporary files, as ngspice does. No process is ever found by its name alone.
"""

from __future__ import annotations

import json
import os
import resource
import shutil
import signal
import sqlite3
import subprocess
import sys
import time
from collections.abc import Iterator, Sequence
from contextlib import closing, suppress
from dataclasses import dataclass
from pathlib import Path
from typing import Any

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
    "sweep": ("sweep", SCENE, "--over", "C=50p:500p:6", *POOL),
    "montecarlo": ("montecarlo", SCENE, "-n", "6", *POOL),
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
                    "worker": b"spawn_main" in words,
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

    def start(
        self,
        *words: str,
        largest_file: int | None = None,
        before: Sequence[str] = (),
        **variables: str,
    ) -> subprocess.Popen[Any]:
        """Start the command, with more `words`.

        `largest_file` is a limit in bytes, as a full disk; `before` are words before the command,
        of programs that become it.
        """
        own = {MARK: f"{self.folder}", "PYTHONPATH": f"{ROOT}"}
        own["TMPDIR"] = str(self.folder / "tmp")
        line = [*before, sys.executable, "-m", "taction", *STUDIES[self.study], *words, "--json"]
        with (self.folder / "stdout").open("wb") as out, (self.folder / "stderr").open("wb") as err:
            process = subprocess.Popen(
                line,
                cwd=self.work,
                stdin=subprocess.DEVNULL,
                stdout=out,
                stderr=err,
                env=os.environ | own | NO_BYTECODE | variables,
            )
        if largest_file is not None:  # before the first line of taction runs
            resource.prlimit(process.pid, resource.RLIMIT_FSIZE, (largest_file, largest_file))
        return process

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
