"""Executables that are none, and answers to ``-v`` that name no ngspice."""

from __future__ import annotations

import os
import time
from pathlib import Path

import pytest

from taction.system.errors import SimulatorNotFound, SimulatorTooOld
from taction.verification.engines.ngspice import executable
from taction.verification.engines.ngspice.executable import Simulator, find_simulator
from taction.verification.engines.ngspice.process import simulate
from tests.faulty_simulators.installed import script
from tests.faulty_simulators.program import VERSIONS
from tests.support.paths import SCENES
from tests.support.processes import is_running, process_id
from tests.support.running import document, taction
from tests.support.small_decks import transient

# The head of a program for a processor of no machine that runs taction (number 0xffff).
OTHER_PROCESSOR = b"\x7fELF\x02\x01\x01" + bytes(9) + b"\x02\0\xff\xff\x01\0\0\0" + bytes(40)


def file(path: Path, content: bytes, mode: int = 0o755) -> None:
    path.write_bytes(content)
    path.chmod(mode)


EXECUTABLES = {
    "missing": (lambda path: None, "no executable"),
    "not executable": (lambda path: file(path, b"#!/bin/sh\n", 0o644), "no executable"),
    "a folder": (lambda path: path.mkdir(), "no executable"),
    "a pipe": (lambda path: os.mkfifo(path, 0o755), "no executable|does not run"),
    "a loop of links": (lambda path: path.symlink_to(path), "no executable"),
    "empty": (lambda path: file(path, b""), "does not run: .*Exec format error"),
    "for another processor": (
        lambda path: file(path, OTHER_PROCESSOR),
        "does not run: .*Exec format error",
    ),
    "a script for a missing program": (
        lambda path: file(path, b"#!/nonexistent/interpreter\n"),
        "does not run: .*No such file",
    ),
}


@pytest.mark.parametrize("way", EXECUTABLES)
def test_what_is_no_executable_is_not_found(way: str, tmp_path: Path) -> None:
    make, says = EXECUTABLES[way]
    make(tmp_path / "ngspice")
    with pytest.raises(SimulatorNotFound, match=says) as caught:
        find_simulator(str(tmp_path / "ngspice"))
    assert "name the executable in TACTION_NGSPICE" in str(caught.value)
    assert caught.value.exit_status == 3


@pytest.mark.parametrize("way", ["missing", "for another processor"])
def test_an_executable_that_became_none_after_it_was_found(way: str, tmp_path: Path) -> None:
    make, _ = EXECUTABLES[way]
    make(tmp_path / "ngspice")
    simulator = Simulator(str(tmp_path / "ngspice"), 46, klu=True)
    with pytest.raises(SimulatorNotFound, match=r"does not start|did not start"):
        simulate(transient(), simulator, timeout=60.0, folder=tmp_path / "run")


OTHERS = {
    "version 38": (SimulatorTooOld, "is ngspice 38; 39 is needed. Install"),
    "another program": (SimulatorNotFound, "does not name ngspice.*(?s:.)*Spice Opus 3.0"),
    "a version of 5,000 digits": (SimulatorNotFound, "does not name ngspice"),
    "the version floods": (SimulatorNotFound, "does not name ngspice"),
    "the version hangs": (SimulatorNotFound, "does not name ngspice"),
    "the version ends by a signal": (SimulatorNotFound, "-v was ended by SIGSEGV"),
}
FOUND = {"version 39": (39, False), "the version leaves a child": (46, True)}


def test_every_version_has_an_outcome() -> None:
    assert set(VERSIONS) == set(OTHERS) | set(FOUND)


@pytest.mark.parametrize("way", OTHERS)
def test_what_names_no_ngspice(way: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(executable, "PATIENCE", 1.0 if way == "the version hangs" else 60.0)
    kind, says = OTHERS[way]
    began = time.monotonic()
    with pytest.raises(kind, match=says) as caught:
        find_simulator(str(script(tmp_path, way)))
    assert len(str(caught.value)) < 5000
    assert time.monotonic() - began < 30.0


@pytest.mark.parametrize("way", FOUND)
def test_what_names_an_ngspice(way: str, tmp_path: Path) -> None:
    version, klu = FOUND[way]
    simulator = find_simulator(str(script(tmp_path, way)))
    assert (simulator.version, simulator.klu) == (version, klu)
    if way == "the version leaves a child":
        assert not is_running(process_id(tmp_path / "child"))


@pytest.mark.parametrize(
    ("way", "kind"),
    [("no result", "BadEvidence"), ("step too small", "StepTooSmall"), ("abort", "Killed")],
)
def test_the_command_ends_with_3_and_says_why(
    way: str, kind: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("TACTION_NGSPICE", str(script(tmp_path, way)))
    monkeypatch.setenv("TMPDIR", str(tmp_path))
    scene = str(SCENES / "tuned-breadboard.toml")
    found = taction("verify", scene, "--engine", "ngspice", "--json")
    error = document(found)
    assert found.exit_code == 3
    assert error["outcome"] == "inconclusive"
    assert error["error"]["kind"] == kind
    assert Path(error["error"]["folder"]).is_dir()
