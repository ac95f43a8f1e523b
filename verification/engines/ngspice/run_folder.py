"""Make and remove the working folder of an ngspice process.

A run's folder is on disk, where results may be large and where the folder stays after a failure. A
session's folder is in memory, because a session creates and deletes a file with every deck. On ext4
that costs 1 to 4 ms of processor time: ext4 reuses no inode within minutes of its deletion, and
skips all of those at each new file.
"""

from __future__ import annotations

import os
import shutil
import tempfile
from pathlib import Path

from spice_models.errors import Complaint, InputError, OutOfDisk
from verification.engines.ngspice.screening import Deck

MEMORY = Path("/dev/shm")  # noqa: S108 - of Linux; its folders get random names
LEAST_FREE = 1 << 30  # bytes
SHARE = 0.01  # of the free bytes, for the predicted size of the result
_PREFIX = "taction-"
_CHOICES = ("TMPDIR", "TEMP", "TMP")  # the user's choice for temporary files


def make_folder(deck: Deck, command: str, folder: Path | None) -> Path:
    """Make the run folder and write all files that a run, or a repetition of the run, needs.

    `command` is the command line that repeats the run in its folder. An existing `folder` must be
    empty; without `folder`, a new temporary folder is made.

    Raises
    ------
    InputError
        The folder is not empty.
    OutOfDisk
        The folder cannot be written.
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
    """Remove a run folder; the quick way works for a folder that holds only files."""
    try:
        for name in os.listdir(place):  # noqa: PTH208 - names are enough
            os.unlink(f"{place}/{name}")  # noqa: PTH108
        place.rmdir()
    except OSError:
        shutil.rmtree(place)


def fast_folder(size: float) -> Path:
    """Make a new temporary folder, in memory if `size` bytes certainly fit.

    A killed process leaves the folder behind: the files between two results must be small.
    """
    return Path(tempfile.mkdtemp(prefix=_PREFIX, dir=MEMORY if _has_room(size) else None))


def _empty(folder: Path) -> Path:
    place = folder.absolute()
    place.mkdir(parents=True, exist_ok=True)
    if any(place.iterdir()):
        raise InputError(place, Complaint("run folder", "", "it must be empty"))
    return place


def _has_room(size: float) -> bool:
    """Whether `MEMORY` exists and has room, and no variable of `_CHOICES` is set."""
    if any(name in os.environ for name in _CHOICES) or not os.access(MEMORY, os.W_OK | os.X_OK):
        return False
    system = os.statvfs(MEMORY)
    free = system.f_bavail * system.f_frsize
    return free >= LEAST_FREE and size <= SHARE * free
