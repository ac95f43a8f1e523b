"""Read a scene file; name every mistake with file, key, value and what would be accepted."""

from __future__ import annotations

import difflib
import tomllib
from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any, get_args

from pydantic import BaseModel, ValidationError

from netlist_gen.scene import OpAmpChoice, Scene
from spice_models.errors import Complaint, InputError
from spice_models.presets import preset_names

MAX_BYTES = 1_000_000


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
    try:
        scene = Scene.model_validate(dict(data))
    except ValidationError as error:
        raise InputError(file, *_complaints(error, data)) from None
    scene._file = Path(file)
    if scene.design.opamp.base not in preset_names():
        raise InputError(file, _unknown_preset(scene.design.opamp))
    return scene


def _read_toml(path: Path) -> dict[str, Any]:
    accepted = "a scene file in TOML; `taction new` writes one"
    try:
        if path.stat().st_size > MAX_BYTES:
            raise InputError(path, Complaint("file", "", f"over {MAX_BYTES} bytes; {accepted}"))
        return tomllib.loads(path.read_text(encoding="utf-8"))
    except OSError as error:
        reason = error.strerror or str(error)
        raise InputError(path, Complaint("file", "", f"{reason}; expected {accepted}")) from None
    except (tomllib.TOMLDecodeError, UnicodeDecodeError) as error:
        raise InputError(path, Complaint("TOML", "", f"{error}; expected {accepted}")) from None


def _unknown_preset(choice: OpAmpChoice) -> Complaint:
    known = preset_names()
    return Complaint(
        "design.opamp.base",
        repr(choice.base),
        f"{_nearest(choice.base, known)}one of {_list(known)}",
    )


def _complaints(error: ValidationError, data: Mapping[str, Any]) -> Iterator[Complaint]:
    for item in error.errors(include_url=False):
        keys = _real_path(item["loc"], data)
        key = ".".join(keys) or "scene"
        value = _value(item["input"]) if item["type"] != "missing" else ""
        if item["type"] == "extra_forbidden":
            known = _known_keys(keys[:-1], data)
            hint = f"unknown key; {_nearest(keys[-1], known)}known here: {_list(known)}"
            yield Complaint(key, value, hint)
        elif item["type"] in ("union_tag_invalid", "union_tag_not_found"):
            wanted = item["ctx"].get("expected_tags", "'tactile', 'matrix'")
            yield Complaint(f"{key}.kind", "", f"required; one of {wanted}")
        else:
            yield Complaint(key, value, item["msg"].removeprefix("Value error, "))


def _real_path(location: Sequence[int | str], data: Any) -> list[str]:
    """Drop the union tags that pydantic puts into a location: they are no keys of the file."""
    keys: list[str] = []
    for place, part in enumerate(location):
        last = place == len(location) - 1
        inside = isinstance(data, Mapping) and part in data
        if inside or last:
            keys.append(str(part))
        if inside:
            data = data[part]
    return keys


def _known_keys(path: Sequence[str], data: Any) -> list[str]:
    """Return the keys that are known at `path`, following the discriminators in `data`."""
    model: type[BaseModel] = Scene
    for key in path:
        data = data[key] if isinstance(data, Mapping) else {}
        field = next(f for n, f in model.model_fields.items() if key in (n, f.alias))
        kind = data.get("kind") if isinstance(data, Mapping) else None
        model = _pick(field.annotation, kind)
    return [field.alias or name for name, field in model.model_fields.items()]


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
