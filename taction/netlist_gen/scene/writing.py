"""A scene as the text of a scene file: the keys that it has, without comments."""

from __future__ import annotations

import json
import math
import os
import re
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Any

from taction.netlist_gen.scene.keys import all_keys
from taction.netlist_gen.scene.scene import Scene
from taction.system.atomic_files import write_atomically
from taction.system.quantities import written

FILES = ("matrix", "strain", "stress", "file")  # keys that are files
_BARE = re.compile(r"[A-Za-z0-9_-]+")  # a key of TOML without quotes


def scene_text(scene: Scene, folder: str | Path | None = None) -> str:
    r"""Return a scene file that reads as `scene`; its name and regression are those of `scene`.

    Parameters
    ----------
    folder : path, optional
        Where the text will stand, by default beside the scene's own file: names of files are
        relative to it.

    Examples
    --------
    >>> from taction.netlist_gen.scene.scene import parse_scene
    >>> data = {"problem": {"kind": "tactile"}, "design": {"opamp": {"base": "tl084"}}}
    >>> print(scene_text(parse_scene(data, "scene.toml")))
    [problem]
    kind = "tactile"
    <BLANKLINE>
    [design]
    opamp = { base = "tl084" }
    <BLANKLINE>

    Quantities stand as an engineer writes them, where that reads as exactly the same number:

    >>> data["design"] = {"gain": 2400.0}
    >>> print(scene_text(parse_scene(data, "scene.toml")).splitlines()[4])
    gain = "2.4kohm"
    """
    units = {key.path: key.unit for key in all_keys(scene) if key.unit}
    data = scene.model_dump(by_alias=True, exclude_unset=True)
    if folder is not None:
        _move(data, scene.folder, Path(folder))
    plain = [f"{key} = {_value(v, key, units)}" for key, v in data.items() if type(v) is not dict]
    tables = [plain] if plain else []
    for name, table in data.items():
        if isinstance(table, dict):
            tables.append([f"[{name}]", *_lines(table, f"{name}.", units)])
    return "\n\n".join("\n".join(lines) for lines in tables) + "\n"


def _move(table: dict[str, Any], before: Path, after: Path) -> None:
    for key, value in table.items():
        if isinstance(value, dict):
            _move(value, before, after)
        elif key in FILES and isinstance(value, str):
            moved = os.path.relpath(before / value, after)
            table[key] = Path(moved).as_posix()


def _lines(table: Mapping[str, Any], prefix: str, units: Mapping[str, str]) -> Iterator[str]:
    for key, value in table.items():
        if value is not None:
            name = key if _BARE.fullmatch(key) else _quoted(key)
            yield f"{name} = {_value(value, prefix + key, units)}"


def _value(value: Any, path: str, units: Mapping[str, str]) -> str:
    """Return a value as TOML has it; `path` is its key, `units` those of all keys."""
    if isinstance(value, Mapping):
        inner = ", ".join(_lines(value, f"{path}.", units))
        return f"{{ {inner} }}" if inner else "{}"
    if isinstance(value, bool):
        return str(value).lower()
    if isinstance(value, str):
        return _quoted(value)
    if isinstance(value, float):
        if not math.isfinite(value):
            return "inf" if value > 0 else "-inf"
        return written(value, units.get(path, ""))
    if hasattr(value, "tolist"):  # an array in the file
        return repr(value.tolist())
    return repr(value)


def _quoted(text: str) -> str:
    """Return a basic string of TOML."""
    return json.dumps(text, ensure_ascii=False).replace("\x7f", "\\u007f")


def write_scene(scene: Scene, output: str | Path) -> None:
    """Write a scene file; names of files in it are relative to its folder."""
    write_atomically(Path(output), scene_text(scene, Path(output).parent))
