"""Find the ngspice executable, and define the environment that it runs in."""

from __future__ import annotations

import contextlib
import functools
import os
import re
import resource
import shutil
import signal
import subprocess
import tempfile
from dataclasses import dataclass
from pathlib import Path

from taction.system.errors import SimulationError, SimulatorNotFound, SimulatorTooOld, one_line

OLDEST = 39
"""Oldest supported version (Debian 12)."""

REMEDY = (
    "Install it with `apt-get install ngspice` (Debian 12: `-t bookworm-backports` gives 46, which"
    " has the fast KLU solver), or name the executable in TACTION_NGSPICE"
)
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


@functools.cache
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
        with contextlib.suppress(ProcessLookupError):  # it has ended
            resource.prlimit(process.pid, resource.RLIMIT_FSIZE, (LONGEST_ANSWER, LONGEST_ANSWER))
        with contextlib.suppress(subprocess.TimeoutExpired):
            process.wait(PATIENCE)
        status = process.returncode or 0  # 0, too, of one that never ends
        with contextlib.suppress(ProcessLookupError):
            os.killpg(process.pid, signal.SIGKILL)
        process.wait()
        answer.seek(0)
        return status, answer.read().decode(errors="replace")
