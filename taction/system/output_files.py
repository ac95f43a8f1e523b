"""Output files: refused before any work if they cannot be written, written whole or not at all."""

from __future__ import annotations

import contextlib
import errno
import importlib.util
import os
import re
import shutil
import stat
import tempfile
import time
from collections.abc import Collection, Iterator, Mapping
from pathlib import Path

from taction.system.errors import Complaint, InputError
from taction.system.processes import own_folder

PREFIX = ".taction-"  # of a file that is being written, beside the file that it will replace
LONGEST_ENDING = 16  # characters
ABANDONED = 3600.0  # s since the last write to a file: nobody writes to it any more


def write_atomically(path: str | Path, content: str) -> None:
    """Write a text to `path` by `replacing`, as UTF-8; see `printable`."""
    write_together({Path(path): content})


def write_together(files: Mapping[Path, str]) -> None:
    """Write several texts, all or none: they go to their places when all are complete."""
    with contextlib.ExitStack() as stack:
        for file, text in files.items():
            data = text.encode(errors="backslashreplace")
            stack.enter_context(replacing(file)).write_bytes(data)


@contextlib.contextmanager
def replacing(path: str | Path) -> Iterator[Path]:
    """Give a file to write to, and move it to `path` when it is complete; InputError if it cannot.

    A full disk or a killed process leaves an older file at `path` unchanged. A link is followed;
    a device or a pipe receives the complete content.
    """
    try:
        if not is_special(path):
            with _beside(Path(os.path.realpath(path))) as file:
                yield file
            return
        with own_folder() as folder:
            file = folder / f"output{_ending(Path(path))}"
            yield file
            with file.open("rb") as source, Path(path).open("wb") as opened:
                shutil.copyfileobj(source, opened)
    except BrokenPipeError:
        raise
    except (OSError, ValueError) as error:  # a name with a zero byte is a ValueError
        missing = isinstance(error, FileNotFoundError)
        reason = "its folder does not exist" if missing else getattr(error, "strerror", error)
        text = f"{reason}; expected a file that can be written. An older file is unchanged"
        raise InputError(path, Complaint("FILE", "", text)) from None


@contextlib.contextmanager
def _beside(target: Path) -> Iterator[Path]:
    """Give a new file in the folder of `target`, and move it there when it is complete."""
    if target.exists() and not os.access(target, os.W_OK):
        raise PermissionError(errno.EACCES, os.strerror(errno.EACCES))
    clear_unfinished(target.parent)
    number, name = tempfile.mkstemp(prefix=PREFIX, suffix=_ending(target), dir=target.parent)
    os.close(number)
    temporary = Path(name)
    try:
        yield temporary
        umask = os.umask(0)
        os.umask(umask)
        temporary.chmod(target.stat().st_mode & 0o7777 if target.exists() else 0o666 & ~umask)
        with temporary.open("rb+") as file:
            os.fsync(file.fileno())
        temporary.replace(target)
        with contextlib.suppress(OSError):  # the new name survives a power cut, if the system can
            number = os.open(target.parent, os.O_RDONLY)
            try:
                os.fsync(number)
            finally:
                os.close(number)
    finally:
        temporary.unlink(missing_ok=True)


def clear_unfinished(folder: Path) -> None:
    """Remove the files in `folder` that killed processes left unfinished, after an hour."""
    for file in folder.glob(f"{PREFIX}*"):
        with contextlib.suppress(OSError):
            status = file.lstat()
            if stat.S_ISREG(status.st_mode) and time.time() - status.st_mtime > ABANDONED:
                file.unlink()


def _ending(target: Path) -> str:
    """Return the ending of a name, by which libraries choose the format."""
    return target.suffix if len(target.suffix) <= LONGEST_ENDING else ""


