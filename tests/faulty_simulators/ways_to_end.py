"""Ways to end, or not to end, and what a simulator leaves running."""

from __future__ import annotations

import os
import signal
import sys
import time
from collections.abc import Callable
from pathlib import Path

from tests.faulty_simulators.correct import good, write

MEGABYTES = 120  # on a stream that a program floods, before it waits
FOREVER = 1000.0  # s
HIDDEN = 0.8  # s: longer than the interval in which a run is looked at
NO_DC = """Note: Starting true gmin stepping
Warning: source stepping failed
Note: Transient op started
Error: The operating point could not be simulated successfully."""


def nothing() -> None:
    """Write nothing and end with exit status 0."""


def correct() -> None:
    """Do what was asked for."""
    write(good())


def says(text: str, status: int = 0, *, result: bool = True) -> Callable[[], None]:
    """Return a way: a good result (or none), `text` on the error stream, and an exit status."""

    def way() -> None:
        if result:
            write(good())
        os.write(2, text.encode("latin-1"))
        sys.exit(status)

    return way


def gives_up_late() -> None:
    """Open the result, work for a while without a first point, and give up."""
    write(b"")
    time.sleep(HIDDEN)
    says("doAnalyses: TRAN:  Timestep too small; time = 1e-9", 1, result=False)()


def ends_by(number: int) -> Callable[[], None]:
    """Return a way: a signal."""
    return lambda: os.kill(os.getpid(), number)


def waits() -> None:
    """Never end."""
    time.sleep(FOREVER)


def ignores_signals() -> None:
    """Never end, and ignore every signal that may be ignored."""
    for number in (signal.SIGTERM, signal.SIGINT, signal.SIGHUP):
        signal.signal(number, signal.SIG_IGN)
    waits()


def floods(stream: int) -> Callable[[], None]:
    """Return a way: many lines on a stream, and then no end."""

    def way() -> None:
        block = b"noise noise noise noise noise noise\n" * 30_000
        for _ in range(MEGABYTES):
            os.write(stream, block)
        waits()

    return way


def floods_result() -> None:
    """Write a result that never ends."""
    with open("out.raw", "wb") as file:  # noqa: PTH123
        floods(file.fileno())()


def leaves(*, session: bool, clean: bool = False, first: Callable[[], None]) -> Callable[[], None]:
    """Return a way: `first`, and the end of the program but not of its child.

    The child may have a session of its own. A child that is `clean` also has another environment
    and another folder than the simulator. Its process id is in ``$FAULTY_FOLDER/child``.
    """

    def way() -> None:
        first()
        file = Path(os.environ["FAULTY_FOLDER"]) / "child"
        if os.fork():
            while not file.exists():
                time.sleep(0.001)
            return
        if session:
            os.setsid()
        write(f"{os.getpid()}\n".encode(), f"{file}.part")
        os.rename(f"{file}.part", file)  # noqa: PTH104
        if clean:
            os.chdir("/")
            os.execve("/bin/sleep", ["sleep", str(FOREVER)], {})  # noqa: S606
        waits()

    return way


def closes_streams() -> None:
    """Close stdin, stdout and stderr, and then do what was asked for."""
    for stream in (0, 1, 2):
        os.close(stream)
    correct()


ENDS: dict[str, Callable[[], None]] = {
    "correct": correct,
    "no result": nothing,
    "exit status 1 with a result": says("", 1),
    "exit status 255": says("", 255),
    "exit status of a shell for a signal": says("Segmentation fault", 139, result=False),
    "exit status of a shell for no program": says("sh: 1: ngspice: not found", 127, result=False),
    "segmentation fault": ends_by(signal.SIGSEGV),
    "abort": ends_by(signal.SIGABRT),
    "killed for want of memory": ends_by(signal.SIGKILL),
    "a signal without a name": ends_by(signal.SIGRTMIN + 3),
    "hangs": waits,
    "hangs and ignores signals": ignores_signals,
    "floods stdout": floods(1),
    "floods stderr": floods(2),
    "floods its result": floods_result,
    "closes its streams": closes_streams,
    "leaves a child": leaves(session=False, first=correct),
    "leaves a daemon": leaves(session=True, first=correct),
    "leaves a daemon and no result": leaves(session=True, first=nothing),
    "leaves a daemon without traces": leaves(session=True, clean=True, first=correct),
    "an error beside a result": says("Error: something happened"),
    "step too small": says("doAnalyses: TRAN:  Timestep too small; time = 1e-9", 1),
    "step too small before the first point": gives_up_late,
    "singular matrix": says(f"Warning: singular matrix:  check node a\n{NO_DC}", 1, result=False),
    "no operating point": says(NO_DC, 1, result=False),
    "noise": says("The licence of ACME Simulator ends in 3 days\nNote: have a nice day\n"),
    "noise that is no text": says("".join(map(chr, range(128, 256)))),
}
