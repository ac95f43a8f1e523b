"""Run ngspice: one process for one simulation, and evidence before a result is accepted.

The runner reads the text of a deck and nothing else. Each run has its own folder, which is its home
and working directory, so that no start-up file of the user can change a result. The folder is
removed on success; on failure it stays as a reproducer: deck, included files, command line, log and
the result as far as ngspice wrote it.
"""

from __future__ import annotations

import contextlib
import errno
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

from taction.system.errors import (
    BadEvidence,
    Complaint,
    InputError,
    OutOfDisk,
    SimulationError,
    SimulatorNotFound,
)
from taction.system.foreign_files import MEGABYTE, UnusableFileError, read_ends
from taction.system.own_folders import keep_folder, make_own_folder, remove_own_folder
from taction.system.processes import end_orphans, guard
from taction.system.progress import reached
from taction.system.raw_file import last_instant
from taction.system.waveforms import PHYSICAL_BOUND, Waveforms
from taction.verification.engines.ngspice.evidence import (
    DeckToRun,
    Ending,
    accepted_waveforms,
    integrated_noise,
)
from taction.verification.engines.ngspice.executable import Simulator, environment, find_simulator

__all__ = ["Simulation", "Simulator", "find_simulator", "simulate", "start"]

Result = TypeVar("Result")

STREAMS = ("stdout.txt", "stderr.txt")
_HERE = Path("$PWD")
_ARGUMENTS = ("-b", "-n", "-r", "out.raw", "deck.cir")


def command_line(simulator: Simulator) -> str:
    """Return a command line that repeats the run in its folder, also after the folder was moved."""
    variables = environment(_HERE).items()
    words = [f"{name}={value}" for name, value in variables if value != str(_HERE)]
    homes = " ".join(f'{name}="$PWD"' for name, value in variables if value == str(_HERE))
    command = shlex.join([simulator.executable, *_ARGUMENTS])
    return f"{shlex.join(['env', '-i', *words])} {homes} {command}\n"


def launch(simulator: Simulator, folder: Path) -> subprocess.Popen[bytes]:
    """Start ngspice in `folder`, with its streams in files there."""
    # Another thread than the main one may end before a simulation that a third thread waits for.
    is_main = threading.current_thread() is threading.main_thread()
    with (folder / STREAMS[0]).open("wb") as out, (folder / STREAMS[1]).open("wb") as err:
        return subprocess.Popen(
            [*(guard() if is_main else ()), simulator.executable, *_ARGUMENTS],
            cwd=folder,
            env=environment(folder),
            stdin=subprocess.DEVNULL,
            stdout=out,
            stderr=err,
            start_new_session=True,  # a new process group, which a timeout ends as a whole
        )


def make_folder(deck: DeckToRun, command: str, folder: Path | None) -> Path:
    """Make the run folder and write all files that a run, or a repetition of the run, needs.

    `command` is the command line that repeats the run in its folder. An existing `folder` must be
    empty; without `folder`, a new temporary folder is made.

    InputError: the folder is not empty.
    OutOfDisk: the folder cannot be written.
    """
    texts = {
        "spinit": "* no code models are loaded\n",
        **deck.files,
        "deck.cir": deck.text,
        "command.txt": command,
    }
    try:
        place = make_own_folder() if folder is None else _empty(folder)
    except OSError as error:
        raise OutOfDisk(f"the run folder cannot be made: {error}") from error
    try:
        for name, text in texts.items():
            (place / name).write_bytes(text.encode())
    except OSError as error:
        remove_own_folder(place)
        raise OutOfDisk(f"the run folder cannot be written: {error}") from error
    return place


def _empty(folder: Path) -> Path:
    place = folder.absolute()
    place.mkdir(parents=True, exist_ok=True)
    if any(place.iterdir()):
        raise InputError(place, Complaint("run folder", "", "it must be empty"))
    return place


LONGEST_LOG = MEGABYTE
"""Bytes of an error stream that are read; of a longer stream only the beginning and the end."""

LONGEST_RESULT = 8000 * MEGABYTE
"""Bytes of a file that ngspice may write; the system ends a run that writes more."""

LOOK_INTERVAL = 0.5  # s between two looks at the share that is done


