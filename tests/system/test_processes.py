"""Temporary folders: locked while in use, cleared by the next process after a kill."""

from __future__ import annotations

import os
import signal
import subprocess
import sys
import time
from pathlib import Path

import pytest

from taction.system import processes
from taction.system.processes import clear_abandoned, make_own_folder, own_folder
from tests.support.running import is_running

OWNER = """
import sys, time
from taction.system.processes import make_own_folder
print(make_own_folder(sys.argv[1]), flush=True)
time.sleep(600)
"""


def owner(place: Path) -> tuple[subprocess.Popen[str], Path]:
    words = [sys.executable, "-c", OWNER, str(place)]
    process = subprocess.Popen(words, stdout=subprocess.PIPE, text=True)
    assert process.stdout is not None
    return process, Path(process.stdout.readline().rstrip("\n"))


def test_a_folder_stays_while_its_process_lives_and_goes_after_a_kill(tmp_path: Path) -> None:
    process, folder = owner(tmp_path)
    try:
        (folder / "file").write_text("half")
        clear_abandoned(tmp_path)
        assert folder.is_dir()
    finally:
        process.kill()
        process.communicate()
    clear_abandoned(tmp_path)
    assert not list(tmp_path.iterdir())


def test_what_is_not_ours_stays(tmp_path: Path) -> None:
    place = tmp_path / "place"
    place.mkdir()
    foreign = place / "taction-run-foreign"
    foreign.mkdir()
    elsewhere = tmp_path / "elsewhere"
    elsewhere.mkdir()
    (place / "taction-run-link").symlink_to(elsewhere)
    (place / "taction-run-file").touch()
    (place / "pymp-other").mkdir()
    (place / "taction-kept-told").mkdir()
    if os.geteuid() == 0:
        os.chown(foreign, 65534, 65534)
    clear_abandoned(place)
    left = {path.name for path in place.iterdir()}
    names = {"taction-run-link", "taction-run-file", "pymp-other", "taction-kept-told"}
    assert left == (names | {foreign.name} if os.geteuid() == 0 else names)
    assert elsewhere.is_dir()


def test_the_folder_of_a_block_goes_with_all_that_is_in_it() -> None:
    with own_folder() as folder:
        (folder / "within").mkdir()
        (folder / "within" / "file").touch()
    assert not folder.exists()


def test_a_folder_that_another_process_clears_before_the_lock_is_made_again(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    made: list[str] = []
    make = processes.tempfile.mkdtemp

    def cleared(**where: str) -> str:
        made.append(make(**where))
        if len(made) == 1:
            Path(made[0]).rmdir()
        return made[-1]

    monkeypatch.setattr(processes.tempfile, "mkdtemp", cleared)
    assert str(make_own_folder(tmp_path)) == made[1] != made[0]


@pytest.mark.skipif(sys.platform != "linux", reason="needs /proc")
def test_processes_of_an_abandoned_folder_are_ended_and_no_others(tmp_path: Path) -> None:
    process, folder = owner(tmp_path)
    inside, outside = (
        subprocess.Popen(
            ["sleep", "600"], env={"PATH": os.environ["PATH"], "HOME": home}, start_new_session=True
        )
        for home in (f"{folder}/run", f"{folder}-other")
    )
    try:
        process.kill()
        process.communicate()
        clear_abandoned(tmp_path)
        assert inside.wait(60) == -signal.SIGKILL
        time.sleep(0.1)
        assert outside.poll() is None
        assert is_running(outside.pid)
    finally:
        for each in (process, inside, outside):
            each.kill()
            each.wait()
    assert not folder.exists()
