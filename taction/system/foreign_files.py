"""Files that another program or the user wrote, and their texts as a reader sees them.

A terminal obeys escape sequences, a list is spoilt by a newline, and GitHub takes a line of a log
that begins with ``::`` for a command. Every text that taction did not write itself passes through
here on its way to a terminal, a log, Markdown, HTML or XML. In JSON it stays what it is.

A file may be anything: a pipe without a writer, a device without an end, a folder, or larger
than the memory.
"""

from __future__ import annotations

import json
import os
import re
import stat
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import BinaryIO

COMMAND = re.compile(r"^(\s*):(?=:)|#(?=#\[)", re.MULTILINE)
LONGEST = 2000  # characters of a message


def visible(text: str) -> str:
    r"""Return `text` in one line: what cannot be printed is written as in Python.

    >>> print(visible("a\n::error::b\x1b[2J"), visible("::error::"), visible("\udcff"))
    a\n::error::b\x1b[2J \x3a:error:: \udcff
    """
    mark = lambda found: f"{found[0][:-1]}\\x{ord(found[0][-1]):02x}"  # noqa: E731
    return COMMAND.sub(mark, escaped(text))


def visible_lines(text: str) -> str:
    """Return a text of several lines: as `visible`, but its newlines stay."""
    return "\n".join(map(visible, text.split("\n")))


def escaped(text: str, keep: str = "") -> str:
    """Return `text` with what cannot be printed, but characters in `keep`, as in Python."""
    if text.isprintable():
        return text
    signs = ((c, c.encode("unicode_escape").decode()) for c in text)
    return "".join(c if c.isprintable() or c in keep else sign for c, sign in signs)


def shortened(text: str, most: int = LONGEST) -> str:
    """Return a text of about `most` characters at most: of a longer one beginning and end."""
    return text if len(text) <= most else f"{text[: most // 2]} ... {text[-most // 2 :]}"


MEGABYTE = 1_000_000
LARGEST = 64 * MEGABYTE  # of a table of numbers: 2,800 x 2,800 in binary


FOLDERS = "TACTION_FOLDERS"
"""Environment variable: the only folders of which files are read, as a JSON list of texts.

PATH has no way to write a folder with a colon in its name.
"""


class UnusableFileError(ValueError):
    """A file that cannot be read; the text is the reason."""


def _may_read(path: str | Path) -> bool:
    """Return whether a file, with links followed, is in a folder that may be read."""
    text = os.environ.get(FOLDERS, "")
    try:
        folders = [os.path.realpath(folder) for folder in json.loads(text or "[]")]
    except (TypeError, ValueError):
        reason = f"{FOLDERS} is {text!r}; expected a JSON list of folders"
        raise UnusableFileError(reason) from None
    real = os.path.realpath(path) if text else ""
    return not text or any(os.path.commonpath((real, each)) == each for each in folders)


@contextmanager
def open_regular(path: str | Path) -> Iterator[BinaryIO]:
    """Open a regular file to read bytes, without waiting, or raise `UnusableFileError`."""
    try:
        if not _may_read(path):
            raise UnusableFileError(f"outside of the folders that are read ({FOLDERS})")
        number = os.open(path, os.O_RDONLY | os.O_NONBLOCK | os.O_CLOEXEC)
        if not stat.S_ISREG(os.fstat(number).st_mode):
            os.close(number)
            raise UnusableFileError("not a regular file")
        with open(number, "rb") as file:  # noqa: PTH123 - of a number
            yield file
    except (OSError, ValueError) as error:  # a zero byte in a name, or no text of the file system
        raise UnusableFileError(getattr(error, "strerror", None) or str(error)) from None


def read_text(path: str | Path, limit: int) -> str:
    """Return the text of a UTF-8 file of at most `limit` bytes, without its byte order mark."""
    content = read_bounded(path, limit)
    try:
        return content.decode("utf-8-sig")
    except UnicodeDecodeError as error:
        line = content.count(b"\n", 0, error.start) + 1
        text = f"line {line} is not UTF-8 (byte 0x{content[error.start]:02x})"
        raise UnusableFileError(f"{text}; save the file as UTF-8") from None


def read_bounded(path: str | Path, limit: int) -> bytes:
    """Return the content of a regular file of at most `limit` bytes."""
    with open_regular(path) as file:
        size = os.fstat(file.fileno()).st_size
        content = b"" if size > limit else file.read(limit + 1)
        if size > limit or len(content) > limit:
            raise UnusableFileError(f"over {limit / MEGABYTE:g} MB, the largest size that is read")
        return content


def read_ends(path: str | Path, limit: int) -> str:
    """Return the text of a regular file; of a file over `limit` bytes only beginning and end."""
    with open_regular(path) as file:
        size = os.fstat(file.fileno()).st_size
        if size <= limit:
            return file.read(limit).decode(errors="replace")
        half = limit // 2
        head = file.read(half)
        file.seek(size - half)
        left_out = f"\n... {size - 2 * half} bytes\n".encode()
        return (head + left_out + file.read(half)).decode(errors="replace")
