"""Every way in which a simulator fails has a typed outcome, and a message that helps."""

from __future__ import annotations

import os
import shlex
import shutil
import sys
import time
from pathlib import Path

import numpy as np
import pytest

from taction.system.array_types import Waveforms
from taction.system.errors import (
    BadEvidence,
    Killed,
    OutOfDisk,
    SimulationError,
    SimulatorNotFound,
    SimulatorTooOld,
    StepTooSmall,
    TimedOut,
)
from taction.verification.engines.ngspice import process
from taction.verification.engines.ngspice.process import Simulator, find_simulator, simulate
from tests.faulty_simulators.ways import RUNS, VERSIONS
from tests.support.paths import ROOT, SCENES
from tests.support.running import document, is_running, process_id, taction
from tests.support.small_decks import transient

DECK = transient(saved=("out", "in"), stop=1e-6, step=1e-8)
SOON, LATE = 1.0, 60.0  # s: the timeout where the program never ends, and else

REFUSED: dict[str, tuple[type[SimulationError], str]] = {
    "no result": (BadEvidence, r"out\.raw was never written"),
    "exit status of a shell for a signal": (Killed, "SIGSEGV"),
    "exit status of a shell for no program": (SimulatorNotFound, r"exit status 127.*Install"),
    "abort": (Killed, r"signal SIGABRT ended ngspice after .* s"),
    "a signal without a name": (Killed, "signal [0-9]+ ended ngspice"),
    "hangs and ignores signals": (TimedOut, "did not finish within 1 s"),
    "slow": (TimedOut, "did not finish within 1 s"),
    "step too small before the first point": (StepTooSmall, "below the simulator's limit"),
    "result completed by a child": (OutOfDisk, "holds [0-9]+ of [0-9]+ bytes"),
    "the folder is removed": (BadEvidence, r"error stream.*stderr\.txt: No such file"),
    "result is a pipe": (BadEvidence, "not a regular file"),
    "result is a device": (BadEvidence, "not a regular file"),
}
FLOODS = ("floods stderr", "floods its result")
ACCEPTED = RUNS.keys() - REFUSED.keys() - set(FLOODS)


