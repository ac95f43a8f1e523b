"""Find the ngspice executable, and define the environment that it runs in."""

from __future__ import annotations

import functools
import os
import re
import shutil
import subprocess
from dataclasses import dataclass
from pathlib import Path

from spice_models.errors import SimulatorNotFound, SimulatorTooOld

OLDEST = 39
"""Oldest supported version (Debian 12)."""

_REMEDY = (
    "Install it with `apt-get install ngspice` (Debian 12: `-t bookworm-backports` gives 46, which"
    " has the fast KLU solver), or name the executable in TACTION_NGSPICE"
)
_INHERITED = ("LD_LIBRARY_PATH",)  # an ngspice in a folder of its own may need it


def environment(home: Path) -> dict[str, str]:
    """Return the complete environment of a process with its home and start-up files in `home`."""
    inherited = {name: os.environ[name] for name in _INHERITED if name in os.environ}
    return inherited | {
        "LC_ALL": "C",
        "HOME": str(home),
        "SPICE_SCRIPTS": str(home),  # the folder of spinit, which loads code models
        "OMP_NUM_THREADS": "1",
    }


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

    @property
    def engine(self) -> str:
        """Name and version, for `Waveforms.engine`."""
        return f"ngspice-{self.version}"


def find_simulator(path: str | None = None) -> Simulator:
    """Return the ngspice at `path`, else at ``$TACTION_NGSPICE``, else on the PATH.

    Its version is read once in each Python process.

    Raises
    ------
    SimulatorNotFound
        There is no such executable, or the executable is not ngspice.
    SimulatorTooOld
        The version is below `OLDEST`.
    """
    name = path or os.environ.get("TACTION_NGSPICE") or "ngspice"
    if os.sep in name:
        return _probe(_absolute(name, None))
    return _probe(_on_path(name, os.environ.get("PATH")))


def _absolute(name: str, folders: str | None) -> str:
    executable = shutil.which(name, path=folders)
    if executable is None:
        raise SimulatorNotFound(f"no executable {name!r}. {_REMEDY}")
    return str(Path(executable).absolute())


_on_path = functools.cache(_absolute)  # a search costs 0.1 ms; a failure is not cached


@functools.cache
def _probe(executable: str) -> Simulator:
    try:
        answer = subprocess.run(
            [executable, "-v"],
            stdin=subprocess.DEVNULL,
            capture_output=True,
            text=True,
            errors="replace",
            env=environment(Path("/nonexistent")),
            timeout=20.0,
            check=False,
        ).stdout
    except (OSError, subprocess.TimeoutExpired) as error:
        raise SimulatorNotFound(f"{executable} does not run: {error}. {_REMEDY}") from error
    name = re.search(r"ngspice-(\d+)", answer)
    if name is None:
        raise SimulatorNotFound(f"{executable} -v does not name ngspice. {_REMEDY}", log=answer)
    version = int(name[1])
    if version < OLDEST:
        raise SimulatorTooOld(f"{executable} is ngspice {version}; {OLDEST} is needed. {_REMEDY}")
    return Simulator(executable, version, klu="KLU" in answer)
