"""The folder that an ngspice works in: where it is made, and what stands in it.

A run's is on disk, where it may grow and where it is kept after a failure. A session, which makes
and removes a file at every deck, has one in memory: on ext4, which reuses no inode within minutes
of its deletion and steps over all of those at each new file, that costs 1 to 4 ms of a processor.
"""

from __future__ import annotations

import os
import shutil
import tempfile
from pathlib import Path

from spice_models.errors import Complaint, InputError, OutOfDisk
from verification.engines.ngspice.screening import Deck

MEMORY = Path("/dev/shm")  # noqa: S108 - Linux has it; folders in it get names nobody can guess
LEAST_FREE = 1 << 30  # bytes
SHARE = 0.01  # of what is free, for the result as the largest step foresees it
_PREFIX = "taction-"
_CHOICES = ("TMPDIR", "TEMP", "TMP")  # where somebody wants temporary files


def make_folder(deck: Deck, command: str, folder: Path | None) -> Path:
    """Make the run folder and write everything a run, or somebody who repeats it, needs.

    Parameters
    ----------
    command : str
        The command line that repeats the run from within its folder.
    folder : Path or None
        The folder, which must not exist or be empty; a fresh temporary one if not given.

    Raises
    ------
    InputError
        The folder is not empty.
    OutOfDisk
        It cannot be written.
    """
    texts = {
        **deck.files,
        "deck.cir": deck.text,
        "spinit": "* no code models are loaded\n",
        "command.txt": command,
    }
    try:
        place = Path(tempfile.mkdtemp(prefix=_PREFIX)) if folder is None else _empty(folder)
        for name, text in texts.items():
            with open(f"{place}/{name}", "xb") as file:  # noqa: PTH123 - half of Path.open's time
                file.write(text.encode())
    except OSError as error:
        raise OutOfDisk(f"the run folder cannot be written: {error}") from error
    return place


def remove_folder(place: Path) -> None:
    """Remove a run folder; a run makes files only, so what is usual is quick."""
    try:
        for name in os.listdir(place):  # noqa: PTH208 - names are enough
            os.unlink(f"{place}/{name}")  # noqa: PTH108
        place.rmdir()
    except OSError:
        shutil.rmtree(place)


def fast_folder(size: float) -> Path:
    """Make a fresh temporary folder, in memory where `size` bytes are sure to fit.

    A process that is killed leaves it there: what stays in it between two results must be small.
    """
    return Path(tempfile.mkdtemp(prefix=_PREFIX, dir=MEMORY if _has_room(size) else None))


def _empty(folder: Path) -> Path:
    place = folder.absolute()
    place.mkdir(parents=True, exist_ok=True)
    if any(place.iterdir()):
        raise InputError(place, Complaint("run folder", "", "it must be empty"))
    return place


def _has_room(size: float) -> bool:
    """Whether `MEMORY` is there, not short, and nobody chose another place."""
    if any(name in os.environ for name in _CHOICES) or not os.access(MEMORY, os.W_OK | os.X_OK):
        return False
    system = os.statvfs(MEMORY)
    free = system.f_bavail * system.f_frsize
    return free >= LEAST_FREE and size <= SHARE * free
