"""Studies that are killed or interrupted go on from where they were."""

from __future__ import annotations

import json
import re
import signal
import sqlite3
import subprocess
import sys
import time
from contextlib import closing
from pathlib import Path
from typing import Any

import pytest

from tests.support.making import write_matrix_scene
from tests.support.paths import ROOT
from tests.support.studying import IDEAL, scene_file

COMMAND = [sys.executable, "-c", "from taction.cli.main import main; main()"]


def command(folder: Path, *more: str) -> list[str]:
    words = ["sweep", str(folder / "scene.toml"), "--over", "C=50p:500p:40"]
    words += ["--engine", "statespace", "--jobs", "1", "-o", str(folder / "a.sqlite")]
    return [*COMMAND, *words, *more]


def stored(path: Path) -> int:
    try:
        with closing(sqlite3.connect(f"file:{path}?mode=ro", uri=True, timeout=10)) as db:
            return int(db.execute("select count(*) from points").fetchone()[0])
    except sqlite3.OperationalError:
        return 0


def resumed(folder: Path) -> dict[str, Any]:
    done = subprocess.run(
        command(folder, "--json"), cwd=ROOT, capture_output=True, text=True, check=True
    )
    said, *later = done.stderr.splitlines()
    assert re.fullmatch(r"taction: computing \d+ of 40 points", said)
    assert [line for line in later if " of 40 points" not in line] == []  # on a slow machine
    document: dict[str, Any] = json.loads(done.stdout)
    return document


@pytest.mark.parametrize(
    ("number", "status", "says"),
    [(signal.SIGKILL, -9, ""), (signal.SIGINT, 130, "the same command continues")],
)
def test_a_sweep_that_is_ended_goes_on_where_it_was(
    number: signal.Signals, status: int, says: str, tmp_path: Path
) -> None:
    write_matrix_scene(tmp_path, [[1.0, 0.2], [0.2, 1.0]], [1.0, 0.5], IDEAL)
    process = start(command(tmp_path))
    wait_for_results(tmp_path / "a.sqlite", process)
    process.send_signal(number)
    _, text = streams(process)
    before = stored(tmp_path / "a.sqlite")
    assert process.returncode == status, text
    assert says in text
    assert "Traceback" not in text
    assert 5 <= before < 40
    document = resumed(tmp_path)
    assert document["ran"] == 40 - before
    assert len(document["points"]) == document["done"] == 40
    assert all(point["outcome"] == "pass" for point in document["points"])


def streams(process: subprocess.Popen[str]) -> tuple[str, str]:
    """Wait for the end of a process; one that does not end is killed, and the test fails."""
    try:
        return process.communicate(timeout=120)
    finally:
        process.kill()


def start(words: list[str]) -> subprocess.Popen[str]:
    """Start a command in a session of its own."""
    return subprocess.Popen(
        words,
        cwd=ROOT,
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
        start_new_session=True,
    )


def wait_for_results(file: Path, process: subprocess.Popen[str]) -> None:
    while stored(file) < 5:
        assert process.poll() is None, process.communicate()
        time.sleep(0.01)


def test_ctrl_c_keeps_the_samples_and_says_so(tmp_path: Path) -> None:
    scene, file = scene_file(tmp_path), tmp_path / "s.sqlite"
    words = ["montecarlo", scene, "-n", "100000", "--jobs", "1", "-o", str(file), "--json"]
    process = start([*COMMAND, *words])
    wait_for_results(file, process)
    process.send_signal(signal.SIGINT)
    out, err = streams(process)
    assert process.returncode == 130, err
    assert "interrupted; the report holds the finished samples" in err
    document = json.loads(out)
    assert document["complete"] is False
    assert 5 <= document["samples"] < 100000
    assert document["samples"] <= stored(file)
