"""A simulator that fails in one way: ``python -m tests.faulty_simulators.ways WAY`` and ngspice's
words, which are ``-v`` or a deck.

It imports nothing of taction, so that it starts in milliseconds. What the bytes of a result file
decide is tested without a process: `tests/system/test_raw_file.py` and
`tests/verification/engines/ngspice/test_evidence.py`.
"""

from __future__ import annotations

import os
import re
import shutil
import signal
import struct
import sys
import time
from collections.abc import Callable
from pathlib import Path

Way = Callable[[], None]
POINTS = 500
MEGABYTES = 120  # on a stream that a program floods, before it waits
FOREVER = 1000.0  # s
LATER = 30.0  # s: longer than a busy machine takes to see that the program has ended
HIDDEN = 0.8  # s: longer than the interval in which a run is looked at
TOO_SMALL = "doAnalyses: TRAN:  Timestep too small; time = 1e-9"


def good() -> bytes:
    """Return the right result for the deck of this folder: voltage k is ``k + time / stop``."""
    text = Path("deck.cir").read_text()
    saved = re.search(r"^\.save (.*)$", text, re.MULTILINE)
    stop = re.search(r"^\.tran \S+ (\S+)", text, re.MULTILINE)
    if saved is None or stop is None:
        sys.exit("this deck asks for nothing that the program understands")
    vectors = [("time", "time"), *((name, "voltage") for name in saved[1].split())]
    shares = [index / (POINTS - 1) for index in range(POINTS)]
    rows = [[x * float(stop[1]), *(k + x for k in range(len(vectors) - 1))] for x in shares]
    lines = [
        *("Title: board", "Plotname: Transient Analysis", "Flags: real"),
        *(f"No. Variables: {len(vectors)}", f"No. Points: {POINTS}", "Variables:"),
        *(f"\t{index}\t{name}\t{kind}" for index, (name, kind) in enumerate(vectors)),
        *("Binary:", ""),
    ]
    data = b"".join(struct.pack(f"<{len(row)}d", *row) for row in rows)
    return "\n".join(lines).encode() + data


def write(content: bytes | None = None, name: str = "out.raw") -> None:
    """Write a file of this folder in one go; without `content` the right result."""
    with open(name, "wb", buffering=0) as file:  # noqa: PTH123
        file.write(good() if content is None else content)


def says(text: str, status: int = 0, *, stream: int = 2, result: bool = True) -> Way:
    """Return a way: a good result (or none), `text` on a stream, and an exit status."""

    def way() -> None:
        if result:
            write()
        os.write(stream, text.encode("latin-1"))
        sys.exit(status)

    return way


def ends_by(number: int) -> Way:
    """Return a way: a signal."""
    return lambda: os.kill(os.getpid(), number)


def waits() -> None:
    """Never end, and ignore every signal that may be ignored."""
    for number in (signal.SIGTERM, signal.SIGINT, signal.SIGHUP):
        signal.signal(number, signal.SIG_IGN)
    time.sleep(FOREVER)


def floods(stream: int | str) -> Way:
    """Return a way: many lines on a stream or into a file, and then no end."""

    def way() -> None:
        number = os.open(stream, os.O_WRONLY | os.O_CREAT) if isinstance(stream, str) else stream
        block = b"noise noise noise noise noise noise\n" * 30_000
        for _ in range(MEGABYTES):
            os.write(number, block)
        waits()

    return way


def leaves(first: Way, *, session: bool = True, clean: bool = False) -> Way:
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


def gives_up_late() -> None:
    """Open the result, work for a while without a first point, and give up."""
    write(b"")
    time.sleep(HIDDEN)
    says(TOO_SMALL, 1, result=False)()


def closes_streams() -> None:
    """Close stdin, stdout and stderr, and then do what was asked for."""
    for stream in (0, 1, 2):
        os.close(stream)
    write()


def slowly() -> None:
    """Write half of the points, as ngspice does during a run, and go on for ever."""
    head, mark, data = good().partition(b"Binary:\n")
    write(head.replace(b"Points: 500", b"Points: 0") + mark + data[: len(data) // 2])
    waits()


def by_a_child() -> None:
    """End with half of the result; a child would complete it much later."""
    content = good()
    write(content[: len(content) // 2])
    if os.fork() == 0:
        time.sleep(LATER)
        write(content)


RUNS: dict[str, Way] = {
    "correct": write,
    "no result": lambda: None,
    "exit status of a shell for a signal": says("Segmentation fault", 139, result=False),
    "exit status of a shell for no program": says("sh: 1: ngspice: not found", 127, result=False),
    "abort": ends_by(signal.SIGABRT),
    "a signal without a name": ends_by(signal.SIGRTMIN + 3),
    "hangs and ignores signals": waits,
    "floods stderr": floods(2),
    "floods its result": floods("out.raw"),
    "closes its streams": closes_streams,
    "leaves a child": leaves(write, session=False),
    "leaves a daemon": leaves(write),
    "leaves a daemon without traces": leaves(write, clean=True),
    "step too small before the first point": gives_up_late,
    "noise that is no text": says("".join(map(chr, range(128, 256)))),
    "slow": slowly,
    "result completed by a child": by_a_child,
    "the folder is removed": lambda: shutil.rmtree(Path.cwd()),
    "result is a pipe": lambda: os.mkfifo("out.raw"),
    "result is a device": lambda: Path("out.raw").symlink_to("/dev/zero"),
}


def answers(text: str) -> Way:
    """Return a way: a text on stdout."""
    return says(text, stream=1, result=False)


USUAL = "** ngspice-46 : Circuit level simulation program\n** Compiled with KLU Direct"
VERSIONS: dict[str, Way] = {
    "version 39": answers("** ngspice-39.3 : Circuit level simulation program"),
    "version 38": answers("** ngspice-38 : Circuit level simulation program"),
    "another program": answers("Spice Opus 3.0"),
    "the version floods": floods(1),
    "the version hangs": waits,
    "the version leaves a child": leaves(lambda: print(USUAL, flush=True), session=False),
}

if __name__ == "__main__":
    way = VERSIONS.get(sys.argv[1], answers(USUAL)) if "-v" in sys.argv else RUNS[sys.argv[1]]
    way()