def is_special(path: str | Path) -> bool:
    """Whether there is a device, a pipe or a socket, which several outputs may share."""
    try:
        mode = os.stat(path).st_mode  # noqa: PTH116 - links in a circle, a zero byte: its errors
    except FileNotFoundError:
        return False
    return not stat.S_ISREG(mode) and not stat.S_ISDIR(mode)


def check_folder(path: str | Path, option: str) -> None:
    """Refuse a folder, or a file whose folder is missing or read-only, before any work is done."""
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


ENDINGS = {
    "--plot": dict.fromkeys((".png", ".svg", ".pdf"), "plot"),
    "--report": dict.fromkeys((".html", ".htm"), "report"),
    "--export": {".csv": "", ".parquet": "parquet"},
}
"""By option: the endings of its file in lower case, with the extra of taction that each needs."""


def check_file(path: str, option: str, own: Mapping[str, str] | None = None) -> None:
    """Refuse a file that could not be written, before any work is done.

    `own`: endings and extras as in `ENDINGS`, which has those of the option otherwise.
    """
    endings = ENDINGS[option] if own is None else own
    ending = Path(path).suffix.lower()
    if ending not in endings:
        text = f"expected a file that ends in {', '.join(endings)}"
        raise InputError(option, Complaint("FILE", repr(path), text))
    check_folder(path, option)
    if extra := endings[ending]:
        free = " or ".join(each for each, needed in endings.items() if not needed)
        check_extra(extra, option, f"; or write {free}" if free else "")


def check_extra(extra: str, option: str, otherwise: str = "") -> None:
    """Refuse work that needs an extra of taction of which a package is not installed."""
    from importlib import metadata  # it loads the package email

    own = re.compile(rf"([\w-]+).*; extra == ['\"]{extra}['\"]")
    needs = [found[1] for each in metadata.requires("taction") or () if (found := own.match(each))]
    if missing := [name for name in needs if importlib.util.find_spec(name) is None]:
        text = f"needs {' and '.join(missing)}: pip install 'taction[{extra}]'{otherwise}"
        raise InputError(option, Complaint("packages", "", text))


def make_folder(folder: str | Path) -> None:
    """Make a missing folder of the option ``-o``; InputError where that is not possible."""
    try:
        Path(folder).mkdir(parents=True, exist_ok=True)
    except (OSError, ValueError) as error:  # a name with a zero byte is a ValueError
        reason = f"cannot be made: {getattr(error, 'strerror', error)}"
        raise InputError("-o", Complaint("FOLDER", repr(str(folder)), reason)) from None


def check_own_folder(folder: str | Path, files: Collection[str] = ()) -> None:
    """Refuse a folder of ``-o`` that cannot be written, or holds links or others than `files`."""
    place, text = Path(folder), ""
    there = next(each for each in (place, *place.absolute().parents) if os.path.lexists(each))
    if not there.is_dir():
        text = "a file; expected a folder" if there == place else f"{there} is a file"
    elif not os.access(there, os.W_OK | os.X_OK):
        text = f"you may not write to {there}; expected another folder"
    elif there == place:
        own = {*files, *(str(above) for name in files for above in Path(name).parents)}
        found = sorted(each for each in place.rglob("*") if PREFIX not in each.name)
        names = [str(each.relative_to(place)) for each in found]
        if foreign := [repr(name) for name in names if name not in own]:
            named = ", ".join(foreign[:3]) + (", ..." if foreign[3:] else "")
            text = f"it holds {named}, not written by this command; expected a new or empty folder"
        elif links := [each.name for each in found if each.is_symlink()]:
            # A file would be written where it leads.
            text = f"{links[0]!r} in it is a link; expected a folder without links"
    if text:
        raise InputError("-o", Complaint("FOLDER", repr(str(folder)), text))


def printable(text: str) -> str:
    r"""Return `text` with the bytes of a file name that are not UTF-8 as six plain characters.

    Python reads them as halves of surrogate pairs, which strict readers of JSON and XML refuse.
    """
    return text.encode(errors="backslashreplace").decode()
