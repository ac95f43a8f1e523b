"""Writing a file so that nobody ever sees half of it."""

from __future__ import annotations

import contextlib
import os
import tempfile
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
    """Write `text` beside `path`, then move it there in one step.

    A full disk or a killed process leaves what stood at `path` as it was. A link is followed.

    Raises
    ------
    InputError
        The file cannot be written.
    """
    target = Path(os.path.realpath(path))
    if target.exists() and not target.is_file():  # /dev/stdout, a named pipe: nothing to replace
        _write_through(target, text)
        return
    try:
        handle, temporary = tempfile.mkstemp(prefix=f".{target.name}.", dir=target.parent)
    except OSError as error:
        raise _refusal(path, error) from None
    try:
        with os.fdopen(handle, "w", encoding="utf-8") as file:
            file.write(text)
            file.flush()
            os.fsync(file.fileno())
        Path(temporary).chmod(_mode(target))
        Path(temporary).replace(target)
    except OSError as error:
        raise _refusal(path, error) from None
    finally:
        with contextlib.suppress(FileNotFoundError):
            Path(temporary).unlink()


def _write_through(target: Path, text: str) -> None:
    try:
        target.write_text(text, encoding="utf-8")
    except OSError as error:
        raise _refusal(target, error) from None


def _mode(target: Path) -> int:
    """Return the old file's permissions, or what a new file would get here."""
    if target.exists():
        return target.stat().st_mode & 0o777
    umask = os.umask(0)
    os.umask(umask)
    return 0o666 & ~umask


def _refusal(path: str | Path, error: OSError) -> InputError:
    reason = f"{error.strerror}; nothing was written, and what stood there is as it was"
    return InputError(path, Complaint("FILE", "", reason))
