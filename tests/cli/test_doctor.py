"""Commands that need no scene: doctor, new."""

from __future__ import annotations

import json
import platform
import re
import subprocess
import sys
from pathlib import Path

import pytest

from tests.support.paths import ROOT
from tests.support.running import document, taction


def test_doctor_names_python_and_ngspice() -> None:
    findings = document(taction("doctor", "--json"))["findings"]
    assert [finding["what"] for finding in findings[:2]] == ["Python", "ngspice"]


def test_doctor_names_the_kernels_of_each_blas(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("OPENBLAS_CORETYPE", "Prescott")  # every x86-64 processor executes them
    monkeypatch.setenv("OPENBLAS_NUM_THREADS", "1")
    command = [
        sys.executable,
        "-c",
        "from taction.cli.main import main; main()",
        "doctor",
        "--json",
    ]
    run = subprocess.run(command, capture_output=True, text=True, cwd=ROOT)
    findings = json.loads(run.stdout)["findings"]
    blas = {f["what"]: f["found"] for f in findings if f["what"].startswith("BLAS")}
    assert blas.keys() == {"BLAS of numpy", "BLAS of scipy"}
    assert all("threads: 1" in found for found in blas.values())
    if platform.machine() == "x86_64":
        asked = {name: found for name, found in blas.items() if "openblas" in found}
        assert all(re.search("Katmai|Prescott|Core2", found) for found in asked.values())


def test_new_does_not_overwrite(tmp_path: Path) -> None:
    file = tmp_path / "board.toml"
    assert document(taction("new", str(file), "--json"))["file"] == str(file)
    again = taction("new", str(file))
    assert again.exit_code == 2
    assert "--force" in again.stderr
    assert taction("new", str(file), "--force").exit_code == 0
    assert taction("new", str(tmp_path / "no" / "x.toml")).exit_code == 2


def test_a_new_scene_verifies(tmp_path: Path) -> None:
    file = tmp_path / "board.toml"
    taction("new", str(file))
    assert taction("verify", str(file), "--engine", "statespace").exit_code == 0
