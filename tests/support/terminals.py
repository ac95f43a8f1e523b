"""A pseudo terminal: what a command leaves on a screen of so many columns and lines."""

from __future__ import annotations

import fcntl
import os
import pty
import re
import struct
import subprocess
import termios
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

CONTROL = re.compile(r"\x1b\[(\??[\d;]*)([A-Za-z])|\r|\n|[^\x1b\r\n]+")
TIMEOUT = 120.0  # s


@dataclass(frozen=True, slots=True)
class Session:
    """What a command did.

    Attributes
    ----------
    status : int
        Its exit status.
    raw : str
        All that it wrote, with the controls of the terminal.
    lines : list of str
        What it left, without what it took away again, as a bar.
    """

    status: int
    raw: str
    lines: list[str]


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
