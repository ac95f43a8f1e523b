"""Five users, each in an empty folder: a few commands, and the sentence that must come out.

Every command runs in a pseudo terminal, once of 80 by 24 and once of 120 by 40.
"""

from __future__ import annotations

import fcntl
import os
import pty
import re
import shutil
import struct
import subprocess
import sys
import termios
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import pytest

from tests.support.paths import ROOT

CONTROL = re.compile(r"\x1b\[(\??[\d;]*)([A-Za-z])|\r|\n|[^\x1b\r\n]+")
TIMEOUT = 120.0  # s
CASES = ROOT / "tests" / "data" / "cases"
SIZES = ((80, 24), (120, 40))
SEARCH = "what to change, at most"
NEVER = ("Traceback", "this is a bug", "Input should be")


@dataclass(frozen=True, slots=True)
class Session:
    """What a command did."""

    status: int
    raw: str  # all that it wrote, with the controls of the terminal
    lines: list[str]  # what it left, without what it took away again, as a bar


def run_in_terminal(
    words: Sequence[str], folder: Path, columns: int = 80, rows: int = 24, **variables: str
) -> Session:
    """Run a command in a folder with stdin, stdout and stderr on a pseudo terminal."""
    ours, theirs = pty.openpty()
    fcntl.ioctl(theirs, termios.TIOCSWINSZ, struct.pack("HHHH", rows, columns, 0, 0))
    kept = {name: text for name, text in os.environ.items() if name not in ("COLUMNS", "LINES")}
    run = subprocess.Popen(
        list(words),
        cwd=folder,
        env=kept | {"TERM": "xterm-256color"} | variables,
        stdin=theirs,
        stdout=theirs,
        stderr=theirs,
    )
    os.close(theirs)
    parts = []
    try:
        while part := os.read(ours, 65536):
            parts.append(part)
    except OSError:  # the command has ended: Linux says so by an error
        pass
    finally:
        os.close(ours)
    status = run.wait(TIMEOUT)
    raw = b"".join(parts).decode("utf-8")
    return Session(status, raw, left_on_screen(raw))


def left_on_screen(raw: str) -> list[str]:
    """Return the lines that stay: a line that is erased or written again is gone.

    Examples
    --------
    >>> left_on_screen("1 of 2\\r\\x1b[2Kdone\\r\\n\\x1b[1mPASS\\x1b[0m\\r\\n")
    ['done', 'PASS']
    """
    lines, row, column = [""], 0, 0
    for found in CONTROL.finditer(raw):
        text, number, letter = found[0], found[1], found[2]
        if text == "\n":
            row += 1
            lines += [""] * (row + 1 - len(lines))
        elif text == "\r":
            column = 0
        elif letter == "A":
            row = max(row - int(number or 1), 0)
        elif letter == "K":
            lines[row] = "" if number == "2" else lines[row][:column]
        elif letter is None:
            line = lines[row].ljust(column)
            lines[row] = line[:column] + text + line[column + len(text) :]
            column += len(text)
    shown = [line.rstrip() for line in lines]
    while shown and not shown[-1]:
        shown.pop()
    return shown


@dataclass(frozen=True)
class Step:
    """A command, what it must say (patterns, between any blanks and breaks), and its exit status.

    The last pattern of the last step is of one of the last lines, which the screen still shows.
    """

    command: str
    sentences: tuple[str, ...] = ()
    status: int = 0


