"""Questions about the input on stderr and in verdicts, and files that are written first."""

from __future__ import annotations

import os
import subprocess
import sys
from pathlib import Path

import pytest

from tests.support.entries import write_fast
from tests.support.paths import ROOT
from tests.support.running import document, taction


def test_a_verdict_has_the_question_as_a_warning(tmp_path: Path) -> None:
    scene = write_fast(tmp_path / "a.toml", capacitance="10mF")
    found = document(taction("verify", str(scene), "--json", "--changes", "0"))
    assert any("10 mF is not between" in text for text in found["warnings"])


@pytest.mark.parametrize("words", [("netlist",), ("solve",), ("bom",)])
def test_other_commands_ask_on_stderr(tmp_path: Path, words: tuple[str, ...]) -> None:
    scene = write_fast(tmp_path / "a.toml", capacitance="10mF")
    result = taction(*words, str(scene))
    assert "taction: question: design.capacitance = 10 mF" in result.stderr
    assert "question" not in result.stdout
    usual = write_fast(tmp_path / "b.toml")
    assert "question" not in taction(*words, str(usual)).stderr


def test_a_sweep_asks_about_its_range(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    write_fast(tmp_path / "a.toml")
    result = taction("sweep", "a.toml", "--over", "C=20pF:10pF:2", "--jobs", "1")
    assert "taction: question: --over C: the range falls from 20 pF to 10 pF" in result.stderr
    assert result.exit_code == 0


@pytest.mark.parametrize(
    "words",
    [
        ("verify", "a.toml", "--plot", "x.png"),
        ("onset", "a.toml", "--over", "C=8pF:9pF:3", "--no-confirm", "--plot", "x.png"),
        ("verify", "a.toml", "--junit", "x.png"),
    ],
)
def test_a_closed_pipe_leaves_the_picture(tmp_path: Path, words: tuple[str, ...]) -> None:
    write_fast(tmp_path / "a.toml")
    reader, writer = os.pipe()
    os.close(reader)
    run = subprocess.run(
        [sys.executable, "-c", "from taction.cli.main import main; main()", *words],
        stdout=writer,
        stderr=subprocess.PIPE,
        cwd=tmp_path,
        check=False,
        env={**os.environ, "PYTHONPATH": str(ROOT)},
    )
    os.close(writer)
    assert run.returncode == 141
    assert (tmp_path / "x.png").stat().st_size > 200
