"""The commands that verify many boards: sweep, stress and regress."""

from __future__ import annotations

import json
import subprocess
import sys
from pathlib import Path

import pytest
from click.testing import Result

from tests.support.entries import write_fast
from tests.support.paths import ROOT, SCENES
from tests.support.running import taction

PAPER = str(SCENES / "paper-breadboard.toml")
OVER = ("--over", "C=50pF:100pF:3", "--fix", "gain=1M", "--fix", "lambda=0.7")


@pytest.mark.parametrize(
    ("words", "remedy"),
    [
        (
            ("sweep", *OVER, "--engine", "hybrid"),
            "--engine ngspice compares every point with state space",
        ),
        (
            ("sweep", *OVER, "--retry", "failed"),
            "The same command computes points without a verdict again.",
        ),
        (("sweep", *OVER, "--keep-waveforms"), "'taction export waveforms'"),
        (("montecarlo", "--remedy"), "Set a better grade in [tolerances]"),
        (("montecarlo", "--no-remedy"), "Leave it out"),
        (("netlist", "--parameters"), "Change the number in the scene and write the deck again"),
    ],
)
def test_an_option_that_is_no_more_says_what_to_type(words: tuple[str, ...], remedy: str) -> None:
    refused = taction(words[0], PAPER, *words[1:])
    assert refused.exit_code == 2
    assert remedy in " ".join(refused.stderr.replace("│", " ").split())


ONE = ("stress", "--jobs", "1", "--only")


def test_a_wrong_outcome_has_status_1(monkeypatch: pytest.MonkeyPatch) -> None:
    from dataclasses import replace

    from taction.verification.evidence.stress import catalogue
    from taction.verification.evidence.stress import run_cases as run

    cases = catalogue.select(catalogue.load_catalogue(), ("wrong-shape",))
    planted = tuple(replace(case, outcome={"statespace": ("pass",)}) for case in cases)
    monkeypatch.setattr(run, "load_catalogue", lambda: planted)
    done = taction(*ONE, "wrong-shape")
    assert done.exit_code == 1
    assert "InputError" in done.stdout
    assert "wrong outcome" in done.stdout


def regress(*words: object) -> Result:
    return taction("regress", *map(str, words), "--jobs", "1")


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    folder = tmp_path / "scenes"
    folder.mkdir()
    write_fast(folder / "a.toml")
    assert regress(folder, "--baseline", tmp_path / "b.json", "--update").exit_code == 0
    return folder


@pytest.mark.parametrize("text", ['{"taction_baseline": 99, "scenes": {}}', "{", '{"a": 1}'])
@pytest.mark.parametrize("update", [(), ("--update",)])
def test_a_file_that_is_no_baseline_of_ours_is_refused_and_never_overwritten(
    folder: Path, text: str, update: tuple[str, ...]
) -> None:
    file = folder.parent / "other.json"
    file.write_text(text)
    result = regress(folder, "--baseline", file, *update, "--json")
    assert result.exit_code == 2
    assert json.loads(result.stdout)["outcome"] == "bad input"
    assert file.read_text() == text


def test_a_report_that_cannot_be_written_spoils_neither_result_nor_baseline(folder: Path) -> None:
    write_fast(folder / "a.toml", capacitance="10.5pF")
    file = folder.parent / "b.json"
    before = file.read_bytes()
    words = ("--update", "--junit", "/dev/full", "--json")
    result = regress(folder, "--baseline", file, *words)
    assert result.exit_code == 2
    assert "No space left on device" in result.stderr
    assert json.loads(result.stdout)["counts"] == {"changed": 1}
    assert file.read_bytes() != before


# A real signal, at a known moment: while the second scene is verified.
INTERRUPT = """
import signal
from taction.cli.main import main
from taction.verification.studies.regression import regress as run

verify = run.verify
def interrupted(scene):
    if scene.name == "second":
        signal.raise_signal(signal.SIGINT)
    return verify(scene)
run.verify = interrupted
main()
"""


def test_ctrl_c_leaves_a_whole_baseline_and_says_so(folder: Path) -> None:
    write_fast(folder / "a.toml", capacitance="10.5pF")
    for name in ("b.toml", "c.toml"):
        scene = write_fast(folder / name)
        scene.write_text(scene.read_text().replace("fast", "second"))
    file = folder.parent / "b.json"
    words = ("regress", folder, "--baseline", file, "--update", "--json", "--jobs", "1")
    run = subprocess.run(
        [sys.executable, "-c", INTERRUPT, *map(str, words)],
        capture_output=True,
        text=True,
        cwd=ROOT,
    )
    assert run.returncode == 130, run.stderr
    assert "interrupted; the finished scenes are in the report" in run.stderr
    assert json.loads(run.stdout)["counts"] == {"changed": 1, "not run": 2}
    assert set(json.loads(file.read_text())["scenes"]) == {"a.toml"}
    after = regress(folder, "--baseline", file, "--json")
    assert json.loads(after.stdout)["counts"] == {"same": 1, "new": 2}
