"""The file of a database of results: what SQLite says of it, in words that name the remedy."""

from __future__ import annotations

import sqlite3
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path

from taction.system.errors import Complaint, InputError, OutOfDisk

PATIENCE = 60.0  # s to wait for another process that has locked the file
ACCEPTED = "expected a database of `taction sweep` or `montecarlo`, or the name of a new file"
CORRUPT = (
    "the database is damaged and was not changed; `sqlite3 FILE .recover` may save its points;"
    " start anew with another name"
)
_HEAD = b"SQLite format 3\0"
_NOT_A_DATABASE = f"the file is no SQLite database; {ACCEPTED}. It was not changed"
_MESSAGES = {  # by the beginnings of SQLite's error names
    ("SQLITE_NOTADB",): _NOT_A_DATABASE,
    ("SQLITE_CORRUPT",): CORRUPT,
    ("SQLITE_READONLY", "SQLITE_PERM"): "the file cannot be written; give it write permission, or"
    " give another name",
    ("SQLITE_CANTOPEN",): "the file cannot be opened or made; does the folder exist, and may you"
    " write to it?",
    ("SQLITE_BUSY", "SQLITE_LOCKED"): f"another process has locked the file for {PATIENCE:g} s;"
    " is that process suspended?",
}
_FULL = ("SQLITE_FULL", "SQLITE_IOERR")


def check_database(path: str) -> None:
    """Refuse a file that is no database, before any work is done.

    Raises
    ------
    InputError
        `path` is no regular file, or begins otherwise than a database.
    """
    if not Path(path).exists():
        return
    if not Path(path).is_file():
        raise unusable(path, f"not a regular file; {ACCEPTED}")
    head = b""
    with suppress(OSError), Path(path).open("rb") as file:  # SQLite says why it cannot be read
        head = file.read(len(_HEAD))
    if head and head != _HEAD:
        raise unusable(path, _NOT_A_DATABASE)


@contextmanager
def explained(path: str) -> Iterator[None]:
    """Turn an error of SQLite in the block into an `InputError` or `OutOfDisk`."""
    try:
        yield
    except sqlite3.Error as error:
        name = getattr(error, "sqlite_errorname", "")
        if name.startswith(_FULL):
            raise OutOfDisk(
                f"{path}: {error}. All earlier points are stored; make room on the disk"
                " and run the same command again to continue"
            ) from error
        texts = (text for names, text in _MESSAGES.items() if name.startswith(names))
        text = next(texts, f"{error}; {ACCEPTED}")
        raise unusable(path, text) from error
    except UnicodeDecodeError as error:  # SQLite's message quotes a damaged name
        raise unusable(path, CORRUPT) from error


def unusable(path: str, text: str) -> InputError:
    """Return the error of a database that cannot be used, with the reason `text`."""
    return InputError(path, Complaint("database", "", text))
