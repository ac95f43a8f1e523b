"""Keys of a scene by name, with type and unit, and a scene as the text of a file."""

from __future__ import annotations

import difflib
import functools
import json
import math
import os
import re
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Literal, get_args

from pydantic import BaseModel

from taction.netlist_gen.scene.fields import Shortened, Unit
from taction.netlist_gen.scene.mistakes import impossible, percentage
from taction.netlist_gen.scene.scene import Scene
from taction.system.errors import Complaint, InputError
from taction.system.output_files import write_atomically
from taction.system.quantities import number as plain_number
from taction.system.quantities import parse, written

SYMBOLS = {
    "C": "design.capacitance",
    "R": "design.resistance",
    "s": "design.gain",
    "G0": "design.unit_conductance",
    "U0": "design.unit_voltage",
    "Ve": "design.exponential_slope",
    "opamp": "design.opamp.base",
}
# Tables that are searched for a name without a path, in this order.
FILES = (
    *("problem.matrix", "problem.strain", "problem.stress", "problem.load.file"),
    "design.opamp.file",
)
SECTIONS = ("", "design", "design.opamp", "problem", "problem.load", "problem.noise", "analysis")

Value = float | int | str | bool
Kind = Literal["real", "integer", "choice"]  # choice: words and truth values


@dataclass(frozen=True, slots=True)
class Key:
    """One key of a scene."""

    path: str  # dotted, as in the scene file
    kind: Kind
    unit: str  # SI unit; empty for a plain number


def find_key(scene: Scene, name: str) -> Key:
    """Return the key with the path, end of a path, or symbol `name`, or refuse it."""
    keys = dict(_keys(scene, every=True))
    keys["design.lam"] = keys["design.lambda"]  # as Python has it
    if (key := _search(keys, name)) is not None:
        return key
    known = {symbol: symbol for symbol in SYMBOLS}
    for key in keys.values():
        known[key.path] = key.path
        last = key.path.rpartition(".")[2]
        known.setdefault(last, last if _search(keys, last) else key.path)
    folded = {word.lower(): full for word, full in reversed(known.items())}
    close = difflib.get_close_matches(name.lower(), folded, n=1, cutoff=0.5)
    hint = f"did you mean {folded[close[0]]!r}? " if close else ""
    symbols = ", ".join(SYMBOLS)
    text = f"unknown key of this scene; {hint}known: {symbols}, or a key such as 'design.gain'"
    raise InputError("--over", Complaint("key", repr(name), text))


def _search(keys: Mapping[str, Key], name: str) -> Key | None:
    path = SYMBOLS.get(name, name)
    paths = (f"{section}.{path}".removeprefix(".") for section in SECTIONS)
    return next((keys[candidate] for candidate in paths if candidate in keys), None)


def all_keys(scene: Scene) -> Iterator[Key]:
    """Yield every key that a study can change."""
    yield from (key for _, key in _keys(scene))


def _keys(table: BaseModel, prefix: str = "", *, every: bool = False) -> Iterator[tuple[str, Key]]:
    """Yield the keys of a table by their paths.

    `every`: also those of tables that the scene may have and has not, and by the path of a
    `Shortened` table the key that stands in its place.
    """
    for name, (alias, kind, unit, optional) in _fields(type(table)).items():
        path, value = f"{prefix}{alias}", getattr(table, name, None)
        if every and value is None and optional is not None:
            value = optional.model_construct()
        if isinstance(value, BaseModel):
            below = dict(_keys(value, f"{path}.", every=every))
            yield from below.items()
            if every and isinstance(value, Shortened):
                yield path, below[f"{path}.{value.PLAIN}"]
        elif not isinstance(value, dict):
            yield path, Key(path, kind, unit)


@functools.cache
def _fields(model: type[BaseModel]) -> dict[str, tuple[str, Kind, str, type[BaseModel] | None]]:
    """Return name in a file, kind, unit, and table, if it is one, of every field of a table."""
    found = dict[str, tuple[str, Kind, str, type[BaseModel] | None]]()
    for name, field in model.model_fields.items():
        parts = [*_parts(field.annotation), *field.metadata]
        kind: Kind = "real" if float in parts else "integer" if int in parts else "choice"
        unit = next((part.unit for part in parts if isinstance(part, Unit)), "")
        tables = (part for part in parts if isinstance(part, type) and issubclass(part, BaseModel))
        found[name] = field.alias or name, kind, unit if kind == "real" else "", next(tables, None)
    return found


def _parts(annotation: Any) -> Iterator[Any]:
    """Yield types and metadata of an annotation, also inside unions and Annotated."""
    yield annotation
    for part in get_args(annotation):
        yield from _parts(part)
    yield from getattr(annotation, "__metadata__", ())


def read_value(key: Key, text: str) -> Value:
    """Return the value of `text` for `key`, in base units, or refuse it."""
    try:
        if key.kind == "choice":
            return {"true": True, "false": False}.get(text, text)
        if key.unit:
            _refuse_impossible(key, text)
            return parse(text, key.unit)
        read = plain_number(text)
        number = int(text) if key.kind == "integer" else read
    except ValueError as error:
        plain = f"expected {'a whole' if key.kind == 'integer' else 'a plain'} number"
        share = percentage(text)
        plain += "" if share is None else f"; {text} is {share:g}"
        accepted = str(error) if key.unit else plain
        raise InputError("--over", Complaint(key.path, repr(text), accepted)) from None
    if not math.isfinite(number):
        raise InputError("--over", Complaint(key.path, repr(text), "expected a finite number"))
    return number


def _refuse_impossible(key: Key, text: str) -> None:
    """Refuse a quantity that no board has, as in a scene file."""
    section, _, name = key.path.rpartition(".")
    try:
        value: float | str = plain_number(text)
    except ValueError:
        value = text
    for complaint in impossible({section: {name: value}}):
        raise InputError("--over", complaint)


def own_value(scene: Scene, key: Key) -> float | None:
    """Return the number of `key` in `scene`, given or derived; None if there is no number."""
    from taction.netlist_gen.board.opamp_choice import choose_opamp  # these load numpy
    from taction.netlist_gen.topologies.frame.topology import topology_of
    from taction.spice_models.opamp import phase_margin

    if key.path == "design.opamp.phase_margin":
        return phase_margin(choose_opamp(scene))
    table, _, last = key.path.rpartition(".")
    if table == "design.opamp" and key.kind == "real":
        figure = getattr(choose_opamp(scene), last)
        return None if figure is None else float(figure)
    value = _at(scene, "design.lam" if key.path == "design.lambda" else key.path)
    if table == "design" and key.kind == "real" and not isinstance(value, int | float):
        facts = topology_of(scene).facts(scene).values()
        value = next((fact.value for fact in facts if fact.key == key.path), None)
    return float(value) if isinstance(value, int | float) else None


def files_of(scene: Scene) -> dict[str, object]:
    """Return the file names in a scene by key; None where the scene has no such key or file."""
    return {path: _at(scene, path) for path in FILES}


def _at(scene: Scene, path: str) -> Any:
    """Return what stands at a path of attributes; None where there is no such table or key."""
    top: Any = scene
    return functools.reduce(lambda at, key: getattr(at, key, None), path.split("."), top)


_BARE = re.compile(r"[A-Za-z0-9_-]+")  # a key of TOML without quotes


def scene_text(scene: Scene, folder: str | Path | None = None) -> str:
    """Return a file that reads as `scene`, its files relative to `folder` or its own."""
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
        elif isinstance(value, str) and any(path.endswith(f".{key}") for path in FILES):
            table[key] = Path(os.path.relpath(before / value, after)).as_posix()


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
