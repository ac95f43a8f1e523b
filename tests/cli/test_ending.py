"""How a command ends: closed pipes, full disks, ASCII terminals and signals."""

from __future__ import annotations

import os
import signal
import subprocess
import sys
import time
from pathlib import Path
from typing import Any

import pytest

from tests.support import nightly
from tests.support.paths import SCENES
from tests.support.running import is_running, process_id, python

TUNED = str(SCENES / "tuned-breadboard.toml")
CODE = "from taction.cli.main import main; main()"
VERIFY = ("verify", TUNED, "--engine", "statespace")
FAILING = "checks.settling_time.max=1ns"


def command(
    *words: str, first: str = ":", redirect: str = "", **variables: str
) -> subprocess.CompletedProcess[str]:
    """Run taction as a process; `first` stands before it in the shell, `redirect` behind it."""
    line = f'{first}; exec "$0" "$@" {redirect}'
    return subprocess.run(
        ["bash", "-c", line, sys.executable, "-c", CODE, *words],
        capture_output=True,
        text=True,
        check=False,
        timeout=120.0,
        env={**os.environ, "PYTHONPATH": str(SCENES.parent), "PYTHONUNBUFFERED": "", **variables},
    )


@pytest.mark.parametrize("words", [(*VERIFY, "--json"), ("--help",)])
def test_a_closed_pipe_is_141(words: tuple[str, ...]) -> None:
    reader, writer = os.pipe()
    os.close(reader)
    done = python("-c", CODE, *words, stdout=writer, stderr=subprocess.PIPE)
    os.close(writer)
    assert done.returncode == 141
    assert "Traceback" not in done.stderr
    assert "Exception ignored" not in done.stderr


# Words, what stands behind or before them in the shell, the statuses that are right, what is said.
NGSPICE = ("verify", TUNED, "--engine", "ngspice")
FULL, CLOSED, DEAF = {"redirect": ">/dev/full"}, {"redirect": "2>&-"}, {"redirect": "2>/dev/full"}
NO_SPACE, NO_FILES = "taction: stdout cannot be written: No space left", "Too many open files"
MACHINES: list[Any] = [
    (VERIFY, FULL, (3,), NO_SPACE),  # after progress
    (VERIFY, CLOSED, (0,), ""),
    (("verify", "none.toml"), CLOSED, (2,), ""),
    (("verify", "none.toml"), DEAF, (2, 3), ""),
    (VERIFY, {"LC_ALL": "C", "PYTHONUTF8": "0"}, (0,), ""),
    (NGSPICE, {"first": "ulimit -n 9"}, (3,), NO_FILES),
    # At 100 MB OpenBLAS would end the process with 1, which is the status of a failed check.
    (VERIFY, {"first": "ulimit -v 100000"}, (3,), "the memory is limited to"),
    *nightly(
        (("netlist", TUNED, "-o", "a.cir"), CLOSED, (0,), ""),
        ((*VERIFY, "--changes", "0", "--set", FAILING), DEAF, (1, 3), ""),
    ),
]


@pytest.mark.skipif(sys.platform != "linux", reason="needs /dev/full and ulimit")
@pytest.mark.parametrize(("words", "machine", "right", "says"), MACHINES)
def test_a_bad_machine_makes_no_pass_and_no_bug(
    words: tuple[str, ...], machine: dict[str, str], right: tuple[int, ...], says: str,
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch,
) -> None:  # fmt: skip
    monkeypatch.chdir(tmp_path)
    done = command(*words, **machine)
    assert done.returncode in right, done.stderr
    assert says in done.stderr
    assert "Traceback" not in done.stderr
    assert Path("a.cir").exists() == ("a.cir" in words)
    if done.returncode == 0 and "verify" in words:
        assert done.stdout.rstrip().endswith("PASS")
    if "memory" in says:
        assert len(done.stderr.splitlines()) == 1


SIMULATOR = """#!/bin/sh
[ "$1" = -v ] && echo "ngspice-46 with KLU" && exit
sleep 1000 &
echo $! > "{folder}/child"
echo $$ > "{folder}/process"
wait
"""


@pytest.mark.skipif(sys.platform != "linux", reason="ends with its parent on Linux only")
@pytest.mark.parametrize("name", ["SIGINT", "SIGKILL", *nightly("SIGTERM", "SIGHUP")])
def test_a_signal_ends_the_simulator(name: str, tmp_path: Path) -> None:
    number = getattr(signal, name)
    simulator, temporary = tmp_path / "ngspice", tmp_path / "temporary"
    simulator.write_text(SIMULATOR.format(folder=tmp_path))
    simulator.chmod(0o755)
    temporary.mkdir()
    places = {"TACTION_NGSPICE": str(simulator), "TMPDIR": str(temporary)}
    parent = subprocess.Popen(
        [sys.executable, "-c", CODE, "verify", TUNED, "--engine", "ngspice"],
        stdout=subprocess.DEVNULL,
        stderr=subprocess.PIPE,
        text=True,
        env={**os.environ, "PYTHONPATH": str(SCENES.parent), **places},
    )
    try:
        child, leader = (process_id(tmp_path / file) for file in ("child", "process"))
        time.sleep(0.2)  # until the command waits
        parent.send_signal(number)
        _, errors = parent.communicate(timeout=60.0)
    finally:
        parent.kill()
    assert not is_running(leader)
    if number == signal.SIGKILL:  # nobody is left to end the simulator's own children
        os.kill(child, signal.SIGKILL)
        return
    assert parent.returncode == 128 + number
    assert "interrupted; no verdict was reached" in errors
    assert not is_running(child)
    assert list(temporary.iterdir()) == []


HEAD = """
import os, signal, sys, time, weakref
from taction.cli.main import run_command
def function():
"""
END = "\nsys.exit(run_command(function, as_json=False))\n"
SWALLOWED = """
    thing = type("Thing", (), {})()
    reference = weakref.ref(thing, lambda _: os.kill(os.getpid(), signal.SIGTERM))
    del thing  # Python drops an exception of this callback
    time.sleep(60)
"""
WRAPPED = """
    try:
        os.kill(os.getpid(), signal.SIGTERM)
    except KeyboardInterrupt:
        raise ValueError("an error that holds the signal") from None
"""
EXECUTED = "    exec('os.kill(os.getpid(), signal.SIGINT)')"


@pytest.mark.parametrize(
    ("code", "number"),
    [(SWALLOWED, signal.SIGTERM), (WRAPPED, signal.SIGTERM), (EXECUTED, signal.SIGINT)],
)
def test_no_signal_is_lost_on_its_way(code: str, number: int) -> None:
    done = python("-c", HEAD + code + END)
    assert done.returncode == 128 + number
    assert done.stderr == "taction: interrupted; no verdict was reached\n"


def test_the_second_signal_does_not_stop_the_clean_up() -> None:
    code = """
    try:
        os.kill(os.getpid(), signal.SIGINT)
    finally:
        os.kill(os.getpid(), signal.SIGINT)
        time.sleep(0.1)
        print("clean")
status = run_command(function, as_json=False)
os.kill(os.getpid(), signal.SIGINT)
sys.exit(status)
"""
    done = python("-c", HEAD + code)
    assert (done.returncode, done.stdout) == (130, "clean\n")
