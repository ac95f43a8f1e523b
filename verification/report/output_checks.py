"""Output files that cannot be written are refused before any work is done."""

from __future__ import annotations

import importlib.util
import os
from collections.abc import Collection, Iterable, Mapping
from pathlib import Path

from netlist_gen.scene.file import load_scene
from spice_models.errors import Complaint, InputError
from verification.studies.running.digests import files_of


def check_folder(path: str | Path, option: str) -> None:
    """Refuse a file whose folder is missing or read-only, before any work is done.

    Raises
    ------
    InputError
        The folder does not exist or nobody may write to it, or `path` is a folder.
    """
    file = Path(os.path.realpath(path))
    text = ""
    if not file.parent.is_dir():
        text = "its folder does not exist"
    elif file.is_dir():
        text = "a folder; expected a file"
    elif not _is_special(path) and not os.access(file.parent, os.W_OK | os.X_OK):
        text = "you may not write to its folder; expected a file in another one"
    if text:
        raise InputError(option, Complaint("FILE", repr(str(path)), text))


def _is_special(path: str | Path) -> bool:
    """Whether there is a device or a pipe, which several outputs may share."""
    return Path(path).exists() and not Path(path).is_file()


def check_separate(inputs: Iterable[str | None], outputs: Mapping[str, str]) -> None:
    """Refuse an output that would overwrite an input, or another output.

    Parameters
    ----------
    inputs : iterable of str or None
        Files that are read: a scene, whose files count, too, a folder of scenes, a baseline.
    outputs : mapping of str to str
        Files to write, by option.

    Raises
    ------
    InputError
        Two of the files are the same, also by another name.
    """
    taken = {os.path.realpath(file): "an input" for name in inputs if name for file in _read(name)}
    for option, name in outputs.items():
        if _is_special(name):
            continue
        place = os.path.realpath(name)
        if place in taken:
            text = f"{taken[place]} of the same command; expected another file"
            raise InputError(option, Complaint("FILE", repr(name), text))
        taken[place] = f"the file of {option}"


def _read(name: str) -> list[str | Path]:
    """Return the files that a command reads for its argument `name`."""
    path = Path(name)
    if path.is_dir():
        return [name, *path.glob("*.toml")]
    if path.suffix != ".toml":
        return [name]
    try:
        scene = load_scene(path)
    except InputError:  # the command itself will report the mistakes
        return [name]
    return [
        name,
        *(scene.folder / str(file) for file in files_of(scene).values() if isinstance(file, str)),
    ]


def check_file(
    path: str, option: str, endings: Collection[str], packages: Mapping[str, tuple[str, str]]
) -> None:
    """Refuse a file that could not be written, before any work is done.

    Parameters
    ----------
    endings : collection of str
        The file names' endings that are known, in lower case.
    packages : mapping of str to tuple of str
        By ending, the package that writes the file and the remedy for a missing package.

    Raises
    ------
    InputError
        An unknown ending, a missing folder, or a package that is not installed.
    """
    ending = Path(path).suffix.lower()
    if ending not in endings:
        text = f"expected a file that ends in {', '.join(endings)}"
        raise InputError(option, Complaint("FILE", repr(path), text))
    check_folder(path, option)
    package, remedy = packages.get(ending, ("", ""))
    if package and importlib.util.find_spec(package) is None:
        raise InputError(option, Complaint("FILE", repr(path), remedy))
