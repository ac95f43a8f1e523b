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
import shlex
import signal
import subprocess
import threading
import time
import weakref
from collections.abc import Callable
from functools import partial
from pathlib import Path
from typing import TypeVar

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

__all__ = ["Run", "Simulator", "find_simulator", "simulate", "start"]

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


class _Process:
    """The process of a run, and a thread that notes when it ended and ends what it left behind.

    The thread sleeps in waitid(2); ``Popen.wait`` with a timeout would poll. An event says that it
    has ended: a join that a signal interrupts makes Python take a living thread for an ended one.
    """

    def __init__(self, simulator: Simulator, folder: Path, memory: int) -> None:
        self.folder = folder
        self.started = self.ended = time.perf_counter()
        self.popen = launch(simulator, folder)
        for kind, most in ((resource.RLIMIT_FSIZE, LONGEST_RESULT), (resource.RLIMIT_AS, memory)):
            with contextlib.suppress(ProcessLookupError):  # it has ended
                known = resource.prlimit(self.popen.pid, kind)  # -1: unlimited
                least = min((limit for limit in (most, *known) if limit >= 0), default=most)
                # Of the guard, which becomes the simulator, too.
                resource.prlimit(self.popen.pid, kind, (least, least))
        self._over = threading.Event()
        threading.Thread(target=self._watch, daemon=True).start()

    def _watch(self) -> None:
        try:
            # The ended process keeps its number until `Popen.wait`, so the group is still its own.
            os.waitid(os.P_PID, self.popen.pid, os.WEXITED | os.WNOWAIT)
            self.ended = time.perf_counter()
            self._kill_group()
            end_orphans(self.folder, self.popen.pid)
            self.popen.wait()
        finally:
            self._over.set()

    def wait(self, seconds: float) -> bool:
        """Wait no longer than `seconds`; return whether the process has ended."""
        return self._over.wait(max(seconds, 0.0))

    def kill(self) -> None:
        """End the process group, and wait for its end."""
        if not self._over.is_set():
            self._kill_group()
            self._over.wait()

    def _kill_group(self) -> None:
        with contextlib.suppress(ProcessLookupError):  # the group may end in the meantime
            os.killpg(self.popen.pid, signal.SIGKILL)

    def discard(self, keep: bool) -> Path:
        """End the process with all its descendants; keep its folder, or remove it."""
        self.kill()
        if keep:
            return keep_folder(self.folder)
        remove_own_folder(self.folder)
        return self.folder


class Run:
    """A running simulation, made by `start`.

    The process ends, and its folder is removed, when the run is cancelled, at the end of a
    ``with`` block, when the object is deleted before a call of `result`, or when Python ends: a
    failure elsewhere leaves no simulator behind.
    """

    def __init__(
        self,
        deck: DeckToRun,
        simulator: Simulator,
        folder: Path,
        *,
        timeout: float,
        keep: bool,
        bound: float,
        memory: int = resource.RLIM_INFINITY,
    ) -> None:
        self.folder = folder
        self._deck, self._simulator = deck, simulator
        self._timeout, self._keep, self._bound = timeout, keep, bound
        self._process = _Process(simulator, folder, memory)
        self._discard = weakref.finalize(self, self._process.discard, keep)

    def __enter__(self) -> Run:
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
        process = self._process
        try:
            ended = self._has_ended()
        finally:  # also on Ctrl-C, which reaches no other process group
            process.kill()
        self._discard.detach()
        ending = Ending(
            status=process.popen.returncode,
            timed_out=not ended,
            timeout=self._timeout,
            seconds=process.ended - process.started,
            errors=_error_stream(self.folder),
            folder=self.folder,
        )
        try:
            result = evidence(self._deck, ending)
        except SimulationError as error:
            self.folder = process.discard(keep=True)
            raise error.in_folder(self.folder) from None
        self.folder = process.discard(self._keep)
        return result

    def _has_ended(self) -> bool:
        """Wait for the end or the timeout; say which share of a transient is written."""
        process = self._process
        stop: float | None = getattr(self._deck.analysis, "stop", None)
        end = process.started + self._timeout
        while not process.wait(min(end - time.perf_counter(), LOOK_INTERVAL)):
            if stop and (now := last_instant(self.folder / "out.raw")) is not None:
                reached(now / stop)
            if time.perf_counter() >= end:
                return False
        return True


def start(
    deck: DeckToRun,
    simulator: Simulator,
    *,
    timeout: float,
    folder: Path | None = None,
    keep: bool = False,
    bound: float = PHYSICAL_BOUND,
) -> Run:
    """Start the simulation of a deck.

    `deck`: what to run.
    `simulator`: the executable.
    `timeout`: wall time allowed, s.
    `folder`: the run folder, which is created; an existing folder must be empty. By default a new
      temporary folder.
    `keep`: whether to keep the run folder also on success.
    `bound`: voltage above which a result is rejected, V.
    InputError: the run folder is not empty.
    SimulatorNotFound: the executable no longer exists.
    OutOfDisk: the deck could not be written.
    """
    place = make_folder(deck, command_line(simulator), folder)
    try:
        if not os.access(simulator.executable, os.X_OK):
            raise FileNotFoundError(errno.ENOENT, os.strerror(errno.ENOENT))
        return Run(deck, simulator, place, timeout=timeout, keep=keep, bound=bound)
    except OSError as error:
        remove_own_folder(place)
        raise SimulatorNotFound(f"{simulator.executable} does not start: {error}") from error


def simulate(
    deck: DeckToRun,
    simulator: Simulator,
    *,
    timeout: float,
    folder: Path | None = None,
    keep: bool = False,
    bound: float = PHYSICAL_BOUND,
) -> Waveforms:
    """Run a deck and return its waveforms; see `start` and `Run.result`."""
    with start(deck, simulator, timeout=timeout, folder=folder, keep=keep, bound=bound) as run:
        return run.result()


def _error_stream(folder: Path) -> str:
    """Return the error stream of a run; a simulator that removed it shows no evidence."""
    try:
        return read_ends(f"{folder}/{STREAMS[1]}", LONGEST_LOG)
    except UnusableFileError as error:
        text = f"the error stream cannot be read: {STREAMS[1]}: {error}"
        raise BadEvidence(text, folder=folder) from None
