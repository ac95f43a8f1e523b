"""Temporary folders of taction: each is locked by its process, and a later run clears the others.

The name of a folder in use begins with `RUNNING`, and its process holds a lock (flock) on it. The
system drops the lock when the process ends, however it ends, also in another container that shares
the folder. So a free lock means that nobody will clear the folder; the next process does so.

A simulator and its descendants have the folder of their run as ``HOME``: a descendant that has left
every group of ours is found by it, unless it replaces its environment.
"""

from __future__ import annotations

import contextlib
import fcntl
import functools
import os
import shutil
import signal
import tempfile
from collections.abc import Iterator
from pathlib import Path

from taction.system.errors import OutOfDisk

RUNNING = "taction-run-"  # a folder in use, or left by a process that was killed
KEPT = "taction-kept-"  # a folder that the user was told of; never cleared
ROUNDS = 5  # of trying: other processes may clear, and may start others while they are ended
_locks: dict[str, int] = {}  # file descriptors by folder


def make_own_folder(place: str | Path | None = None) -> Path:
    """Make a folder in `place`, by default in that for temporary files, and lock it.

    OutOfDisk: the folder cannot be made.
    """
    # `gettempdir` alone would take another folder than TMPDIR without a word.
    parent = str(place or os.environ.get("TMPDIR") or "")
    try:
        parent = parent or tempfile.gettempdir()
        _clear_once(parent, os.getpid())
        for _ in range(ROUNDS):
            folder = tempfile.mkdtemp(prefix=RUNNING, dir=parent)
            with contextlib.suppress(FileNotFoundError):
                number = os.open(folder, os.O_RDONLY | os.O_DIRECTORY)
                with contextlib.suppress(OSError):  # a file system where nobody can lock
                    fcntl.flock(number, fcntl.LOCK_EX)
                if os.path.exists(folder):  # noqa: PTH110
                    _locks[folder] = number
                    return Path(folder)
                os.close(number)  # another process has cleared it before the lock
        raise FileNotFoundError(f"{parent} loses new folders")
    except OSError as error:
        reason = error.strerror or error
        raise OutOfDisk(f"no folder can be made in {parent} (TMPDIR): {reason}") from error


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
    """Rename a folder of `make_own_folder`, so that no later run clears it; return its path."""
    if str(folder) not in _locks:
        return folder
    kept = folder.with_name(KEPT + folder.name.removeprefix(RUNNING))
    with contextlib.suppress(OSError):  # the folder is gone: its name is all that is left
        folder.rename(kept)
    _unlock(folder)
    return kept


def _unlock(folder: Path) -> None:
    if (number := _locks.pop(str(folder), None)) is not None:
        os.close(number)


@functools.cache
def _clear_once(place: str, process: int) -> None:
    """Clear a place once in a process, by its number."""
    clear_abandoned(place)


def clear_abandoned(place: str | Path) -> None:
    """Remove the folders in `place` whose processes have ended, and end what still runs in them.

    A folder of another user, a link and a folder with a lock stay.
    """
    for folder in Path(place).glob(f"{RUNNING}*"):
        with contextlib.suppress(OSError):
            number = os.open(folder, os.O_RDONLY | os.O_DIRECTORY | os.O_NOFOLLOW)
            try:
                if os.fstat(number).st_uid == os.geteuid():
                    fcntl.flock(number, fcntl.LOCK_EX | fcntl.LOCK_NB)  # BlockingIOError: in use
                    end_orphans(folder)
                    shutil.rmtree(folder)
            finally:
                os.close(number)


def end_orphans(folder: str | Path) -> None:
    """End every process of this user whose ``HOME`` is `folder` or lies in it (Linux).

    `folder`: a run folder, absolute; its name is random, so that no process has it by chance.
    """
    home = b"\0HOME=" + os.fsencode(folder)
    for _ in range(ROUNDS):
        orphans = [process for process in _processes() if _is_at_home(process, home)]
        for process in orphans:
            with contextlib.suppress(OSError):
                os.kill(process, signal.SIGKILL)
        if not orphans:
            return


def _processes() -> list[int]:
    """Return the numbers of all other processes; none where the system does not list them."""
    with contextlib.suppress(OSError):
        numbers = [int(name) for name in os.listdir("/proc") if name.isdecimal()]  # noqa: PTH208
        return [number for number in numbers if number != os.getpid()]
    return []


def _is_at_home(process: int, home: bytes) -> bool:
    try:
        variables = b"\0" + Path(f"/proc/{process}/environ").read_bytes()
    except OSError:  # of another user, or ended
        return False
    return home + b"\0" in variables or home + b"/" in variables
