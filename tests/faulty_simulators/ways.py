"""Ways in which a simulator fails to end, leaves something running, or writes a wrong result.

What the bytes of a result file decide is tested without a process: `tests/system/test_raw_file.py`
and `tests/verification/engines/ngspice/test_evidence.py`.
"""

from __future__ import annotations

import math
import os
import shutil
import signal
import sys
import time
from collections.abc import Callable
from pathlib import Path

from tests.faulty_simulators.correct import good, raw_file, requested, straight_lines, write

Way = Callable[[], None]
MEGABYTES = 120  # on a stream that a program floods, before it waits
FOREVER = 1000.0  # s
HIDDEN = 0.8  # s: longer than the interval in which a run is looked at


def nothing() -> None:
    """Write nothing and end with exit status 0."""


def correct() -> None:
    """Do what was asked for."""
    write(good())


def says(text: str, status: int = 0, *, result: bool = True) -> Way:
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


def ends_by(number: int) -> Way:
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


def floods(stream: int) -> Way:
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


def leaves(*, session: bool, clean: bool = False, first: Way) -> Way:
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


def with_no_number() -> None:
    """Write a result with one voltage that is no number."""
    vectors, stop = requested()
    rows = straight_lines(len(vectors), stop)
    rows[len(rows) // 2][-1] = math.nan
    write(raw_file(vectors, rows))


def slowly() -> None:
    """Write half of the points, as ngspice does during a run, and go on for ever."""
    head, mark, data = good().partition(b"Binary:\n")
    write(head.replace(b"Points: 500", b"Points: 0") + mark + data[: len(data) // 2])
    waits()


def by_a_child() -> None:
    """End with half of the result, which a child completes later."""
    content = good()
    write(content[: len(content) // 2])
    if os.fork() == 0:
        time.sleep(0.3)
        write(content)


def elsewhere() -> None:
    """Write the result in another folder."""
    Path("results").mkdir()
    write(good(), "results/out.raw")


def without(name: str) -> Way:
    """Return a way: the right result, and no file or pipe where the run has a file."""

    def way() -> None:
        write(good())
        Path(name).unlink()
        if name == "stderr.txt":
            os.mkfifo(name)

    return way


def linked(target: str) -> Way:
    """Return a way: the result is a symbolic link."""
    return lambda: Path("out.raw").symlink_to(target)


def unreadable() -> None:
    """Write a result that nobody may read."""
    write(good())
    Path("out.raw").chmod(0)


RUNS: dict[str, Way] = {
    "correct": correct,
    "no result": nothing,
    "exit status 1 with a result": says("", 1),
    "exit status of a shell for a signal": says("Segmentation fault", 139, result=False),
    "exit status of a shell for no program": says("sh: 1: ngspice: not found", 127, result=False),
    "segmentation fault": ends_by(signal.SIGSEGV),
    "abort": ends_by(signal.SIGABRT),
    "a signal without a name": ends_by(signal.SIGRTMIN + 3),
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
    "noise that is no text": says("".join(map(chr, range(128, 256)))),
    "slow": slowly,
    "result completed by a child": by_a_child,
    "result elsewhere": elsewhere,
    "data cut": lambda: write(good()[:-13]),
    "not a number": with_no_number,
    "the deck is removed": without("deck.cir"),
    "the error stream becomes a pipe": without("stderr.txt"),
    "the folder is removed": lambda: shutil.rmtree(Path.cwd()),
    "result is a pipe": lambda: os.mkfifo("out.raw"),
    "result is a folder": lambda: Path("out.raw").mkdir(),
    "result is a device": linked("/dev/zero"),
    "result is a loop of links": linked("out.raw"),
    "result cannot be read": unreadable,
}
