"""Writing a file so that nobody ever sees half of it."""

from __future__ import annotations

import contextlib
import os
import tempfile
from collections.abc import Iterator
from pathlib import Path

from spice_models.errors import Complaint, InputError


def check_folder(path: str | Path, option: str) -> None:
    """Refuse a file whose folder is missing, before any work is done.

    Raises
    ------
    InputError
        The folder does not exist, or `path` is a folder.
    """
    file = Path(path)
    if not file.parent.is_dir():
        raise InputError(option, Complaint("FILE", repr(str(path)), "its folder does not exist"))
    if file.is_dir():
        raise InputError(option, Complaint("FILE", repr(str(path)), "a folder; expected a file"))


def write_atomically(path: str | Path, text: str) -> None:
    """Write `text` to `path` as `replacing` has it."""
    with replacing(path) as file:
        file.write_text(text, encoding="utf-8")


@contextlib.contextmanager
def replacing(path: str | Path) -> Iterator[Path]:
    """Give a file beside `path` to write to, and move it there in one step when it is complete.

    A full disk or a killed process leaves what stood at `path` as it was. A link is followed.

    Raises
    ------
    InputError
        The file cannot be written.
    """
    target = Path(os.path.realpath(path))
    try:
        if target.exists() and not target.is_file():  # /dev/stdout, a named pipe: not replaced
            yield target
            return
        prefix = f".{target.name}."
        handle, name = tempfile.mkstemp(prefix=prefix, suffix=target.suffix, dir=target.parent)
        temporary = Path(name)
        try:
            os.close(handle)
            yield temporary
            with temporary.open("rb+") as file:
                os.fsync(file.fileno())
            temporary.chmod(_mode(target))
            temporary.replace(target)
        finally:
            temporary.unlink(missing_ok=True)
    except OSError as error:
        reason = f"{error.strerror or error}; nothing was written, what stood there is as it was"
        raise InputError(path, Complaint("FILE", "", reason)) from None


def _mode(target: Path) -> int:
    """Return the old file's permissions, or what a new file would get here."""
    if target.exists():
        return target.stat().st_mode & 0o777
    umask = os.umask(0)
    os.umask(umask)
    return 0o666 & ~umask
