"""Which ngspice is there, and the environment it runs in."""

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
_INHERITED = ("LD_LIBRARY_PATH",)  # an ngspice outside the system's folders may need it


def environment(home: Path) -> dict[str, str]:
    """Return the whole environment of a process whose home, and start-up files, are in `home`."""
    inherited = {name: os.environ[name] for name in _INHERITED if name in os.environ}
    return inherited | {
        "LC_ALL": "C",
        "HOME": str(home),
        "SPICE_SCRIPTS": str(home),  # where it looks for spinit, which loads code models
        "OMP_NUM_THREADS": "1",
    }


@dataclass(frozen=True, slots=True)
class Simulator:
    """An ngspice executable.

    Attributes
    ----------
    executable : str
        Absolute path.
    version : int
        Major version.
    klu : bool
        Whether it has the KLU direct solver.
    """

    executable: str
    version: int
    klu: bool

    @property
    def solver_option(self) -> str:
        """The fastest linear solver this version has, as a word for the ``.options`` card.

        39 ignores ``klu`` in silence; with ``noopiter`` its own solver is 3 to 5 times faster.
        """
        return "klu" if self.klu else "noopiter"

    @property
    def engine(self) -> str:
        """Name and version, for `Waveforms.engine`."""
        return f"ngspice-{self.version}"


def find_simulator(path: str | None = None) -> Simulator:
    """Return the ngspice at `path`, else at ``$TACTION_NGSPICE``, else on the PATH.

    It is asked for its version once a process.

    Raises
    ------
    SimulatorNotFound
        No such executable, or it is not ngspice.
    SimulatorTooOld
        Below `OLDEST`.
    """
    wanted = path or os.environ.get("TACTION_NGSPICE") or "ngspice"
    if os.sep in wanted:
        return _probe(_absolute(wanted, None))
    return _probe(_on_path(wanted, os.environ.get("PATH")))


@functools.cache  # a search costs 0.1 ms; a failure is not remembered
def _on_path(name: str, folders: str | None) -> str:
    return _absolute(name, folders)


def _absolute(wanted: str, folders: str | None) -> str:
    found = shutil.which(wanted, path=folders)
    if found is None:
        raise SimulatorNotFound(f"no executable {wanted!r}. {_REMEDY}")
    return str(Path(found).absolute())


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
    found = re.search(r"ngspice-(\d+)", answer)
    if found is None:
        raise SimulatorNotFound(f"{executable} -v does not name ngspice. {_REMEDY}", log=answer)
    version = int(found[1])
    if version < OLDEST:
        raise SimulatorTooOld(f"{executable} is ngspice {version}; {OLDEST} is needed. {_REMEDY}")
    return Simulator(executable, version, klu="KLU" in answer)