@pytest.fixture(autouse=True)
def own_place(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Run folders are made in the folder of the test."""
    monkeypatch.setenv("TMPDIR", str(tmp_path))


def script(folder: Path, way: str) -> str:
    """Write the executable of a way; the program may leave files in `folder`."""
    path = folder / "ngspice"
    variables = f"PYTHONPATH={shlex.quote(str(ROOT))} FAULTY_FOLDER={shlex.quote(str(folder))}"
    words = shlex.join([sys.executable, "-S", "-m", "tests.faulty_simulators.ways", way])
    path.write_text(f'#!/bin/sh\n{variables} exec {words} "$@"\n')
    path.chmod(0o755)
    return str(path)


def run(folder: Path, way: str, timeout: float = LATE) -> Waveforms:
    """Simulate a deck with the simulator of a way, as if its version had been asked for."""
    simulator = Simulator(script(folder, way), 46, klu=True)
    return simulate(DECK, simulator, timeout=timeout)


def stopped(folder: Path, way: str) -> None:
    """Assert that nothing goes on that the program has left."""
    if sys.platform == "linux" and way.startswith("leaves"):
        child = process_id(folder / "child")
        if way == "leaves a daemon without traces":
            os.kill(child, 9)  # nothing says whose it is
        assert not is_running(child)


@pytest.mark.parametrize("way", REFUSED)
def test_refused(way: str, tmp_path: Path) -> None:
    kind, says = REFUSED[way]
    with pytest.raises(kind, match=says) as caught:
        run(tmp_path, way, SOON if kind is TimedOut else LATE)
    assert type(caught.value) is kind
    assert caught.value.exit_status == 3
    assert caught.value.folder is not None
    assert caught.value.folder.parent == tmp_path
    assert "`sh command.txt` in this folder repeats the run" in str(caught.value)
    stopped(tmp_path, way)
    if way == "slow":  # the first points are there
        assert isinstance(caught.value, TimedOut)
        assert caught.value.partial is not None
        assert len(caught.value.partial.time) == 250


@pytest.mark.parametrize("way", sorted(ACCEPTED))
def test_accepted(way: str, tmp_path: Path) -> None:
    waveforms = run(tmp_path, way)
    line = waveforms.time / 1e-6  # the straight lines that a correct program computes
    assert waveforms.nodes == DECK.saved
    np.testing.assert_allclose(waveforms.values, np.column_stack([line, 1.0 + line]))
    assert not list(tmp_path.glob("taction-*"))
    stopped(tmp_path, way)


@pytest.mark.skipif(sys.platform != "linux", reason="reads /proc")
@pytest.mark.parametrize("way", FLOODS)
def test_a_flood_ends_soon(way: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(process, "LONGEST_RESULT", 100_000_000)
    began = time.monotonic()
    with pytest.raises(SimulationError) as caught:
        run(tmp_path, way, 600.0)
    assert time.monotonic() - began < 120.0
    assert caught.value.folder is not None
    sizes = {file.name: file.stat().st_size for file in caught.value.folder.iterdir()}
    assert max(sizes.values()) == 100_000_000
    shutil.rmtree(caught.value.folder)


@pytest.mark.parametrize(
    ("way", "kind"),
    [("no result", "BadEvidence"), ("step too small before the first point", "StepTooSmall")],
)
def test_the_command_ends_with_3_and_says_why(
    way: str, kind: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("TACTION_NGSPICE", script(tmp_path, way))
    monkeypatch.setenv("TMPDIR", str(tmp_path))
    scene = str(SCENES / "tuned-breadboard.toml")
    found = taction("verify", scene, "--engine", "ngspice", "--json")
    error = document(found)
    assert found.exit_code == 3
    assert error["outcome"] == "inconclusive"
    assert error["error"]["kind"] == kind
    assert Path(error["error"]["folder"]).is_dir()


def file(path: Path, content: bytes, mode: int = 0o755) -> None:
    path.write_bytes(content)
    path.chmod(mode)


# The head of a program for a processor of no machine that runs taction (number 0xffff).
OTHER_PROCESSOR = b"\x7fELF\x02\x01\x01" + bytes(9) + b"\x02\0\xff\xff\x01\0\0\0" + bytes(40)
EXECUTABLES = {
    "missing": (lambda path: None, "no executable"),
    "a folder": (lambda path: path.mkdir(), "no executable"),
    "for another processor": (lambda path: file(path, OTHER_PROCESSOR), "run: .*Exec format error"),
    "a script for a missing program": (
        lambda path: file(path, b"#!/nonexistent/interpreter\n"), "does not run: .*No such file",
    ),
}  # fmt: skip


@pytest.mark.parametrize("way", EXECUTABLES)
def test_what_is_no_executable_is_not_found(way: str, tmp_path: Path) -> None:
    make, says = EXECUTABLES[way]
    make(tmp_path / "ngspice")
    with pytest.raises(SimulatorNotFound, match=says) as caught:
        find_simulator(str(tmp_path / "ngspice"))
    assert "name the executable in TACTION_NGSPICE" in str(caught.value)
    assert caught.value.exit_status == 3
    with pytest.raises(SimulatorNotFound, match=r"does not start|did not start"):  # it was one
        simulate(DECK, Simulator(str(tmp_path / "ngspice"), 46, klu=True), timeout=LATE)


FOUND = {"version 39": (39, False), "the version leaves a child": (46, True)}
OTHERS = {
    "version 38": (SimulatorTooOld, "is ngspice 38; 39 is needed. Install"),
    "another program": (SimulatorNotFound, "does not name ngspice.*(?s:.)*Spice Opus 3.0"),
    "the version floods": (SimulatorNotFound, "does not name ngspice"),
    "the version hangs": (SimulatorNotFound, "does not name ngspice"),
}


@pytest.mark.parametrize("way", VERSIONS)
def test_a_version_is_that_of_an_ngspice_or_refused(
    way: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(process, "PATIENCE", SOON if way == "the version hangs" else LATE)
    place, began = script(tmp_path, way), time.monotonic()
    if way in FOUND:
        simulator = find_simulator(place)
        assert (simulator.version, simulator.klu) == FOUND[way]
    else:
        kind, says = OTHERS[way]
        with pytest.raises(kind, match=says) as caught:
            find_simulator(place)
        assert len(str(caught.value)) < 5000
    assert time.monotonic() - began < 30.0
    if way == "the version leaves a child":
        assert not is_running(process_id(tmp_path / "child"))
