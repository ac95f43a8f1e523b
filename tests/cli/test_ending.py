"""How a command ends: closed pipes, full disks, ASCII terminals and signals."""

from __future__ import annotations

import json
import os
import signal
import subprocess
import sys
import time
from pathlib import Path

import pytest

from tests.support.paths import SCENES
from tests.support.processes import is_running, process_id
from tests.support.running import python

TUNED = str(SCENES / "tuned-breadboard.toml")
CODE = "from taction.cli.main import main; main()"
VERIFY = ("verify", TUNED, "--engine", "statespace")
FULL = Path("/dev/full")  # of Linux
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


@pytest.mark.parametrize("words", [(*VERIFY, "--json"), ("netlist", TUNED), ("--help",)])
def test_a_closed_pipe_is_141(words: tuple[str, ...]) -> None:
    reader, writer = os.pipe()
    os.close(reader)
    done = python("-c", CODE, *words, stdout=writer, stderr=subprocess.PIPE)
    os.close(writer)
    assert done.returncode == 141
    assert "Traceback" not in done.stderr
    assert "Exception ignored" not in done.stderr


@pytest.mark.skipif(not FULL.exists(), reason="needs /dev/full")
@pytest.mark.parametrize("words", [VERIFY, ("--help",)])
def test_a_full_stdout_says_so(words: tuple[str, ...]) -> None:
    done = command(*words, redirect=f"> {FULL}")
    assert done.returncode == 3
    assert "taction: stdout cannot be written: No space left" in done.stderr  # after progress
    assert "Traceback" not in done.stderr


WRITTEN = ("netlist", TUNED, "-o", "a.cir")


@pytest.mark.parametrize(
    ("words", "status"), [(VERIFY, 0), (("verify", "none.toml"), 2), (("verify",), 2), (WRITTEN, 0)]
)
def test_a_closed_stderr_changes_no_status(
    words: tuple[str, ...], status: int, tmp_path: Path
) -> None:
    words = tuple(str(tmp_path / word) if word == "a.cir" else word for word in words)
    assert command(*words, redirect="2>&-").returncode == status
    assert (tmp_path / "a.cir").exists() == ("netlist" in words)


@pytest.mark.skipif(not FULL.exists(), reason="needs /dev/full")
@pytest.mark.parametrize(
    "words", [("verify", "none.toml"), (*VERIFY, "--changes", "0", "--set", FAILING)]
)
def test_messages_that_nobody_takes_make_no_pass(words: tuple[str, ...]) -> None:
    assert command(*words, redirect=f"2>{FULL}").returncode in (1, 2, 3)


def test_a_terminal_without_unicode_gets_a_verdict() -> None:
    done = command(*VERIFY, LC_ALL="C", PYTHONUTF8="0")
    assert done.returncode == 0, done.stderr
    assert done.stdout.rstrip().endswith("PASS")


def test_a_usage_error_is_a_document_too() -> None:
    done = command("verify", "--json")
    assert done.returncode == 2
    assert json.loads(done.stdout)["outcome"] == "bad input"
    assert "SCENE" in json.loads(done.stdout)["error"]["message"]
    assert "Missing argument" in done.stderr


SIMULATOR = """#!/bin/sh
[ "$1" = -v ] && echo "ngspice-46 with KLU" && exit
sleep 1000 &
echo $! > "{folder}/child"
echo $$ > "{folder}/process"
wait
"""


@pytest.mark.skipif(sys.platform != "linux", reason="ends with its parent on Linux only")
@pytest.mark.parametrize("name", ["SIGTERM", "SIGHUP", "SIGINT", "SIGKILL"])
def test_a_signal_ends_the_simulator(name: str, tmp_path: Path) -> None:
    number = getattr(signal, name)
    simulator, temporary = tmp_path / "ngspice", tmp_path / "temporary"
    simulator.write_text(SIMULATOR.format(folder=tmp_path))
    simulator.chmod(0o755)
    temporary.mkdir()
    parent = subprocess.Popen(
        [sys.executable, "-c", CODE, "verify", TUNED, "--engine", "ngspice"],
        stdout=subprocess.DEVNULL,
        stderr=subprocess.PIPE,
        text=True,
        env={
            **os.environ,
            "PYTHONPATH": str(SCENES.parent),
            "TACTION_NGSPICE": str(simulator),
            "TMPDIR": str(temporary),
        },
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


SWALLOWED = """
import os, signal, sys, time, weakref
from taction.cli.ending import run_command

class Thing:
    pass

def function():
    thing = Thing()
    reference = weakref.ref(thing, lambda _: os.kill(os.getpid(), signal.SIGTERM))
    del thing  # Python drops an exception of this callback
    time.sleep(60)

sys.exit(run_command(function, as_json=False))
"""
WRAPPED = """
import os, signal, sys
from taction.cli.ending import run_command

def function():
    try:
        os.kill(os.getpid(), signal.SIGTERM)
    except KeyboardInterrupt:
        raise ValueError("an error that holds the signal") from None

sys.exit(run_command(function, as_json=False))
"""
EXECUTED = """
import os, signal, sys
from taction.cli.ending import run_command
sys.exit(run_command(lambda: exec("os.kill(os.getpid(), signal.SIGINT)"), as_json=False))
"""


@pytest.mark.parametrize(
    ("code", "number"),
    [(SWALLOWED, signal.SIGTERM), (WRAPPED, signal.SIGTERM), (EXECUTED, signal.SIGINT)],
)
def test_no_signal_is_lost_on_its_way(code: str, number: int) -> None:
    done = python("-c", code)
    assert done.returncode == 128 + number
    assert done.stderr == "taction: interrupted; no verdict was reached\n"


def test_the_second_signal_does_not_stop_the_clean_up() -> None:
    code = """
import os, signal, sys, time
from taction.cli.ending import run_command

def function():
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
    done = python("-c", code)
    assert (done.returncode, done.stdout) == (130, "clean\n")


@pytest.mark.skipif(sys.platform != "linux", reason="needs ulimit -n")
@pytest.mark.parametrize("files", [5, 9])  # 4: not every Python can begin
def test_no_more_open_files_is_no_verdict_and_no_bug(files: int, tmp_path: Path) -> None:
    words = ("verify", TUNED, "--engine", "ngspice", "--json")
    done = command(*words, first=f"ulimit -n {files}", TMPDIR=str(tmp_path))
    assert done.returncode == 3
    assert "Too many open files" in done.stderr
    assert "Traceback" not in done.stderr


def test_the_end_of_a_command_looks_for_no_garbage() -> None:
    """What is registered first runs last: the objects are frozen by then."""
    seen = "print(gc.get_freeze_count() > 10_000)"
    code = f"import atexit, gc; atexit.register(lambda: {seen}); import taction.__main__"
    found = python("-c", code)
    assert found.returncode == 0, found.stderr
    assert found.stdout == "True\n"


@pytest.mark.skipif(sys.platform != "linux", reason="needs ulimit -v")
@pytest.mark.parametrize("megabytes", [100, 390])
def test_too_little_memory_is_no_verdict_in_one_sentence(megabytes: int) -> None:
    """At 100 MB OpenBLAS would end the process with 1, which is the status of a failed check."""
    done = command(*VERIFY, first=f"ulimit -v {megabytes * 1000}")
    assert done.returncode == 3
    assert len(done.stderr.splitlines()) == 1
    assert "the memory is limited to" in done.stderr