NEW = Step("taction new board.toml")
BUILT = (
    r"within [\d.]+ % of the step, 95 % of built boards within [\d.]+ % \(resistors 1 %, op-amp"
    r" gains 50 %(, op-amp input errors; the check counts only the last|; the check counts none of"
    r" these)\)"
)
LAMBDA = r"because of regularisation.*; a smaller lambda regularises less, but lets more noise "
USERS = {
    "designer": (
        NEW,
        Step(
            "taction verify board.toml --set design.opamp=lm324 --engine statespace --changes 100",
            (r"^FAIL: board: rests up to [\d.]+ % off the reference in 95 % of the boards",),
            1,
        ),
        Step(
            "taction verify slew-ua741.toml --engine statespace",
            (r"headroom slew rate counts, as simulated: would need [\d.]+ V/us of 0\.5",),
        ),
        Step(
            "taction verify board.toml --engine statespace",
            (
                r"settling to ±4 % [\d.]+ us",
                BUILT,
                LAMBDA,
                r"^PASS: board, \d+ checks; nearest to its limit: .*\d %",
            ),
        ),
    ),
    "researcher": (
        NEW,
        Step("taction solve board.toml"),
        Step(
            "taction onset board.toml --over C --no-confirm",
            (r"Stable for C: [\d.]+ pF to 3 nF\.",),
        ),
        Step(
            "taction sweep board.toml --over C=20pF:500pF:3 --engine statespace --jobs 1",
            (r"settling time to ±4 %", r"^3 computed now, 0 from board\.sqlite$"),
        ),
    ),
    "CI engineer": (
        NEW,
        Step("taction regress . --baseline baseline.json --update --jobs 1"),
        Step("taction regress . --baseline baseline.json --jobs 1"),
        Step("taction verify . --junit report.xml --jobs 1"),
        Step(
            "taction regress failing --baseline failing.json --update --jobs 1",
            (r"Not stored, a check fails: slew\.toml\.",),
            1,
        ),
        Step(
            "taction diff board.toml board.toml --engine statespace",
            (r"readings: \d+ equal, 0 within their uncertainties, 0 beyond",),
        ),
    ),
    "student": (
        Step("taction"),
        Step(
            "taction demo",
            (
                BUILT,
                r"a smaller lambda regularises less, .* noise",
                r"Your own board: taction new board\.toml",
            ),
        ),
    ),
    "SPICE user": (
        Step(
            "taction check ldo.cir --no-ngspice",
            (
                r"Not stable: oscillates at 559\.4 kHz, growing with 364 k/s",
                r"Nearest stable value: Cout above 2\.773 uF \(now 1 uF, factor 2\.773\)",
            ),
            1,
        ),
        Step(
            "taction check wienosc.cir --no-ngspice --check oscillates",
            (r"Oscillates at 1\.59 kHz, growing with 500 /s\. The check passes\.",),
        ),
        NEW,
        Step("taction netlist board.toml -o board.cir"),
        Step("ngspice -b -r board.raw board.cir", (r"No\. of Data Rows : \d+",)),
    ),
}
"""What each types."""
FILES = {
    "designer": ("slew-ua741.toml", "slew-ua741-T.csv", "slew-ua741-eps.csv", "slew-ua741-f.csv"),
    "CI engineer": ("failing/slew.toml", "failing/slew-T.csv", "failing/slew-eps.csv"),
    "SPICE user": ("ldo.cir", "wienosc.cir"),
}
"""What each has in the folder at the start, from `CASES`."""
MOST = {"designer": 4, "researcher": 4, "CI engineer": 6, "student": 2, "SPICE user": 5}


def typed(command: str, folder: Path, size: tuple[int, int], **variables: str) -> Session:
    """Run a command line as it is typed, with this taction."""
    name, *words = command.split()
    if name == "taction":
        start = [sys.executable, "-c", "from taction.cli.main import main; main()"]
    else:
        start = [shutil.which(name) or name]
    return run_in_terminal([*start, *words], folder, *size, PYTHONPATH=str(ROOT), **variables)


# Each user in one size with every commit; in the other one nightly.
TERMINALS = [
    pytest.param(name, size, marks=[pytest.mark.nightly] * (k % 2 != place))
    for k, name in enumerate(USERS)
    for place, size in enumerate(SIZES)
]


@pytest.mark.usefixtures("ngspice")
@pytest.mark.parametrize(("name", "size"), TERMINALS, ids=str)
def test_a_user_comes_to_the_end(name: str, size: tuple[int, int], tmp_path: Path) -> None:
    steps = USERS[name]
    assert len(steps) <= MOST[name]
    for file in FILES.get(name, ()):
        place = tmp_path / file
        place.parent.mkdir(exist_ok=True)
        shutil.copy(CASES / place.name, place)
    for step in steps:
        done = typed(step.command, tmp_path, size)
        assert done.status == step.status, "\n".join(done.lines)
        assert [word for word in NEVER if word in done.raw] == []
        if "--changes" in step.command:  # the verdict stands there before the search begins
            assert "FAIL: " in done.raw.partition(SEARCH)[0]
            assert SEARCH in done.raw
        words = " ".join(" ".join(done.lines).split())
        wanted = step.sentences[:-1] if step is steps[-1] else step.sentences
        assert [each for each in wanted if not re.search(each, words)] == [], words
    last = "\n".join(done.lines[-(size[1] - 1) :])  # what the screen still shows
    assert re.search(steps[-1].sentences[-1], last, re.MULTILINE), last
