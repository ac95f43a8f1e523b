"""Completion in bash, zsh and fish: a person at a terminal who presses Tab."""

from __future__ import annotations

import os
import pty
import select
import shutil
import time
from collections.abc import Iterator
from pathlib import Path

import pytest

from tests.install.conftest import Environment, outside

SHELLS = {  # how each starts without the user's files, and how it loads the completion
    "bash": (("--norc", "--noprofile", "-i"), 'eval "$(_TACTION_COMPLETE=bash_source taction)"'),
    "zsh": (
        ("-f", "-i"),
        "autoload -U compinit && compinit -u -d dump; "
        'eval "$(_TACTION_COMPLETE=zsh_source taction)"',
    ),
    "fish": (("--no-config", "-i"), "_TACTION_COMPLETE=fish_source taction | source"),
}
PATIENCE = 60.0  # s, only where a test fails
HOME, TAB = b"\x01", b"\t"


class Terminal:
    """A shell at a pseudo terminal."""

    def __init__(self, words: list[str], folder: Path, environment: dict[str, str]) -> None:
        self.shown = b""
        self.pid, self.master = pty.fork()
        if self.pid == 0:  # the child becomes the shell
            os.chdir(folder)
            os.execvpe(words[0], words, environment)  # noqa: S606

    def type(self, keys: bytes) -> None:
        """Press keys."""
        os.write(self.master, keys)

    def wait_for(self, text: bytes) -> bytes:
        """Return everything shown until `text` is, since the last call."""
        end = time.monotonic() + PATIENCE
        while text not in self.shown:
            left = max(0.0, end - time.monotonic())
            assert select.select([self.master], [], [], left)[0], (text, self.shown)
            self.shown += os.read(self.master, 65536)
        before, _, self.shown = self.shown.partition(text)
        return before

    def close(self) -> None:
        """Hang up, as a terminal that is closed does."""
        os.close(self.master)
        os.waitpid(self.pid, 0)


@pytest.fixture(params=SHELLS)
def terminal(
    request: pytest.FixtureRequest, by_uv: Environment, tmp_path: Path
) -> Iterator[Terminal]:
    """A shell with the completion loaded, in a folder with two files."""
    words, load = SHELLS[request.param]
    path = shutil.which(request.param)
    if path is None:
        reason = f"{request.param} is not here; `make test-install` installs it where it may"
        (pytest.fail if os.environ.get("CI") else pytest.skip)(reason)
    (tmp_path / "my-board.toml").touch()
    (tmp_path / "unrelated.csv").touch()
    search = os.pathsep.join([str(by_uv.programs), os.environ["PATH"]])
    settings = {
        "PATH": search,
        "HOME": str(tmp_path),
        "TERM": "xterm",
        "XDG_DATA_HOME": str(tmp_path),
    }
    shell = Terminal([path, *words], tmp_path, outside() | settings)
    # The result of a computation cannot be the echo of what was typed.
    shell.type(f"{load}; expr 41000 + 993\n".encode())
    shell.wait_for(b"41993")
    yield shell
    shell.close()


def completed(terminal: Terminal, line: str) -> str:
    """Type `line`, press Tab, and return the line that is there now, as the shell sees it."""
    terminal.type(line.encode() + TAB)
    terminal.type(HOME + b"expr 1000 + 994; echo '<' ")
    terminal.type(b"\n")
    terminal.wait_for(b"1994")
    terminal.wait_for(b"< ")
    return terminal.wait_for(b"\n").decode().strip()


@pytest.mark.parametrize(
    ("line", "whole"),
    [
        ("taction ver", "taction verify"),
        ("taction verify my-b", "taction verify my-board.toml"),
    ],
)
def test_tab_completes_the_word(terminal: Terminal, line: str, whole: str) -> None:
    assert completed(terminal, line) == whole
