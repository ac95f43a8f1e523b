"""Outputs that cannot be written or overwrite other files are refused before any work is done."""

from __future__ import annotations

import importlib.util
import os
from collections.abc import Iterable, Mapping
from pathlib import Path

from taction.netlist_gen.scene.loading import load_scene
from taction.system.errors import Complaint, InputError
from taction.system.output_files import check_file as check_file
from taction.system.output_files import check_folder as check_folder
from taction.system.output_files import is_special

PACKAGES = ("jinja2", "plotly")  # of a report
REMEDY = "needs {}: pip install 'taction[report]'"
ENDINGS = (".html", ".htm")


def check_report_file(path: str) -> None:
    """Refuse with InputError a report that could not be written, before any work is done.

    Its ending is not in `ENDINGS`, its folder is missing, or a package is not installed.
    """
    check_file(path, "--report", ENDINGS, {})
    check_packages("--report", path)


def check_packages(option: str, path: str) -> None:
    """Refuse a report for which a package is not installed; InputError has the remedy."""
    missing = [name for name in PACKAGES if importlib.util.find_spec(name) is None]
    if missing:
        text = REMEDY.format(" and ".join(missing))
        raise InputError(option, Complaint("FILE", repr(path), text))


def check_separate(inputs: Iterable[str | None], outputs: Mapping[str, str]) -> None:
    """Refuse with InputError an output, by option, that would overwrite an input or another output.

    `inputs` are files that are read: a scene, whose files count, too, a folder of scenes, a
    baseline. A file may have several names.
    """
    taken = {os.path.realpath(file): "an input" for name in inputs if name for file in _read(name)}
    for option, name in outputs.items():
        if is_special(name):
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
    from taction.netlist_gen.scene.keys import files_of  # it loads the models of scenes

    return [
        name,
        *(scene.folder / str(file) for file in files_of(scene).values() if isinstance(file, str)),
    ]