class Simulation:
    """A running simulation, made by `start`.

    The process ends with all its descendants, and its folder is removed, when the run is cancelled,
    at the end of a ``with`` block, when the object is deleted before a call of `result`, or when
    Python ends: a failure elsewhere leaves no simulator behind.
    """

    def __init__(
        self,
        deck: DeckToRun,
        simulator: Simulator,
        folder: Path,
        timeout: float,
        keep: bool,
        bound: float,
        memory: int,
    ) -> None:
        self.folder = folder
        self._deck, self._simulator = deck, simulator
        self._timeout, self._keep, self._bound = timeout, keep, bound
        self._started = time.perf_counter()
        self._process = launch(simulator, folder)
        self._discard = weakref.finalize(self, _discard, self._process, folder, keep)
        for kind, most in ((resource.RLIMIT_FSIZE, LONGEST_RESULT), (resource.RLIMIT_AS, memory)):
            with contextlib.suppress(ProcessLookupError):  # it has ended
                known = resource.prlimit(self._process.pid, kind)  # -1: unlimited
                least = min((limit for limit in (most, *known) if limit >= 0), default=most)
                # Of the guard, which becomes the simulator, too.
                resource.prlimit(self._process.pid, kind, (least, least))

    def __enter__(self) -> Simulation:
        return self

    def __exit__(self, *error: object) -> None:
        self.cancel()

    def cancel(self) -> None:
        """End the process group and remove the run folder, unless `result` was called."""
        self._discard()

    def result(self) -> Waveforms:
        """Wait for the end and return the waveforms; call it once.

        SimulationError: one of its kinds; the run folder is kept and named in the message.
        """
        engine, solver = self._simulator.engine, self._simulator.solver_of(self._deck.text)
        judge = partial(accepted_waveforms, engine=engine, solver=solver, bound=self._bound)
        return self.accept(judge)

    def noise(self) -> float:
        """Wait for the end and return the noise of the saved node, V; see `integrated_noise`."""
        return self.accept(integrated_noise)

    def accept(self, evidence: Callable[[DeckToRun, Ending], Result]) -> Result:
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
                seconds=(ended or time.perf_counter()) - self._started,
                errors=_error_stream(self.folder),
                folder=self.folder,
            )
            result = evidence(self._deck, ending)
        except SimulationError as error:
            self.folder = keep_folder(self.folder)
            raise error.in_folder(self.folder) from None
        if self._keep:
            self.folder = keep_folder(self.folder)
        else:
            remove_own_folder(self.folder)
        return result

    def _wait(self) -> float | None:
        """Wait; return when the process ended, s, None if it has not; say what share is written.

        A process that had ended before anybody looked ended when it wrote its last file.
        """
        stop: float | None = getattr(self._deck.analysis, "stop", None)
        number = os.pidfd_open(self._process.pid)
        try:
            over = select.poll()
            over.register(number, select.POLLIN)
            if over.poll(0):
                written = (self.folder / name for name in (*STREAMS, "out.raw"))
                last = max((each.stat().st_mtime for each in written if each.exists()), default=0.0)
                return max(time.perf_counter() - (time.time() - last), self._started)
            while (left := self._started + self._timeout - time.perf_counter()) > 0.0:
                if over.poll(1e3 * min(left, LOOK_INTERVAL)):
                    return time.perf_counter()
                if stop and (now := last_instant(self.folder / "out.raw")) is not None:
                    reached(now / stop)
            return None
        finally:
            os.close(number)


def _end(process: subprocess.Popen[bytes], folder: Path) -> None:
    """End a process with all its descendants, and wait for its end."""
    if process.returncode is None:
        with contextlib.suppress(ProcessLookupError):
            # An ended process keeps its number until `wait`, so the group is still its own.
            os.killpg(process.pid, signal.SIGKILL)
        end_orphans(folder, process.pid)
        process.wait()


def _discard(process: subprocess.Popen[bytes], folder: Path, keep: bool) -> None:
    """End a process, and keep its folder or remove it."""
    _end(process, folder)
    if keep:
        keep_folder(folder)
    else:
        remove_own_folder(folder)


def start(
    deck: DeckToRun,
    simulator: Simulator,
    *,
    timeout: float,
    folder: Path | None = None,
    keep: bool = False,
    bound: float = PHYSICAL_BOUND,
    memory: int = resource.RLIM_INFINITY,
) -> Simulation:
    """Start the simulation of a deck.

    `deck`: what to run.
    `simulator`: the executable.
    `timeout`: wall time allowed, s.
    `folder`: the run folder, which is created; an existing folder must be empty. By default a new
      temporary folder.
    `keep`: whether to keep the run folder also on success.
    `bound`: voltage above which a result is rejected, V.
    `memory`: addresses allowed, bytes.
    InputError: the run folder is not empty.
    SimulatorNotFound: the executable no longer exists.
    OutOfDisk: the deck could not be written.
    """
    place = make_folder(deck, command_line(simulator), folder)
    try:
        if not os.access(simulator.executable, os.X_OK):
            raise FileNotFoundError(errno.ENOENT, os.strerror(errno.ENOENT))
        return Simulation(deck, simulator, place, timeout, keep, bound, memory)
    except OSError as error:
        remove_own_folder(place)
        raise SimulatorNotFound(f"{simulator.executable} does not start: {error}") from error


def simulate(deck: DeckToRun, simulator: Simulator, **options: Any) -> Waveforms:
    """Run a deck and return its waveforms; `options` and errors are those of `start`."""
    with start(deck, simulator, **options) as run:
        return run.result()


def _error_stream(folder: Path) -> str:
    """Return the error stream of a run; a simulator that removed it shows no evidence."""
    try:
        return read_ends(f"{folder}/{STREAMS[1]}", LONGEST_LOG)
    except UnusableFileError as error:
        raise BadEvidence(f"the error stream cannot be read: {STREAMS[1]}: {error}") from None
