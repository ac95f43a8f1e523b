"""The scene files that a command reads: those named, those of folders, less the excluded."""

from __future__ import annotations

import fnmatch
from collections.abc import Sequence
from pathlib import Path

from taction.system.errors import Complaint, InputError


def find_scenes(folder: str | Path) -> tuple[Path, ...]:
    """Return the ``*.toml`` files of `folder`, by name.

    Raises
    ------
    InputError
        There is no such folder, or it holds no scene.
    """
    folder = Path(folder)
    if not folder.is_dir():
        raise InputError(folder, Complaint("DIR", "", "no such folder; expected one with scenes"))
    files = tuple(sorted(path for path in folder.glob("*.toml") if path.is_file()))
    if not files:
        raise InputError(folder, Complaint("DIR", "", "holds no scene; expected *.toml files"))
    return files


def scene_files(names: Sequence[str], exclude: Sequence[str] = ()) -> tuple[Path, ...]:
    """Return the files of `names`, in their order: files, and the ``*.toml`` files of folders.

    Parameters
    ----------
    names : sequence of str
        Paths. A file that is named twice, also by its folder, is read once.
    exclude : sequence of str
        Patterns as in a shell (``*``, ``?``, ``[abc]``); a file whose name, or whose whole path,
        matches one is left out.

    Raises
    ------
    InputError
        A folder without scenes, a pattern that matches no file, or no file is left.

    Examples
    --------
    >>> [path.name for path in scene_files(["scenes"], ["*exponential*", "e*", "[bcilnrw]*"])]
    ['known-readings.toml', 'paper-breadboard.toml', 'tuned-breadboard.toml']
    """
    found: dict[Path, Path] = {}
    for name in names:
        for path in find_scenes(name) if Path(name).is_dir() else (Path(name),):
            found.setdefault(path.absolute(), path)
    files = tuple(found.values())
    for pattern in exclude:
        if not any(_matches(path, pattern) for path in files):
            text = f"matches no file; the files are {', '.join(str(path) for path in files)}"
            raise InputError("--exclude", Complaint("PATTERN", repr(pattern), text))
    left = tuple(p for p in files if not any(_matches(p, pattern) for pattern in exclude))
    if not left:
        text = "leaves no scene; expected patterns that keep at least one file"
        raise InputError("--exclude", Complaint("PATTERN", ", ".join(map(repr, exclude)), text))
    return left


def _matches(path: Path, pattern: str) -> bool:
    return any(fnmatch.fnmatch(name, pattern) for name in (path.name, path.as_posix()))
