"""Run ngspice: one process for one simulation, and evidence before a result is accepted.

The runner reads the text of a deck and nothing else. Each run has its own folder, which is its home
and working directory, so that no start-up file of the user can change a result. The folder is
removed on success; on failure it stays as a reproducer: deck, included files, command line, log and
the result as far as ngspice wrote it.
"""

from __future__ import annotations

import contextlib
import os
import resource
import select
import shlex
import signal
import subprocess
import threading
import time
import weakref
from collections.abc import Callable
from functools import partial
from pathlib import Path
from typing import Any, TypeVar

from taction.netlist_gen.analysis import SimulatedDeck
from taction.system.array_types import PHYSICAL_BOUND, Waveforms
from taction.system.errors import BadEvidence, OutOfDisk, SimulationError, SimulatorNotFound
from taction.system.foreign_files import MEGABYTE, UnusableFileError, read_ends
from taction.system.processes import (
    end_orphans,
    guard,
    keep_folder,
    make_own_folder,
    remove_own_folder,
)
from taction.verification.engines.ngspice.evidence import RAW, Ending, accepted_waveforms
from taction.verification.engines.ngspice.executable import Simulator, environment, find_simulator

__all__ = ["Simulation", "Simulator", "find_simulator", "simulate"]

Result = TypeVar("Result")

STREAMS = ("stdout.txt", "stderr.txt")
LONGEST_LOG = MEGABYTE
"""Bytes of an error stream that are read; of a longer stream only the beginning and the end."""
LONGEST_RESULT = 8000 * MEGABYTE
"""Bytes of a file that ngspice may write; the system ends a run that writes more."""
UNLIMITED = 1 << 62  # bytes
LONGEST_WAIT = 2e6  # s: the system counts milliseconds in 32 bits
_ARGUMENTS = ("-b", "-n", "-r", RAW, "deck.cir")


class Simulation:
    """A running simulation of a deck.

    The process ends with all its descendants, and its folder is removed, at the end of a ``with``
    block, when the object is deleted before a call of `result`, or when Python ends: a failure
    elsewhere leaves no simulator behind.

    `timeout`: wall time allowed, s.
    `bound`: voltage above which a result is rejected, V.
    `memory`: addresses allowed, bytes.
    SimulatorNotFound: the executable no longer exists.
    OutOfDisk: the deck could not be written.
    """

    def __init__(
        self,
        deck: SimulatedDeck,
        simulator: Simulator,
        *,
        timeout: float,
        bound: float = PHYSICAL_BOUND,
        memory: int = UNLIMITED,
    ) -> None:
        self.folder = make_folder(deck, command_line(simulator))
        self._deck, self._simulator = deck, simulator
        self._timeout, self._bound = timeout, bound
        self._started, self._last = time.time(), time.monotonic() + timeout
        try:
            self._process = _launch(simulator, self.folder)
        except OSError as error:
            remove_own_folder(self.folder)
            text = f"{simulator.executable} does not start: {error}"
            raise SimulatorNotFound(text) from error
        self._discard = weakref.finalize(self, _discard, self._process, self.folder)
        for kind, most in ((resource.RLIMIT_FSIZE, LONGEST_RESULT), (resource.RLIMIT_AS, memory)):
            with contextlib.suppress(ProcessLookupError):  # it has ended
                known = resource.prlimit(self._process.pid, kind)
                # Of the guard, which becomes the simulator, too; -1 is no limit.
                least = min([most, *(limit for limit in known if limit >= 0)])
                resource.prlimit(self._process.pid, kind, (least, least))

    def __enter__(self) -> Simulation:
        return self

    def __exit__(self, *error: object) -> None:
        self._discard()  # nothing, once `result` was called

    def result(self) -> Waveforms:
        """Wait for the end and return the waveforms; call it once.

        SimulationError: one of its kinds; the run folder is kept and named in the message.
        """
        engine, solver = self._simulator.engine, self._simulator.solver_of(self._deck.text)
        judge = partial(accepted_waveforms, engine=engine, solver=solver, bound=self._bound)
        return self.accept(judge)

    def accept(self, evidence: Callable[[SimulatedDeck, Ending], Result]) -> Result:
        """Wait for the end and return what `evidence` accepts; else keep the folder."""
        if not self._discard.alive:
            raise SimulationError("a run returns its result once, and never after it was cancelled")
        try:
            ended = self._wait()
        finally:  # also on Ctrl-C, which reaches no other process group
            _end(self._process, self.folder)
        self._discard.detach()
        try:
            ending = Ending(
                status=self._process.returncode,
                timed_out=ended is None,
                timeout=self._timeout,
                seconds=max((ended or time.time()) - self._started, 0.0),
                errors=_error_stream(self.folder),
                folder=self.folder,
            )
            result = evidence(self._deck, ending)
        except SimulationError as error:
            self.folder = error.folder = keep_folder(self.folder)
            raise
        remove_own_folder(self.folder)
        return result

    def _wait(self) -> float | None:
        """Wait; return the time of the end, s, None if the process has not ended in time.

        A process that had ended before anybody looked ended when it wrote its last file.
        """
        number = os.pidfd_open(self._process.pid)
        try:
            over = select.poll()
            over.register(number, select.POLLIN)
            if over.poll(0):
                written = [self.folder / name for name in (*STREAMS, RAW)]
                return max((each.stat().st_mtime for each in written if each.exists()), default=0.0)
            left = max(self._last - time.monotonic(), 0.0)
            return time.time() if over.poll(1e3 * min(left, LONGEST_WAIT)) else None
        finally:
            os.close(number)


