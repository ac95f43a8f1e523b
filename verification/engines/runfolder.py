"""The folder of an ngspice run: where it is made, what stands in it, and where it is kept.

A run needs a folder for a fraction of a second. Where the system has a file system in memory and
the result is sure to fit, it is made there. On ext4, which reuses no inode within minutes of its
deletion and steps over all of those at each new file, the folder of a run costs a sweep 1 to 4 ms
of a processor; in memory 0.2. What is kept, after a failure or because somebody asks for it, is
kept on disk.
"""

from __future__ import annotations

import contextlib
import os
import shutil
import tempfile
from pathlib import Path

from netlist_gen.analysis import Transient
from spice_models.errors import Complaint, InputError, OutOfDisk
from verification.engines.screening import Deck

MEMORY = Path("/dev/shm")  # noqa: S108 - Linux has it; folders in it get names nobody can guess
LEAST_FREE = 1 << 30  # bytes
SHARE = 0.01  # of what is free, for the result as the largest step foresees it
_PREFIX = "taction-"
_CHOICES = ("TMPDIR", "TEMP", "TMP")  # where somebody wants temporary files


def make_folder(deck: Deck, command: str, folder: Path | None, *, keep: bool) -> Path:
    """Make the run folder and write everything a run, or somebody who repeats it, needs.

    Parameters
    ----------
    command : str
        The command line that repeats the run from within its folder.
    folder : Path or None
        The folder, which must not exist or be empty; a fresh temporary one if not given.
    keep : bool
        Whether it is to stay after a success.

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
        if folder is not None:
            place = _empty(folder)
        else:
            place = _on_disk() if keep else fresh_folder(_size(deck))
        for name, text in texts.items():
            with open(f"{place}/{name}", "xb") as file:  # noqa: PTH123 - half of Path.open's time
                file.write(text.encode())
    except OSError as error:
        raise OutOfDisk(f"the run folder cannot be written: {error}") from error
    return place


def keep_folder(place: Path) -> Path:
    """Return where a temporary run folder stays: from memory it moves to disk that has room."""
    if place.parent != MEMORY:
        return place
    with contextlib.suppress(OSError):
        kept = shutil.copytree(place, _on_disk(), symlinks=True, dirs_exist_ok=True)
        shutil.rmtree(place)
        return kept
    return place


def remove_folder(place: Path) -> None:
    """Remove a run folder; a run makes files only, so what is usual is quick."""
    try:
        for name in os.listdir(place):  # noqa: PTH208 - names are enough
            os.unlink(f"{place}/{name}")  # noqa: PTH108
        place.rmdir()
    except OSError:
        shutil.rmtree(place)


def fresh_folder(size: float = 0.0) -> Path:
    """Make a fresh temporary folder, in memory where `size` bytes are sure to fit."""
    return Path(tempfile.mkdtemp(prefix=_PREFIX, dir=MEMORY)) if _has_room(size) else _on_disk()


def _on_disk() -> Path:
    return Path(tempfile.mkdtemp(prefix=_PREFIX))


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


def _size(deck: Deck) -> float:
    """Return about how many bytes a run will write."""
    analysis = deck.analysis
    points = analysis.stop / analysis.max_step if isinstance(analysis, Transient) else 1.0
    texts = len(deck.text) + sum(map(len, deck.files.values()))
    return 8.0 * (len(deck.saved) + 1) * points + texts
