"""Read a scene file; name every mistake with file, key, value and what would be accepted."""

from __future__ import annotations

import difflib
import tomllib
from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any, get_args

from pydantic import BaseModel, ValidationError
from pydantic.fields import FieldInfo

from netlist_gen.scene.scene import Scene, contradictions
from spice_models.errors import Complaint, InputError
from spice_models.presets import preset_names

MAX_BYTES = 1_000_000
TEXTS = {  # of pydantic's complaints that speak of Python
    "model_type": "expected a table",
    "model_attributes_type": "expected a table",
    "float_type": "expected a plain number, without quotes or unit",
    "int_type": "expected a plain whole number, without quotes or unit",
    "string_pattern_mismatch": "letters, digits, '-', '_' and '.' only",
}


def load_scene(path: str | Path) -> Scene:
    """Read and validate the scene at `path`.

    Raises
    ------
    InputError
        The file cannot be read, is not TOML, or does not describe a scene; all complaints that
        could be found are in it at once.
    """
    path = Path(path)
    return parse_scene(_read_toml(path), path)


def parse_scene(data: Mapping[str, Any], file: str | Path) -> Scene:
    """Validate `data` as a scene that stands in `file` (see `load_scene`)."""
    complaints = [*_contradictions(data), *_unknown_preset(data)]
    try:
        scene = Scene.model_validate(dict(data))
    except ValidationError as error:
        complaints = [*_complaints(error, data), *complaints]
    if complaints:
        raise InputError(file, *complaints)
    scene._file = Path(file)
    return scene


def _read_toml(path: Path) -> dict[str, Any]:
    accepted = "a scene file in TOML; `taction new` writes one"
    try:
        if path.exists() and not path.is_file():
            raise InputError(
                path, Complaint("file", "", f"not a regular file; expected {accepted}")
            )
        if path.stat().st_size > MAX_BYTES:
            raise InputError(path, Complaint("file", "", f"over {MAX_BYTES} bytes; {accepted}"))
        return tomllib.loads(path.read_text(encoding="utf-8-sig"))
    except OSError as error:
        reason = error.strerror or str(error)
        raise InputError(path, Complaint("file", "", f"{reason}; expected {accepted}")) from None
    except (tomllib.TOMLDecodeError, UnicodeDecodeError) as error:
        raise InputError(path, Complaint("TOML", "", f"{error}; expected {accepted}")) from None
    except RecursionError:
        text = f"nested too deeply; expected {accepted}"
        raise InputError(path, Complaint("TOML", "", text)) from None


def _contradictions(data: Mapping[str, Any]) -> Iterator[Complaint]:
    """Keys that exclude each other, found beside every other mistake."""
    design = data.get("design")
    if isinstance(design, Mapping):
        for key, reason in contradictions(design):
            yield Complaint(f"design.{key}", _value(design[key]), reason)


def _unknown_preset(data: Mapping[str, Any]) -> Iterator[Complaint]:
    design = data.get("design")
    choice = design.get("opamp") if isinstance(design, Mapping) else None
    base = choice.get("base") if isinstance(choice, Mapping) else choice
    known = preset_names()
    if isinstance(base, str) and base not in known:
        text = f"{_nearest(base, known)}one of {_list(known)}"
        yield Complaint("design.opamp.base", _value(base), text)


def _complaints(error: ValidationError, data: Mapping[str, Any]) -> Iterator[Complaint]:
    for item in error.errors(include_url=False):
        kind, context = item["type"], item.get("ctx", {})
        if kind == "value_error" and item["loc"] == ("design",):
            continue  # `_contradictions` has it, with its key
        missing = kind == "missing"
        keys = _real_path(item["loc"], data, missing=missing)
        key = ".".join(keys) or "scene"
        if missing:
            field = _fields(keys[:-1], data)[keys[-1]]
            yield Complaint(key, "", f"required; {field.description}")
        elif kind == "extra_forbidden":
            known = list(_fields(keys[:-1], data))
            hint = f"unknown key; {_nearest(keys[-1], known)}known here: {_list(known)}"
            yield Complaint(key, _value(item["input"]), hint)
        elif kind == "union_tag_invalid":
            tag = str(context["tag"])
            wanted = [name.strip("' ") for name in context["expected_tags"].split(",")]
            text = f"{_nearest(tag, wanted)}one of {_list(wanted)}"
            yield Complaint(f"{key}.kind", _value(tag), text)
        elif kind == "union_tag_not_found":
            yield Complaint(f"{key}.kind", "", "required; 'tactile' or 'matrix'")
        else:
            text = TEXTS.get(kind, item["msg"].removeprefix("Value error, "))
            yield Complaint(key, _value(item["input"]), text)


def _real_path(location: Sequence[int | str], data: Any, *, missing: bool) -> list[str]:
    """Drop what pydantic puts into a location and is no key of the file (a union's tags)."""
    keys: list[str] = []
    for place, part in enumerate(location):
        inside = isinstance(data, Mapping) and part in data
        if inside or (missing and place == len(location) - 1):
            keys.append(str(part))
        if inside:
            data = data[part]
    return keys


def _fields(path: Sequence[str], data: Any) -> dict[str, FieldInfo]:
    """Return the fields that are known at `path`, following the discriminators in `data`."""
    model: type[BaseModel] = Scene
    for key in path:
        data = data[key] if isinstance(data, Mapping) else {}
        kind = data.get("kind") if isinstance(data, Mapping) else None
        model = _pick(_by_alias(model)[key].annotation, kind)
    return _by_alias(model)


def _by_alias(model: type[BaseModel]) -> dict[str, FieldInfo]:
    return {field.alias or name: field for name, field in model.model_fields.items()}


def _pick(annotation: Any, kind: object) -> type[BaseModel]:
    """Return the model of an annotation that is a model or a union of some."""
    options = [
        option
        for option in getattr(annotation, "__args__", (annotation,))
        if isinstance(option, type) and issubclass(option, BaseModel)
    ]
    kinds: dict[object, type[BaseModel]] = {
        get_args(option.model_fields["kind"].annotation)[0]: option
        for option in options
        if "kind" in option.model_fields
    }
    return kinds.get(kind, options[0])


def _nearest(word: str, known: Sequence[str]) -> str:
    close = difflib.get_close_matches(word, known, n=1, cutoff=0.5)
    return f"did you mean {close[0]!r}? " if close else ""


def _list(names: Sequence[str]) -> str:
    return ", ".join(repr(name) for name in names)


def _value(value: object) -> str:
    text = repr(value)
    return text if len(text) <= 60 else text[:57] + "..."
