"""Command lines of processes that end with their parent, on Linux."""

from __future__ import annotations

import functools
import shutil
import subprocess
import sys
import threading

OPTIONS = ("--pdeathsig", "KILL")  # of `setpriv`: the signal for a process whose parent ends


@functools.cache
def guard() -> tuple[str, ...]:
    """Return the words before a command that ends with the thread that starts it.

    The guard also works if the parent is killed. Empty where the system has no such guard.
    """
    setpriv = shutil.which("setpriv") if sys.platform == "linux" else None
    if setpriv is None:
        return ()
    trial = subprocess.run([setpriv, *OPTIONS, "true"], capture_output=True, check=False)
    return (setpriv, *OPTIONS) if trial.returncode == 0 else ()


def guard_of_process() -> tuple[str, ...]:
    """Return `guard` in the main thread, which lives as long as its process; else nothing.

    Another thread may end before a simulation that a third thread waits for.
    """
    return guard() if threading.current_thread() is threading.main_thread() else ()
