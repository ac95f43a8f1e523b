"""Every way in which a simulator fails has a typed outcome, and a message that helps."""

from __future__ import annotations

import os
import shutil
import sys
import time
from pathlib import Path

import numpy as np
import pytest

from taction.system.errors import (
    BadEvidence,
    Killed,
    OutOfDisk,
    SimulationError,
    SimulatorNotFound,
    StepTooSmall,
    TimedOut,
)
from taction.system.waveforms import Waveforms
from taction.verification.engines.ngspice import process
from taction.verification.engines.ngspice.process import simulate
from tests.faulty_simulators.installed import installed
from tests.faulty_simulators.ways import RUNS
from tests.support.processes import is_running, process_id
from tests.support.small_decks import transient

DECK = transient(saved=("out", "in"), stop=1e-6, step=1e-8)
SOON, LATE = 1.0, 60.0  # s: the timeout where the program never ends, and else
LINUX = pytest.mark.skipif(sys.platform != "linux", reason="reads /proc")

REFUSED: dict[str, tuple[type[SimulationError], str]] = {
    "no result": (BadEvidence, r"out\.raw was never written"),
    "exit status 1 with a result": (BadEvidence, "ended with exit status 1 and gave no reason"),
    "exit status of a shell for a signal": (Killed, "SIGSEGV"),
    "exit status of a shell for no program": (SimulatorNotFound, r"exit status 127.*Install"),
    "segmentation fault": (Killed, r"signal SIGSEGV ended ngspice after .* s"),
    "abort": (Killed, "signal SIGABRT"),
    "a signal without a name": (Killed, "signal [0-9]+ ended ngspice"),
    "hangs and ignores signals": (TimedOut, "did not finish within 1 s"),
    "slow": (TimedOut, "did not finish within 1 s"),
    "leaves a daemon and no result": (BadEvidence, "never written"),
    "an error beside a result": (BadEvidence, r"reported an error(?s:.*)something happened"),
    "step too small": (StepTooSmall, "tolerances are below rounding noise"),
    "step too small before the first point": (StepTooSmall, "below the simulator's limit"),
    "result completed by a child": (OutOfDisk, "holds [0-9]+ of [0-9]+ bytes"),
    "result elsewhere": (BadEvidence, "never written: No such file"),
    "data cut": (OutOfDisk, r"holds 11987 of 12000 bytes.*\. Free space"),
    "not a number": (BadEvidence, r"not a number, at 1 nodes: v\(in\) nan V"),
    "the error stream becomes a pipe": (BadEvidence, r"error stream.*stderr\.txt: not a regular"),
    "the folder is removed": (BadEvidence, r"error stream.*stderr\.txt: No such file"),
    "result is a pipe": (BadEvidence, "not a regular file"),
    "result is a folder": (BadEvidence, "not a regular file"),
    "result is a device": (BadEvidence, "not a regular file"),
    "result is a loop of links": (BadEvidence, "symbolic links"),
    "result cannot be read": (BadEvidence, "Permission denied"),
}
WAITING = {"hangs and ignores signals", "slow"}
ACCEPTED = (
    "correct",
    "closes its streams",
    "leaves a child",
    "leaves a daemon",
    "leaves a daemon without traces",
    "the deck is removed",
    "noise that is no text",
)
FLOODS = ("floods stdout", "floods stderr", "floods its result")
LEFT = ("leaves a child", "leaves a daemon", "leaves a daemon and no result")


def test_every_way_has_an_outcome() -> None:
    assert set(RUNS) == set(REFUSED) | set(ACCEPTED) | set(FLOODS)
    assert not set(REFUSED) & set(ACCEPTED)


@pytest.mark.parametrize("way", REFUSED)
def test_refused(way: str, tmp_path: Path) -> None:
    if way == "result cannot be read" and os.geteuid() == 0:
        pytest.skip("root may read everything")
    kind, says = REFUSED[way]
    timeout, folder = SOON if way in WAITING else LATE, tmp_path / "run"
    with pytest.raises(kind, match=says) as caught:
        simulate(DECK, installed(tmp_path, way), timeout=timeout, folder=folder)
    assert type(caught.value) is kind
    assert caught.value.exit_status == 3
    assert caught.value.folder == folder
    assert "`sh command.txt` in this folder repeats the run" in str(caught.value)


@pytest.mark.parametrize("way", ACCEPTED)
def test_accepted(way: str, tmp_path: Path) -> None:
    waveforms = simulate(DECK, installed(tmp_path, way), timeout=LATE, folder=tmp_path / "run")
    line = waveforms.time / 1e-6  # the straight lines that a correct program computes
    assert waveforms.nodes == DECK.saved
    np.testing.assert_allclose(waveforms.values, np.column_stack([line, 1.0 + line]))
    assert not (tmp_path / "run").exists()
    if way == "leaves a daemon without traces":
        os.kill(process_id(tmp_path / "child"), 9)  # nothing says whose it is


@LINUX
@pytest.mark.parametrize("way", LEFT)
def test_nothing_goes_on(way: str, tmp_path: Path) -> None:
    try:
        simulate(DECK, installed(tmp_path, way), timeout=LATE, folder=tmp_path / "run")
    except BadEvidence:
        assert way == "leaves a daemon and no result"
    assert not is_running(process_id(tmp_path / "child"))


def test_a_slow_run_brings_its_first_points(tmp_path: Path) -> None:
    with pytest.raises(TimedOut) as caught:
        simulate(DECK, installed(tmp_path, "slow"), timeout=SOON, folder=tmp_path / "run")
    assert isinstance(caught.value.partial, Waveforms)
    assert len(caught.value.partial.time) == 250


@LINUX
@pytest.mark.parametrize("way", FLOODS)
def test_a_flood_ends_long_before_the_timeout(
    way: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(process, "LONGEST_RESULT", 100_000_000)
    began = time.monotonic()
    with pytest.raises(SimulationError):
        simulate(DECK, installed(tmp_path, way), timeout=600.0, folder=tmp_path / "run")
    assert time.monotonic() - began < 120.0
    sizes = {file.name: file.stat().st_size for file in (tmp_path / "run").iterdir()}
    assert max(sizes.values()) == 100_000_000
    shutil.rmtree(tmp_path / "run")
