"""Studies that are killed, interrupted, or share a database go on from where they were."""

from __future__ import annotations

import json
import os
import re
import signal
import sqlite3
import subprocess
import sys
import time
from contextlib import closing
from pathlib import Path
from typing import Any

from tests.support.making import write_matrix_scene
from tests.support.paths import ROOT
from tests.support.running import taction
from tests.support.studying import IDEAL, scene_file, stored_samples


def command(folder: Path, *more: str) -> list[str]:
    start = "from taction.cli.main import main; main()"
    words = ["sweep", str(folder / "scene.toml"), "--over", "C=50p:500p:40"]
    words += ["--engine", "statespace", "--jobs", "2", "-o", str(folder / "a.sqlite")]
    return [sys.executable, "-c", start, *words, *more]


def stored(path: Path) -> int:
    try:
        with closing(sqlite3.connect(f"file:{path}?mode=ro", uri=True, timeout=10)) as db:
            return int(db.execute("select count(*) from points").fetchone()[0])
    except sqlite3.OperationalError:
        return 0


def interrupted(folder: Path, number: signal.Signals) -> tuple[int, str, int]:
    """Start a sweep, send it a signal in the middle; return status, stderr and points stored."""
    write_matrix_scene(
        folder,
        [[1.0, 0.2], [0.2, 1.0]],
        [1.0, 0.5],
        IDEAL,
    )
    process = subprocess.Popen(
        command(folder),
        cwd=ROOT,
        stdout=subprocess.DEVNULL,
        stderr=subprocess.PIPE,
        text=True,
        start_new_session=True,
    )
    end = time.monotonic() + 60
    while stored(folder / "a.sqlite") < 5 and time.monotonic() < end and process.poll() is None:
        time.sleep(0.01)
    os.kill(process.pid, number)
    _, text = streams(process)
    return process.returncode, text, stored(folder / "a.sqlite")


def resumed(folder: Path) -> dict[str, Any]:
    done = subprocess.run(
        command(folder, "--json"), cwd=ROOT, capture_output=True, text=True, check=True
    )
    assert re.fullmatch(r"taction: 40 points, \d+ results are stored: about .+\n", done.stderr)
    document: dict[str, Any] = json.loads(done.stdout)
    return document


def test_a_sweep_that_is_killed_goes_on_where_it_was(tmp_path: Path) -> None:
    status, text, before = interrupted(tmp_path, signal.SIGKILL)
    assert status == -signal.SIGKILL, text
    assert 5 <= before < 40
    document = resumed(tmp_path)
    assert document["ran"] == 40 - before
    assert len(document["points"]) == document["done"] == 40
    assert all(point["outcome"] == "pass" for point in document["points"])


def test_two_sweeps_on_one_database(tmp_path: Path) -> None:
    write_matrix_scene(tmp_path, [[1.0, 0.2], [0.2, 1.0]], [1.0, 0.5], IDEAL)
    both = [
        subprocess.Popen(
            command(tmp_path, "--json"), cwd=ROOT, stdout=subprocess.PIPE, stderr=subprocess.PIPE
        )
        for _ in range(2)
    ]
    for process in both:
        out, text = streams(process)
        assert process.returncode == 0, text
        assert len(json.loads(out)["points"]) == 40
    assert stored(tmp_path / "a.sqlite") == 40


def test_ctrl_c_says_how_to_go_on(tmp_path: Path) -> None:
    status, text, before = interrupted(tmp_path, signal.SIGINT)
    assert status == 130
    assert "the same command continues" in text
    assert "Traceback" not in text
    assert 5 <= before < 40
    assert resumed(tmp_path)["ran"] == 40 - before


def streams(process: subprocess.Popen[str]) -> tuple[str, str]:
    """Wait for the end of a process; one that does not end is killed, and the test fails."""
    try:
        return process.communicate(timeout=120)
    finally:
        process.kill()


def started(scene: str, file: Path, *more: str) -> subprocess.Popen[str]:
    start = "from taction.cli.main import main; main()"
    command = [sys.executable, "-c", start, "montecarlo", scene, "-n", "100000"]
    return subprocess.Popen(
        [*command, "--jobs", "1", "-o", str(file), *more],
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
    )


def wait_for_samples(file: Path, process: subprocess.Popen[str], count: int = 4) -> None:
    while stored(file) < count:
        assert process.poll() is None, process.communicate()
        time.sleep(0.02)


def test_samples_that_are_killed_go_on_from_where_they_were(tmp_path: Path) -> None:
    scene, file = scene_file(tmp_path), tmp_path / "s.sqlite"
    process = started(scene, file)
    wait_for_samples(file, process)
    os.kill(process.pid, signal.SIGKILL)
    streams(process)
    kept = stored_samples(file)
    total = len(kept) + 3
    words = ("montecarlo", scene, "-n", str(total), "--json")
    found = json.loads(taction(*words, "-o", str(file)).stdout)
    assert found["samples"] == total
    after = stored_samples(file)
    assert [sample for sample in after if sample in kept] == kept
    assert [sample["number"] for sample in after][:total] == list(range(total))
    fresh = json.loads(taction(*words, "--jobs", "1").stdout)
    assert fresh == found


def test_ctrl_c_keeps_the_samples_and_says_so(tmp_path: Path) -> None:
    scene, file = scene_file(tmp_path), tmp_path / "s.sqlite"
    process = started(scene, file, "--json")
    wait_for_samples(file, process)
    process.send_signal(signal.SIGINT)
    out, err = streams(process)
    assert process.returncode == 130, err
    assert "interrupted; the report holds the finished samples" in err
    document = json.loads(out)
    assert document["complete"] is False
    assert 4 <= document["samples"] < 100000
    assert document["samples"] <= stored(file)
