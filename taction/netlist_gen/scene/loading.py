"""`load_scene`: the scene of a file, or all its mistakes with their places."""

from __future__ import annotations

import re
import tomllib
from pathlib import Path
from typing import Any

from taction.netlist_gen.scene.mistakes import toml_complaint, with_places
from taction.netlist_gen.scene.scene import Scene, parse_scene
from taction.system.errors import Complaint, InputError
from taction.system.foreign_files import MEGABYTE, UnusableFileError, read_text
from taction.system.quantities import number

MAX_BYTES = MEGABYTE
DEEPEST = 50  # parts of a dotted key
_PART = r"""(?:[\w-]++|"[^"\n]*+"|'[^'\n]*+')[ \t]*+"""
_DEEP = re.compile(rf"(?<![\w-])(?:{_PART}\.[ \t]*+){{{DEEPEST}}}")


def load_scene(path: str | Path) -> Scene:
    """Read and validate the scene at `path`.

    Raises
    ------
    InputError
        The file cannot be read, is not TOML, or is not a scene; `complaints` lists all mistakes.

    Examples
    --------
    >>> import taction
    >>> scene = taction.load_scene("scenes/paper-breadboard.toml")
    >>> scene.design.capacitance, scene.problem.channels
    (1e-11, 7)
    """
    path = Path(path)
    data, text = read_toml(path, "a scene file in TOML; `taction new` writes one")
    try:
        return parse_scene(data, path)
    except InputError as error:
        raise with_places(error, text) from None


def read_toml(path: Path, accepted: str) -> tuple[dict[str, Any], str]:
    """Return the data of a file, and its text, or refuse it with what would be `accepted`."""
    try:
        text = read_text(path, MAX_BYTES)
        if _DEEP.search(text):  # tomllib takes quadratic time
            raise ValueError(f"a key of over {DEEPEST} parts")
        data = tomllib.loads(text, parse_float=lambda part: number(part.replace("_", "")))
        return data, text
    except UnusableFileError as error:
        raise InputError(path, Complaint("file", "", f"{error}; expected {accepted}")) from None
    except ValueError as error:  # no TOML, or an integer of over 4300 digits
        raise InputError(path, toml_complaint(text, error, accepted)) from None
    except RecursionError:
        text = f"nested too deeply; expected {accepted}"
        raise InputError(path, Complaint("TOML", "", text)) from None
