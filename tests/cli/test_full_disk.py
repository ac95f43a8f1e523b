"""Disks without room: the kernel's limit on the size of a file stands for a full disk."""

from __future__ import annotations

import json
import os
import resource
import subprocess
import sys
from pathlib import Path

import pytest

from tests.support.paths import ROOT, SCENES

SCENE = str(SCENES / "tuned-breadboard.toml")
OVER = ("--over", "C=50p:500p:12", "--jobs", "2")


def run(*words: str, limit: int | None = None) -> subprocess.CompletedProcess[str]:
    """Run taction, where no file may have more than `limit` bytes."""

    def limited() -> None:
        if limit is not None:
            resource.setrlimit(resource.RLIMIT_FSIZE, (limit, limit))

    return subprocess.run(
        [sys.executable, "-m", "taction", *words],
        cwd=ROOT,
        capture_output=True,
        text=True,
        check=False,
        timeout=300,
        env=os.environ,
        preexec_fn=limited,
    )


def without_times(text: str) -> list[dict[str, object]]:
    points: list[dict[str, object]] = json.loads(text)["points"]
    return [{k: v for k, v in point.items() if k != "seconds"} for point in points]


@pytest.mark.parametrize("limit", [10_000, 60_000])
def test_a_sweep_goes_on_with_room(limit: int, tmp_path: Path) -> None:
    words = ("sweep", SCENE, *OVER, "--engine", "statespace", "--json", "-o")
    full = run(*words, str(tmp_path / "a.sqlite"), limit=limit)
    assert full.returncode == 3, full.stderr
    assert json.loads(full.stdout)["error"]["kind"] == "OutOfDisk"
    assert "make room on the disk and run the same command again" in full.stderr
    again = run(*words, str(tmp_path / "a.sqlite"))
    assert again.returncode == 0, again.stderr
    whole = run(*words, str(tmp_path / "b.sqlite"))
    assert without_times(again.stdout) == without_times(whole.stdout)


@pytest.mark.parametrize(
    ("words", "name"),
    [
        (("simulate", SCENE, "--engine", "statespace", "-o"), "a.csv"),
        (("simulate", SCENE, "--engine", "statespace", "-o"), "a.parquet"),
        (("simulate", SCENE, "--engine", "statespace", "-o"), "a.raw"),
        (("verify", SCENE, "--engine", "statespace", "--plot"), "a.png"),
        (("verify", SCENE, "--engine", "statespace", "--plot"), "a.svg"),
        (("netlist", SCENE, "--split", "-o"), "a.cir"),
        (("new", "--force"), "a.toml"),
        (("stress", "--only", "nothing-moves", "--junit"), "a.xml"),
    ],
)
def test_an_output_is_whole_or_unchanged(words: tuple[str, ...], name: str, tmp_path: Path) -> None:
    (tmp_path / name).write_text("old")
    done = run(*words, str(tmp_path / name), limit=500)
    assert done.returncode == 2, done.stderr
    assert f"{name}: FILE: File too large (ulimit -f); expected a file" in done.stderr
    assert "Traceback" not in done.stderr
    assert {path.name: path.read_text() for path in tmp_path.iterdir()} == {name: "old"}