def simulate(deck: SimulatedDeck, simulator: Simulator, **options: Any) -> Waveforms:
    """Run a deck and return its waveforms; `options` and errors are those of `Simulation`."""
    with Simulation(deck, simulator, **options) as run:
        return run.result()


def command_line(simulator: Simulator) -> str:
    """Return a command line that repeats the run in its folder, also after the folder was moved."""
    words = shlex.join(f"{name}={value}" for name, value in environment("").items() if value)
    command = shlex.join([simulator.executable, *_ARGUMENTS])
    return f'env -i {words} HOME="$PWD" {command}\n'


def make_folder(deck: SimulatedDeck, command: str) -> Path:
    """Make the run folder and write all files that a run, or a repetition of the run, needs."""
    texts = {
        "spinit": "* no code models are loaded\n",
        **deck.files,
        "deck.cir": deck.text,
        "command.txt": command,
    }
    place = make_own_folder()
    try:
        for name, text in texts.items():
            (place / name).write_bytes(text.encode())
    except OSError as error:
        remove_own_folder(place)
        raise OutOfDisk(f"the run folder cannot be written: {error}") from error
    return place


def _launch(simulator: Simulator, folder: Path) -> subprocess.Popen[bytes]:
    """Start ngspice in `folder`, with its streams in files there."""
    if not os.access(simulator.executable, os.X_OK):
        raise FileNotFoundError("no such program")
    # Another thread than the main one may end before a simulation that a third thread waits for.
    is_main = threading.current_thread() is threading.main_thread()
    with (folder / STREAMS[0]).open("wb") as out, (folder / STREAMS[1]).open("wb") as err:
        return subprocess.Popen(
            [*(guard() if is_main else ()), simulator.executable, *_ARGUMENTS],
            cwd=folder,
            env=environment(str(folder)),
            stdin=subprocess.DEVNULL,
            stdout=out,
            stderr=err,
            start_new_session=True,  # a new process group, which a timeout ends as a whole
        )


def _end(process: subprocess.Popen[bytes], folder: Path) -> None:
    """End a process with all its descendants, and wait for its end."""
    if process.returncode is None:
        with contextlib.suppress(ProcessLookupError):
            # An ended process keeps its number until `wait`, so the group is still its own.
            os.killpg(process.pid, signal.SIGKILL)
        end_orphans(folder)
        process.wait()


def _discard(process: subprocess.Popen[bytes], folder: Path) -> None:
    _end(process, folder)
    remove_own_folder(folder)


def _error_stream(folder: Path) -> str:
    """Return the error stream of a run; a simulator that removed it shows no evidence."""
    try:
        return read_ends(f"{folder}/{STREAMS[1]}", LONGEST_LOG)
    except UnusableFileError as error:
        raise BadEvidence(f"the error stream cannot be read: {STREAMS[1]}: {error}") from None
