"""Run ngspice with a loop of commands that reads one deck after another from a named pipe."""

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
"""  # without no_mem_check ngspice keeps reading /proc/meminfo: a quarter of the run time
LARGEST = 1e7  # bytes of a result in a folder in memory
ALIVE_INTERVAL = 0.1  # s between two checks that the process still runs
SEND_INTERVAL = 2e-4  # s between two attempts to send a deck


class LostError(Exception):
    """The session's process has ended, or does not answer in time."""


class Loop:
    """The looping ngspice in its own folder; the process ends with the thread that started it."""

    def __init__(self, simulator: Simulator, guard: tuple[str, ...]) -> None:
        self.folder = fast_folder(LARGEST)
        self._errors_read = 0
        with contextlib.ExitStack() as undo:
            undo.callback(remove_folder, self.folder)
            for name, text in (("loop.cir", LOOP), ("spinit", "* no code models are loaded\n")):
                (self.folder / name).write_text(text)
            for name in ("next", "done"):
                os.mkfifo(self.folder / name)
            # Open for reading and writing: the pipe has no end of file, and ngspice never blocks.
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
        """Send a deck, or raise LostError where the process does not read all of it."""
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
            time.sleep(SEND_INTERVAL)  # ngspice has not yet opened the pipe for the next deck

    def wait(self, deadline: float) -> None:
        """Wait for the end of a deck, or raise LostError where the process ends or is late."""
        while not self._ended.poll(1e3 * ALIVE_INTERVAL):
            if self.popen.poll() is not None or time.perf_counter() > deadline:
                raise LostError
        os.read(self._done, 64)

    def clear(self) -> None:
        """Remove the result file, so that no large file stays between two decks."""
        os.unlink(f"{self.folder}/out.raw")  # noqa: PTH108 - quicker

    def errors(self) -> str:
        """Return the new text in the error stream since the last call."""
        length = os.fstat(self._errors).st_size - self._errors_read
        if length > LARGEST:
            raise LostError
        text = os.pread(self._errors, length, self._errors_read) if length else b""
        self._errors_read += len(text)
        return text.decode(errors="replace")


def _launch(simulator: Simulator, guard: tuple[str, ...], folder: Path) -> subprocess.Popen[bytes]:
    with (folder / "stderr.txt").open("wb") as errors:
        return subprocess.Popen(
            [*guard, simulator.executable, "-b", "-n", "loop.cir"],
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
