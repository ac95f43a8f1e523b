"""Processes and their folders: guarded, limited in time, ended by signals, and cleared after kills.

The name of a temporary folder in use begins with `RUNNING`, and its process holds a lock (flock) on
it. The system drops the lock when the process ends, however it ends, also in another container that
shares the folder. So a free lock means that nobody will clear the folder; the next process does so.

A simulator and its descendants have the folder of their run as ``HOME``: a descendant that has left
every group of ours is found by it, unless it replaces its environment.

With `one_limit` each run asks how long it may still take; none has a limit of its own beyond that.

Signals that end this process raise an exception in it, so that all clean-up runs.
"""

from __future__ import annotations

import contextlib
import fcntl
import functools
import math
import os
import shutil
import signal
import subprocess
import sys
import tempfile
import threading
import time
from collections.abc import Iterator
from contextvars import ContextVar
from pathlib import Path
from types import FrameType
from typing import Any

from taction.system.errors import OutOfDisk

THREADS = ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS")
"""The variables that set how many threads the linear algebra libraries use."""


@functools.cache
def guard() -> tuple[str, ...]:
    """Return the words before a command that ends with the thread that starts it, also by a kill.

    Empty where the system has no such guard.
    """
    words = (shutil.which("setpriv") or "", "--pdeathsig", "KILL")  # when its parent ends
    works = words[0] and not subprocess.run([*words, "true"], capture_output=True).returncode
    return words if works else ()


_END: ContextVar[float] = ContextVar("end of all runs", default=math.inf)


@contextlib.contextmanager
def one_limit(seconds: float, *, more: bool = False) -> Iterator[None]:
    """Give all runs within this block one limit together, s of wall time.

    `more`: the seconds are added to the limit around the block.
    """
    known = _END.get()
    token = _END.set(known + seconds if more else min(known, time.monotonic() + seconds))
    try:
        yield
    finally:
        _END.reset(token)


def time_left(seconds: float) -> float:
    """Return how long a run may take that would take at most `seconds`, s; 0 if no time is left."""
    return min(seconds, max(_END.get() - time.monotonic(), 0.0))


ENDING: tuple[int, ...] = (signal.SIGINT, signal.SIGTERM, signal.SIGHUP)
AGAIN = 0.02  # s until a signal comes again whose exception was lost


class Ended(KeyboardInterrupt):
    """A signal of `ENDING`; after a plain `KeyboardInterrupt` Python may end itself by SIGINT."""


@contextlib.contextmanager
def ending_signals() -> Iterator[list[int]]:
    """Raise `Ended` once at a signal of `ENDING`; the list receives the numbers of the signals.

    A signal that the process ignores, as below nohup, stays ignored. A second one of the same kind
    cannot stop the clean-up, nor the end of Python.
    """
    received: list[int] = []

    def end(number: int, frame: FrameType | None) -> None:
        signal.signal(number, signal.SIG_IGN)
        received.append(number)
        raise Ended

    def show(lost: Any) -> None:
        """Send a signal again whose exception Python has dropped, as in a callback."""
        if not isinstance(lost.exc_value, Ended):
            hook(lost)
            return
        number = received.pop()
        signal.signal(number, end)
        threading.Timer(AGAIN, os.kill, (os.getpid(), number)).start()

    before, usual = dict[int, Any](), (signal.SIG_DFL, signal.default_int_handler)
    for number in ENDING:
        if signal.getsignal(number) in usual:
            with contextlib.suppress(ValueError):  # not the main thread
                before[number] = signal.signal(number, end)
    hook, sys.unraisablehook = sys.unraisablehook, show
    try:
        yield received
    finally:
        sys.unraisablehook = hook
        for number in before.keys() - received:
            signal.signal(number, before[number])


RUNNING = "taction-run-"  # a folder in use, or left by a process that was killed
KEPT = "taction-kept-"  # a folder that the user was told of; never cleared
ROUNDS = 5  # of trying: other processes may clear, and may start others while they are ended
_locks: dict[str, int] = {}  # file descriptors by folder


def make_own_folder() -> Path:
    """Make a folder where temporary files are (TMPDIR), and lock it.

    OutOfDisk: the folder cannot be made.
    """
    # `gettempdir` alone would take another folder than TMPDIR without a word.
    parent = os.environ.get("TMPDIR", "")
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
    if str(folder) in _locks:
        os.close(_locks.pop(str(folder)))


def keep_folder(folder: Path) -> Path:
    """Rename a folder of `make_own_folder`, so that no later run clears it; return its path."""
    if str(folder) not in _locks:
        return folder
    kept = folder.with_name(KEPT + folder.name.removeprefix(RUNNING))
    with contextlib.suppress(OSError):  # the folder is gone: its name is all that is left
        folder.rename(kept)
    os.close(_locks.pop(str(folder)))
    return kept


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


_clear_once = functools.cache(lambda place, process: clear_abandoned(place))  # in a process


def end_orphans(folder: str | Path) -> None:
    """End every process of this user whose ``HOME`` is `folder` or lies in it (Linux).

    `folder`: a run folder, absolute; its name is random, so that no process has it by chance.
    """
    home = b"\0HOME=" + os.fsencode(folder)
    for _ in range(ROUNDS):
        orphans = _at_home(home)
        for process in orphans:
            with contextlib.suppress(OSError):
                os.kill(process, signal.SIGKILL)
        if not orphans:
            return


def _at_home(home: bytes) -> list[int]:
    """Return the numbers of other processes with this ``HOME``; none where none are listed."""
    found = list[int]()
    for place in Path("/proc").glob("[0-9]*"):
        with contextlib.suppress(OSError):  # of another user, or ended
            variables = b"\0" + (place / "environ").read_bytes()
            if home + b"\0" in variables or home + b"/" in variables:
                found.append(int(place.name))
    return [number for number in found if number != os.getpid()]
