"""Five users, each in an empty folder: a few commands, and the sentence that must come out.

Every command runs in a pseudo terminal, once of 80 by 24 and once of 120 by 40.
"""

from __future__ import annotations

import re
import shutil
import sys
from dataclasses import dataclass
from pathlib import Path

import pytest

from tests.support.paths import ROOT
from tests.support.terminals import Session, run_in_terminal

SIZES = ((80, 24), (120, 40))
SEARCH = "what to change, at most"
NEVER = ("Traceback", "this is a bug", "Input should be")


@dataclass(frozen=True)
class User:
    """Commands, the sentence (a pattern) among the last lines, and the exit status of each."""

    commands: tuple[str, ...]
    sentence: str
    statuses: tuple[int, ...] = ()


USERS = {
    "designer": User(
        (
            "taction new board.toml",
            "taction verify board.toml --set design.opamp=lm324 --engine statespace --changes 1",
            "taction verify board.toml --engine statespace",
        ),
        r"^PASS: board, \d+ checks; nearest to its limit: .*\d %",
        (0, 1, 0),
    ),
    "researcher": User(
        (
            "taction new board.toml",
            "taction verify --solve board.toml",
            "taction onset board.toml --over C --no-confirm",
            "taction sweep board.toml --over C=20pF:500pF:3 --engine statespace --jobs 1",
        ),
        r"^3 computed now, 0 from board\.sqlite$",
    ),
    "CI engineer": User(
        (
            "taction new board.toml",
            "taction regress . --baseline baseline.json --update --jobs 1",
            "taction regress . --baseline baseline.json --jobs 1",
            "taction verify . --junit report.xml --jobs 1",
            "taction diff board.toml board.toml --engine statespace",
        ),
        r"readings: \d+ equal, 0 within their uncertainties, 0 beyond",
    ),
    "student": User(("taction", "taction demo"), r"Your own board: taction new board\.toml"),
    "SPICE user": User(
        (
            "taction new board.toml",
            "taction netlist board.toml -o board.cir",
            "ngspice -b -r board.raw board.cir",
        ),
        r"No\. of Data Rows : \d+",
    ),
}
MOST = {"designer": 3, "researcher": 4, "CI engineer": 5, "student": 2, "SPICE user": 3}


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
    user = USERS[name]
    assert len(user.commands) <= MOST[name]
    statuses = user.statuses or (0,) * len(user.commands)
    for command, status in zip(user.commands, statuses, strict=True):
        done = typed(command, tmp_path, size)
        assert done.status == status, "\n".join(done.lines)
        assert [word for word in NEVER if word in done.raw] == []
        if status == 1:  # the verdict stands on the screen before the search for changes begins
            assert "FAIL: " in done.raw.partition(SEARCH)[0]
            assert SEARCH in done.raw
    last = "\n".join(done.lines[-(size[1] - 1) :])  # what the screen still shows
    assert re.search(user.sentence, last, re.MULTILINE), last
