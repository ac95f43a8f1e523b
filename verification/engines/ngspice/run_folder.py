"""Make the working folder of an ngspice process.

The folder is on disk, where results may be large, and stays after a failure.
"""

from __future__ import annotations

from pathlib import Path

from taction.system.errors import Complaint, InputError, OutOfDisk
from taction.system.own_folders import make_own_folder, remove_own_folder
from taction.verification.engines.ngspice.screening import Deck


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
        place = make_own_folder() if folder is None else _empty(folder)
    except OSError as error:
        raise OutOfDisk(f"the run folder cannot be made: {error}") from error
    try:
        for name, text in texts.items():
            with open(f"{place}/{name}", "xb") as file:  # noqa: PTH123 - half of Path.open's time
                file.write(text.encode())
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
