"""ngspice in a loop of commands that takes one deck after the other from a named pipe."""

from __future__ import annotations

import contextlib
import errno
import os
import select
import subprocess
import time
import weakref
from pathlib import Path

from verification.engines.ngspice.executable import Simulator, environment
from verification.engines.ngspice.run_folder import fast_folder, remove_folder

LOOP = """* one deck after the other
.control
set no_mem_check
set filetype=binary
while 1
source next
run
write out.raw
echo done > done
remcirc
destroy all
end
.endc
.end
"""  # without no_mem_check it reads /proc/meminfo all along: a quarter of a run
DEATH = ("--pdeathsig", "KILL")  # of `setpriv`: what a process gets when its parent ends
LARGEST = 1e7  # bytes of a result that one folder, in memory, has to hold
LOOK = 0.1  # s between two looks at whether the process still lives
NO_READER = 2e-4  # s between two tries to hand over a deck


class LostError(Exception):
    """The session's process has ended, or does not answer in time."""


class Loop:
    """ngspice in its loop, in a folder of its own; it dies with the thread that started it."""

    def __init__(self, simulator: Simulator, guard: str) -> None:
        self.folder = fast_folder(LARGEST)
        self._told = 0
        with contextlib.ExitStack() as undo:
            undo.callback(remove_folder, self.folder)
            for name, text in (("loop.cir", LOOP), ("spinit", "* no code models are loaded\n")):
                (self.folder / name).write_text(text)
            for name in ("next", "done"):
                os.mkfifo(self.folder / name)
            # Both ways, so that it never ends and ngspice never waits for somebody to listen.
            self._done = os.open(self.folder / "done", os.O_RDWR | os.O_NONBLOCK)
            undo.callback(os.close, self._done)
            self.popen = _launch(simulator, guard, self.folder)
            undo.callback(_kill, self.popen)
            self._errors = os.open(self.folder / "stderr.txt", os.O_RDONLY)
            undo.callback(os.close, self._errors)
            self.close = weakref.finalize(self, undo.pop_all().close)
        self._ended = select.poll()
        self._ended.register(self._done, select.POLLIN)

    def send(self, text: bytes, deadline: float) -> None:
        """Hand over a deck.

        Raises
        ------
        LostError
            It was not taken.
        """
        pipe = self._open(deadline)
        try:
            if os.write(pipe, text) != len(text):
                raise LostError
        finally:
            os.close(pipe)

    def _open(self, deadline: float) -> int:
        while True:
            try:
                return os.open(f"{self.folder}/next", os.O_WRONLY | os.O_NONBLOCK)
            except OSError as error:
                late = time.perf_counter() > deadline
                if error.errno != errno.ENXIO or late or self.popen.poll() is not None:
                    raise LostError from error
            time.sleep(NO_READER)  # it is on its way from the last deck to the next

    def wait(self, deadline: float) -> None:
        """Wait for the end of a deck.

        Raises
        ------
        LostError
            There is none.
        """
        while not self._ended.poll(1e3 * LOOK):
            if self.popen.poll() is not None or time.perf_counter() > deadline:
                raise LostError
        os.read(self._done, 64)

    def clear(self) -> None:
        """Remove the result: the next deck's is another file, and nothing large stays."""
        os.unlink(f"{self.folder}/out.raw")  # noqa: PTH108 - quicker

    def errors(self) -> str:
        """Return what stands in the error stream since the last call."""
        more = os.fstat(self._errors).st_size - self._told
        found = os.pread(self._errors, more, self._told) if more else b""
        self._told += len(found)
        return found.decode(errors="replace")


def _launch(simulator: Simulator, guard: str, folder: Path) -> subprocess.Popen[bytes]:
    with (folder / "stderr.txt").open("wb") as errors:
        return subprocess.Popen(
            [guard, *DEATH, simulator.executable, "-b", "-n", "loop.cir"],
            cwd=folder,
            env=environment(folder),
            stdin=subprocess.DEVNULL,
            stdout=subprocess.DEVNULL,
            stderr=errors,
            start_new_session=True,
        )


def _kill(popen: subprocess.Popen[bytes]) -> None:
    popen.kill()
    popen.wait()
