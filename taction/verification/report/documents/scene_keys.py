"""Every key of a scene with its value in base units, defaults and derived values filled in."""

from __future__ import annotations

import hashlib
from dataclasses import dataclass
from operator import attrgetter
from typing import Annotated, Any

import numpy as np

from taction.netlist_gen.board.opamp_choice import choose_opamp
from taction.netlist_gen.scene.keys import Key, Value, all_keys, files_of, own_value
from taction.netlist_gen.scene.scene import Scene
from taction.system.documents import OPTIONAL
from taction.system.errors import TactionError
from taction.system.foreign_files import LARGEST, UnusableFileError, read_bounded
from taction.system.output_files import printable
from taction.verification.verdict.record import finite


@dataclass(frozen=True, slots=True)
class KeyValue:
    """A key of the scene in base units; a file has the SHA-256 of its content."""

    value: Value | None
    unit: str | None
    sha256: Annotated[str | None, OPTIONAL] = None


def scene_keys(scene: Scene) -> dict[str, KeyValue]:
    """Return the value and the unit of each key by its path, as a scene file has it.

    A file has the SHA-256 of its content beside its name, so that two scenes with the same name in
    two folders can be told apart.

    Examples
    --------
    >>> from taction.netlist_gen.scene.loading import load_scene
    >>> keys = scene_keys(load_scene("scenes/paper-breadboard.toml"))
    >>> keys["design.opamp.gbw"]
    KeyValue(value=718000.0, unit='Hz', sha256=None)
    """
    files = files_of(scene)
    found = {}
    for key in all_keys(scene):
        file = files.get(key.path)
        content = None if file is None else _content(scene, file)
        found[key.path] = KeyValue(_value(scene, key), key.unit or None, content)
    return found


def _value(scene: Scene, key: Key) -> Any:
    """Return the value of a key; an infinite number is None, as in JSON."""
    try:
        number = own_value(scene, key) if key.kind == "real" else None
    except TactionError:  # what cannot be derived, such as lambda of a rule
        number = None
    value = _written(scene, key.path) if number is None else number
    if value is None and key.path.startswith("design.opamp."):
        value = getattr(choose_opamp(scene), key.path.rpartition(".")[2], None)
    if isinstance(value, np.ndarray):
        return f"array {' x '.join(map(str, value.shape))}"
    if isinstance(value, float):
        return finite(value)
    return printable(value) if isinstance(value, str) else value


def _written(scene: Scene, path: str) -> Any:
    table, _, last = path.rpartition(".")
    model = attrgetter(table)(scene) if table else scene
    fields = type(model).model_fields
    return getattr(model, next(n for n, field in fields.items() if last in (n, field.alias)))


def _content(scene: Scene, name: Any) -> str | None:
    if isinstance(name, np.ndarray):
        return hashlib.sha256(np.ascontiguousarray(name, dtype="<f8").tobytes()).hexdigest()
    try:
        return hashlib.sha256(read_bounded(scene.folder / str(name), LARGEST)).hexdigest()
    except UnusableFileError:  # gone since the run
        return None
