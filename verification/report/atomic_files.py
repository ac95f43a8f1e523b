"""Output files: refused before any work is done, and written completely or not at all."""

from __future__ import annotations

import contextlib
import importlib.util
import os
import tempfile
from collections.abc import Collection, Iterable, Iterator, Mapping
from pathlib import Path

from netlist_gen.scene.file import load_scene
from spice_models.errors import Complaint, InputError
from verification.studies.running.digests import files_of


def check_folder(path: str | Path, option: str) -> None:
    """Refuse a file whose folder is missing, before any work is done.

    Raises
    ------
    InputError
        The folder does not exist, or `path` is a folder.
    """
    file = Path(path)
    if not file.parent.is_dir():
        raise InputError(option, Complaint("FILE", repr(str(path)), "its folder does not exist"))
    if file.is_dir():
        raise InputError(option, Complaint("FILE", repr(str(path)), "a folder; expected a file"))


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
    return [name, *(scene.folder / str(file) for file in files_of(scene).values() if file)]


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


def write_atomically(path: str | Path, content: str | bytes) -> None:
    """Write `content` to `path` by `replacing`."""
    with replacing(path) as file:
        file.write_bytes(content.encode() if isinstance(content, str) else content)


@contextlib.contextmanager
def replacing(path: str | Path) -> Iterator[Path]:
    """Give a file beside `path` to write to, and move it to `path` when it is complete.

    A full disk or a killed process leaves an older file at `path` unchanged. A link is followed.

    Raises
    ------
    InputError
        The file cannot be written.
    """
    target = Path(os.path.realpath(path))
    try:
        if target.exists() and not target.is_file():  # such as /dev/stdout or a named pipe
            yield target
            return
        prefix = f".{target.name}."
        handle, name = tempfile.mkstemp(prefix=prefix, suffix=target.suffix, dir=target.parent)
        temporary = Path(name)
        try:
            os.close(handle)
            yield temporary
            with temporary.open("rb+") as file:
                os.fsync(file.fileno())
            temporary.chmod(_mode(target))
            temporary.replace(target)
        finally:
            temporary.unlink(missing_ok=True)
    except OSError as error:
        reason = f"{error.strerror or error}; nothing was written, an older file is unchanged"
        raise InputError(path, Complaint("FILE", "", reason)) from None


def _mode(target: Path) -> int:
    """Return the permissions of the old file, or those of a new file in this process."""
    if target.exists():
        return target.stat().st_mode & 0o777
    umask = os.umask(0)
    os.umask(umask)
    return 0o666 & ~umask
