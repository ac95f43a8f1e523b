"""Find and run ngspice: one process for one simulation, and evidence before a result is accepted.

The runner reads the text of a deck and nothing else. Each run has its own folder, which is its home
and working directory, so that no start-up file of the user can change a result. The folder is
removed on success; on failure it stays as a reproducer: deck, included files, command line, log and
the result as far as ngspice wrote it.
"""

from __future__ import annotations

import contextlib
import os
import re
import resource
import select
import shlex
import shutil
import signal
import subprocess
import tempfile
import threading
import time
import weakref
from collections.abc import Callable
from dataclasses import dataclass
from functools import cache, partial
from pathlib import Path
from typing import Any, TypeVar

from taction.netlist_gen.analysis import SimulatedDeck
from taction.system.array_types import PHYSICAL_BOUND, Waveforms
from taction.system.errors import (
    BadEvidence,
    OutOfDisk,
    SimulationError,
    SimulatorNotFound,
    SimulatorTooOld,
    one_line,
)
from taction.system.foreign_files import MEGABYTE, UnusableFileError, read_ends
from taction.system.processes import (
    end_orphans,
    guard,
    keep_folder,
    make_own_folder,
    remove_own_folder,
)
from taction.verification.engines.ngspice.evidence import RAW, REMEDY, Ending, accepted_waveforms

Result = TypeVar("Result")

OLDEST = 39
"""Oldest supported version (Debian 12)."""

PATIENCE = 20.0  # s to wait for a version
LONGEST_ANSWER = 65_536  # bytes of a version
SHOWN = 2_000  # characters of an answer in a message


def environment(home: str) -> dict[str, str]:
    """Return the complete environment of ngspice with `home` as its home.

    The folder of start-up files, which load code models, is the working folder by a relative name:
    ngspice cannot read the name of a folder with a quote or a line break.
    """
    path = "LD_LIBRARY_PATH"  # an ngspice in a folder of its own may need it
    inherited = {path: os.environ[path]} if path in os.environ else {}
    return inherited | {"LC_ALL": "C", "HOME": home, "SPICE_SCRIPTS": ".", "OMP_NUM_THREADS": "1"}


@dataclass(frozen=True, slots=True)
class Simulator:
    """An ngspice executable: absolute path, major version, and whether it has the KLU solver."""

    executable: str
    version: int
    klu: bool

    @property
    def solver_option(self) -> str:
        """The option of the ``.options`` card that selects this version's fastest linear solver.

        Version 39 ignores ``klu`` without a message; ``noopiter`` makes its own solver 3 to 5
        times faster.
        """
        return "klu" if self.klu else "noopiter"

    def solver_of(self, deck: str) -> str:
        """Return the name of the matrix solver that this version takes for the text of a deck."""
        return "KLU" if self.klu and "\n.options klu" in deck else "Sparse"

    @property
    def engine(self) -> str:
        """Name and version, for `Waveforms.engine`."""
        return f"ngspice-{self.version}"


def find_simulator(path: str | None = None) -> Simulator:
    """Return the ngspice at `path`, else at ``$TACTION_NGSPICE``, else on the PATH.

    SimulatorNotFound: there is no such executable, or the executable is not ngspice.
    SimulatorTooOld: the version is below `OLDEST`.
    """
    name = path or os.environ.get("TACTION_NGSPICE") or "ngspice"
    executable = shutil.which(name)
    if executable is None:
        raise SimulatorNotFound(f"no executable {name!r}. {REMEDY}")
    return _probe(str(Path(executable).absolute()))


def missing_simulator() -> str:
    """Return why there is no ngspice that can be used, on one line; empty if there is one."""
    try:
        find_simulator()
    except SimulationError as error:
        return one_line(error)
    return ""


@cache
def _probe(executable: str) -> Simulator:
    """Return the simulator; its version is read once in each Python process."""
    try:
        status, answer = _answer(executable)
    except OSError as error:
        raise SimulatorNotFound(f"{executable} does not run: {error}. {REMEDY}") from error
    if status < 0 and status != -signal.SIGXFSZ:
        name = signal.Signals(-status).name
        raise SimulatorNotFound(f"{executable} -v was ended by {name}. Run the command again")
    named = re.search(r"ngspice-(\d{1,6})(?!\d)", answer)
    if named is None:
        text = f"{executable} -v does not name ngspice. {REMEDY}"
        raise SimulatorNotFound(text, log=answer[:SHOWN])
    version = int(named[1])
    if version < OLDEST:
        raise SimulatorTooOld(f"{executable} is ngspice {version}; {OLDEST} is needed. {REMEDY}")
    return Simulator(executable, version, klu="KLU" in answer)


def _answer(executable: str) -> tuple[int, str]:
    """Return the exit status of ``-v``, and what it prints within all limits."""
    with tempfile.TemporaryFile() as answer:
        process = subprocess.Popen(
            [executable, "-v"],
            stdin=subprocess.DEVNULL,
            stdout=answer,
            stderr=subprocess.STDOUT,
            env=environment("/nonexistent"),
            start_new_session=True,
        )
        _limit(process, resource.RLIMIT_FSIZE, LONGEST_ANSWER)
        with contextlib.suppress(subprocess.TimeoutExpired):
            process.wait(PATIENCE)
        status = process.returncode or 0  # 0, too, of one that never ends
        with contextlib.suppress(ProcessLookupError):
            os.killpg(process.pid, signal.SIGKILL)
        process.wait()
        answer.seek(0)
        return status, answer.read().decode(errors="replace")


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
        _limit(self._process, resource.RLIMIT_FSIZE, LONGEST_RESULT)
        _limit(self._process, resource.RLIMIT_AS, memory)

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


def _limit(process: subprocess.Popen[bytes], kind: int, most: int) -> None:
    """Limit a process, and what it becomes, to `most`, or to less where it has less."""
    with contextlib.suppress(ProcessLookupError):  # it has ended
        known = resource.prlimit(process.pid, kind)
        least = min([most, *(limit for limit in known if limit >= 0)])  # -1 is no limit
        resource.prlimit(process.pid, kind, (least, least))


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
