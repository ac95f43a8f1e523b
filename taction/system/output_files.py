"""Files to write: those that cannot be written are refused before any work; names as text."""

from __future__ import annotations

import importlib.util
import os
from collections.abc import Collection, Mapping
from pathlib import Path

from taction.system.atomic_files import PREFIX
from taction.system.errors import Complaint, InputError


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
    elif not is_special(path) and not os.access(file.parent, os.W_OK | os.X_OK):
        text = "you may not write to its folder; expected a file in another one"
    if text:
        raise InputError(option, Complaint("FILE", repr(str(path)), text))


def is_special(path: str | Path) -> bool:
    """Whether there is a device or a pipe, which several outputs may share."""
    return Path(path).exists() and not Path(path).is_file()


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


def check_package(package: str, remedy: str, option: str) -> None:
    """Refuse work that needs a package which is not installed.

    Raises
    ------
    InputError
        The package is missing; the message has the `remedy`.
    """
    if importlib.util.find_spec(package) is None:
        raise InputError(option, Complaint("package", repr(package), remedy))


def make_folder(folder: str | Path, option: str = "-o") -> None:
    """Make a missing folder.

    Raises
    ------
    InputError
        `folder` is a file, or cannot be made.
    """
    try:
        Path(folder).mkdir(parents=True, exist_ok=True)
    except (OSError, ValueError) as error:  # a name with a zero byte is a ValueError
        reason = f"cannot be made: {getattr(error, 'strerror', error)}"
        raise InputError(option, Complaint("FOLDER", repr(str(folder)), reason)) from None


def check_empty_folder(folder: str | Path, option: str = "-o") -> None:
    """Refuse a folder with files.

    Raises
    ------
    InputError
        `folder` is not empty, or a file.
    """
    text = ""
    if Path(folder).is_dir():
        text = "the folder is not empty; give another name" if os.listdir(folder) else ""  # noqa: PTH208 - names are enough
    elif Path(folder).exists():
        text = "a file; expected a folder"
    if text:
        raise InputError(option, Complaint("FOLDER", repr(str(folder)), text))


def check_own_folder(folder: str | Path, files: Collection[str], option: str = "-o") -> None:
    """Refuse a folder that cannot be written, or that holds other files, before any work is done.

    Parameters
    ----------
    files : collection of str
        The files that will be written, below `folder`; older ones will be replaced.

    Raises
    ------
    InputError
        `folder` is a file, may not be written, or holds a link or what is not one of
        `files`.
    """
    place, text = Path(folder), ""
    there = next(each for each in (place, *place.absolute().parents) if os.path.lexists(each))
    if not there.is_dir():
        text = "a file; expected a folder" if there == place else f"{there} is a file"
    elif not os.access(there, os.W_OK | os.X_OK):
        text = f"you may not write to {there}; expected another folder"
    elif there == place:
        own = {Path(name) for name in files}
        folders = {each.parent for each in own} - {Path()}
        inside = [Path(), *(each for each in folders if (place / each).is_dir())]
        found = {
            each / name
            for each in inside
            for name in os.listdir(place / each)  # noqa: PTH208 - names are enough
            if not name.startswith(PREFIX)
        }
        foreign = sorted(map(str, found - own - folders))
        links = sorted(str(each) for each in found if (place / each).is_symlink())
        if foreign:
            named = ", ".join(map(repr, foreign[:3])) + (", ..." if foreign[3:] else "")
            text = f"it holds {named}, not written by this command; expected a new or empty folder"
        elif links:  # a file would be written where it leads
            text = f"{links[0]!r} in it is a link; expected a folder without links"
    if text:
        raise InputError(option, Complaint("FOLDER", repr(str(folder)), text))


def printable(text: str) -> str:
    r"""Return `text` so that every encoding and every format can hold it.

    Python reads a byte of a file name that is not UTF-8 as half of a surrogate pair, which strict
    readers of JSON and XML refuse; here it becomes six plain characters.

    >>> print(printable("board-\udcff.toml"))
    board-\udcff.toml
    """
    return text.encode(errors="backslashreplace").decode()
