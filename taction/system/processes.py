"""Processes of other programs: threads of their libraries, those left behind (Linux).

A simulator and its descendants have the folder of their run as ``HOME``. A descendant that has made
a session of its own is in no process group of ours and has another parent, but it keeps ``HOME``,
unless it replaces its environment: then it is not found.
"""

from __future__ import annotations

import functools
import os
import shutil
import signal
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path

THREADS = ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS")
"""The variables that set how many threads the linear algebra libraries use."""

PROCESSES = Path("/proc")
GUARD_OPTIONS = ("--pdeathsig", "KILL")  # of `setpriv`: the signal for a process whose parent ends
ROUNDS = 5  # of looking; a process may start another one while it is being ended


def end_orphans(folder: str | Path, leader: int | None = None) -> None:
    """End every process of this user whose ``HOME`` is `folder` or lies in it.

    The name of `folder` is random: no process that is not ours has it.

    Parameters
    ----------
    folder : path
        The run folder, absolute.
    leader : int, optional
        Process number of the simulator, if it is known: only later numbers are looked at.
    """
    if sys.platform != "linux" or not hasattr(os, "pidfd_open"):
        return
    home = b"\0HOME=" + os.fsencode(folder)
    for _ in range(ROUNDS):
        if not [pid for pid in _processes(leader) if _end_if_at_home(pid, home)]:
            return


def _processes(leader: int | None) -> Iterator[int]:
    """Yield the numbers of all processes, or of those that were started after `leader`."""
    try:
        latest = int((PROCESSES / "loadavg").read_bytes().split()[-1])
        names = os.listdir(PROCESSES)  # noqa: PTH208 - names are enough
    except (OSError, ValueError):
        return
    for name in names:
        if name.isdecimal() and (leader is None or _is_between(int(name), leader, latest)):
            yield int(name)


def _is_between(pid: int, leader: int, latest: int) -> bool:
    """Whether `pid` was given after `leader`; after the largest number the count starts again."""
    return leader < pid <= latest if leader <= latest else pid > leader or pid <= latest


def _end_if_at_home(pid: int, home: bytes) -> bool:
    """End a process with this ``HOME``, or one in it; return whether it was ended."""
    if pid == os.getpid():
        return False
    try:
        number = os.pidfd_open(pid)  # the number names this process, whatever ends meanwhile
    except OSError:
        return False
    try:
        variables = b"\0" + (PROCESSES / str(pid) / "environ").read_bytes()
        if not (home + b"\0" in variables or home + b"/" in variables):
            return False
        signal.pidfd_send_signal(number, signal.SIGKILL)
        return True
    except OSError:  # of another user, or ended
        return False
    finally:
        os.close(number)


@functools.cache
def guard() -> tuple[str, ...]:
    """Return the words before a command that ends with the thread that starts it.

    The guard also works if the parent is killed. Empty where the system has no such guard.
    """
    setpriv = shutil.which("setpriv") if sys.platform == "linux" else None
    if setpriv is None:
        return ()
    trial = subprocess.run([setpriv, *GUARD_OPTIONS, "true"], capture_output=True, check=False)
    return (setpriv, *GUARD_OPTIONS) if trial.returncode == 0 else ()
