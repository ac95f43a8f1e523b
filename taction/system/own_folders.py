"""Temporary folders of taction: each is locked by its process, and a later run clears the others.

The name of a folder in use begins with `RUNNING`, and its process holds a lock (flock) on it. The
system drops the lock when the process ends, however it ends, also in another container that shares
the folder. So a free lock means that nobody will clear the folder; the next process does so.
"""

from __future__ import annotations

import contextlib
import fcntl
import functools
import os
import shutil
import tempfile
from collections.abc import Iterator
from pathlib import Path

from taction.system.errors import OutOfDisk
from taction.system.processes import end_orphans

MEMORY = Path("/dev/shm")  # noqa: S108 - of Linux; its folders get random names
RUNNING = "taction-run-"  # a folder in use, or left by a process that was killed
KEPT = "taction-kept-"  # a folder that the user was told of; never cleared
_ATTEMPTS = 100
_locks: dict[str, int] = {}  # file descriptors by folder


def temporary_place() -> str:
    """Return the folder for temporary files; OutOfDisk where there is none.

    `gettempdir` would try TMPDIR with a file, which a kill leaves there, and take another folder
    without a word.
    """
    try:
        return os.environ.get("TMPDIR") or tempfile.gettempdir()
    except OSError as error:
        raise OutOfDisk(f"no folder for temporary files: {error.strerror}") from error


def make_own_folder(place: str | Path | None = None) -> Path:
    """Make a folder in `place`, by default in that for temporary files, and lock it.

    OutOfDisk: the folder cannot be made.
    """
    parent = temporary_place() if place is None else str(place)
    _clear_of_process(os.getpid())
    try:
        for _ in range(_ATTEMPTS):
            folder = tempfile.mkdtemp(prefix=RUNNING, dir=parent)
            if _lock(folder):
                return Path(folder)
        raise FileNotFoundError(f"{parent} loses new folders")
    except OSError as error:
        raise OutOfDisk(
            f"no folder can be made in {parent} (TMPDIR): {error.strerror or error}"
        ) from error


@contextlib.contextmanager
def own_folder() -> Iterator[Path]:
    """Give a folder for temporary files, and remove it at the end."""
    folder = make_own_folder()
    try:
        yield folder
    finally:
        remove_own_folder(folder)


def remove_own_folder(folder: Path) -> None:
    """Remove a folder with its content; a later run clears what is left."""
    shutil.rmtree(folder, ignore_errors=True)
    _unlock(folder)


def keep_folder(folder: Path) -> Path:
    """Rename a folder, so that no later run clears it; return its new path.

    A folder that `make_own_folder` did not make keeps its name.
    """
    if str(folder) not in _locks:
        return folder
    kept = folder.with_name(KEPT + folder.name.removeprefix(RUNNING))
    with contextlib.suppress(OSError):  # the folder is gone: its name is all that is left
        folder.rename(kept)
    _unlock(folder)
    return kept


def clear_abandoned(place: str | Path) -> None:
    """Remove the folders in `place` whose processes have ended, and end what still runs in them.

    A folder of another user, a link and a folder with a lock stay.
    """
    with contextlib.suppress(OSError):  # the place cannot be read, or another process clears it
        with os.scandir(place) as entries:
            folders = [entry.path for entry in entries if entry.name.startswith(RUNNING)]
        for folder in folders:
            with contextlib.suppress(OSError):
                _clear(folder)


def _clear(folder: str) -> None:
    number = os.open(folder, os.O_RDONLY | os.O_DIRECTORY | os.O_NOFOLLOW | os.O_CLOEXEC)
    try:
        if os.fstat(number).st_uid != os.geteuid():
            return
        fcntl.flock(number, fcntl.LOCK_EX | fcntl.LOCK_NB)  # BlockingIOError: in use
        end_orphans(folder)
        shutil.rmtree(folder)
    finally:
        os.close(number)


@functools.cache
def _clear_of_process(process: int) -> None:
    """Clear the folder for temporary files and `MEMORY`, once in a process, by its number."""
    clear_abandoned(MEMORY)
    with contextlib.suppress(OutOfDisk):  # there is no folder for temporary files
        clear_abandoned(temporary_place())


def _lock(folder: str) -> bool:
    """Lock a new folder; return whether it is still there: another process may have cleared it."""
    try:
        number = os.open(folder, os.O_RDONLY | os.O_DIRECTORY | os.O_CLOEXEC)
    except FileNotFoundError:
        return False
    try:
        with contextlib.suppress(OSError):  # a network's file system: nobody can lock it there
            fcntl.flock(number, fcntl.LOCK_EX)
        there = os.path.exists(folder)  # noqa: PTH110
    except BaseException:
        os.close(number)
        raise
    if there:
        _locks[folder] = number
    else:
        os.close(number)
    return there


def _unlock(folder: Path) -> None:
    number = _locks.pop(str(folder), None)
    if number is not None:
        os.close(number)
