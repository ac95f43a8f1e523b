"""The studies that are killed: their commands, their files, and their results without times."""

from __future__ import annotations

import json
import os
import resource
import shutil
import sqlite3
import subprocess
import sys
from collections.abc import Sequence
from contextlib import closing
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from taction.system.atomic_files import PREFIX
from tests.support.paths import ROOT, SCENES
from tests.support.running import NO_BYTECODE

MARK = "TACTION_TORTURE"  # environment variable of every process that a study starts
TIMES = {"seconds", "estimated_seconds", "timing", "ran"}
DATABASE = "results.sqlite"
SCENE = "tuned-breadboard.toml"
FOLDER = (SCENE, "eleven-channel.toml")  # of `regress`


@dataclass(frozen=True)
class Study:
    """A command with a database, or none, and the size of its work."""

    name: str
    words: tuple[str, ...]
    pool: bool  # whether workers compute its points
    stores: bool  # whether it has a database


def all_studies(points: int) -> dict[str, Study]:
    """The four studies; `points` is the number of points and samples."""
    pool = ("--engine", "ngspice", "--jobs", "2", "-o", DATABASE)
    studies = (
        Study("verify", ("verify", SCENE, "--engine", "ngspice"), False, False),
        Study("sweep", ("sweep", SCENE, "--over", f"C=50p:500p:{points}", *pool), True, True),
        Study("montecarlo", ("montecarlo", SCENE, "-n", str(points), *pool), True, True),
        Study("regress", ("regress", "scenes", "--baseline", "base.json"), False, False),
    )
    return {study.name: study for study in studies}


@dataclass(frozen=True)
class Place:
    """A new folder for one run: scenes, database, and the folder for temporary files."""

    folder: Path

    @classmethod
    def make(cls, folder: Path) -> Place:
        scenes = folder / "work" / "scenes"
        scenes.mkdir(parents=True)
        (folder / "tmp").mkdir()
        baseline = json.loads((SCENES / "baseline.json").read_text(encoding="utf-8"))
        baseline["scenes"] = {name: baseline["scenes"][name] for name in FOLDER}
        (folder / "work" / "base.json").write_text(json.dumps(baseline))
        for name in FOLDER:
            shutil.copy(SCENES / name, scenes / name)
        shutil.copy(SCENES / SCENE, folder / "work" / SCENE)
        return cls(folder)

    @property
    def work(self) -> Path:
        return self.folder / "work"

    @property
    def temporary(self) -> Path:
        return self.folder / "tmp"

    @property
    def database(self) -> Path:
        return self.work / DATABASE

    def start(
        self,
        study: Study,
        largest_file: int | None = None,
        before: Sequence[str] = (),
        **variables: str,
    ) -> subprocess.Popen[str]:
        """Start the command of `study`.

        `largest_file` is a limit in bytes, as a full disk; `before` are words before the command,
        of programs that become it.
        """
        own = {MARK: str(self.folder), "TMPDIR": str(self.temporary), "PYTHONPATH": str(ROOT)}
        own |= NO_BYTECODE | variables
        with (self.folder / "stdout").open("wb") as out, (self.folder / "stderr").open("wb") as err:
            process = subprocess.Popen(
                [*before, sys.executable, "-m", "taction", *study.words, "--json"],
                cwd=self.work,
                stdin=subprocess.DEVNULL,
                stdout=out,
                stderr=err,
                text=True,
                env=os.environ | own,
            )
        if largest_file is not None:  # before the first line of taction runs
            resource.prlimit(process.pid, resource.RLIMIT_FSIZE, (largest_file, largest_file))
        return process

    def result(self, study: Study) -> tuple[Any, dict[str, Any]]:
        """The document on stdout and the rows of the database, without times."""
        text = (self.folder / "stdout").read_text(encoding="utf-8")
        return without_times(json.loads(text)), rows(self.database) if study.stores else {}

    def leftovers(self) -> list[str]:
        """What no run may leave: temporary folders without an owner, and files of another name.

        A file that was being written at the kill is hidden, and goes after an hour.
        """
        kept = ("taction-kept-",)  # named in a message, for the user
        found = [p.name for p in self.temporary.iterdir() if not p.name.startswith(kept)]
        expected = {SCENE, "scenes", "base.json", DATABASE}
        others = [p.name for p in self.work.iterdir() if p.name not in expected]
        return found + [name for name in others if not name.startswith(PREFIX)]


def rows(database: Path) -> dict[str, Any]:
    """Every stored point by its key: outcome and record."""
    with closing(sqlite3.connect(f"file:{database}?mode=ro", uri=True, timeout=10)) as connection:
        found = connection.execute("select hex(key), outcome, record from points").fetchall()
    return {key: (outcome, without_times(json.loads(record))) for key, outcome, record in found}


def without_times(value: Any) -> Any:
    """Plain data without the entries that differ in each run."""
    if isinstance(value, dict):
        return {key: without_times(item) for key, item in value.items() if key not in TIMES}
    return [without_times(item) for item in value] if isinstance(value, list) else value
