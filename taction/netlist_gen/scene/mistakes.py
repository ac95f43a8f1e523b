"""The mistakes in a scene's data, each with its key, its value and the accepted values.

`root` is the model of a scene, an argument because this module must not import it.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any, TypeVar, get_args

from pydantic import BaseModel, ValidationError
from pydantic.fields import FieldInfo

from taction.netlist_gen.scene.key_mistakes import (
    TEXTS,
    design_mistakes,
    impossible,
    quoted_value,
    share,
    unknown_key,
)
from taction.system.errors import Complaint, InputError, listed, nearest_question

Root = TypeVar("Root", bound=BaseModel)


def validated(
    root: type[Root], data: Mapping[str, Any], file: str | Path, *, written: bool = True
) -> Root:
    """Return the `data` of `file` as a `root`; InputError lists all mistakes.

    `written` tells that `data` is what the user wrote, with the units that were given.
    """
    complaints = [*design_mistakes(data), *(impossible(data) if written else ())]
    try:
        model = root.model_validate(dict(data))
    except ValidationError as error:
        complaints = [*_complaints(root, error, data), *complaints]
    if complaints:
        raise InputError(file, *complaints)
    return model


def placed(
    root: type[BaseModel], data: dict[str, Any], values: Mapping[str, Any]
) -> list[Complaint]:
    """Put `values` into the tables of `data`; return the complaints about unknown names.

    A name is a key or a table at any depth (``capacitance``, ``settling_time``), or a dotted path.
    """
    paths: dict[str, list[str]] = {}
    for name, path in _all_keys(root, data):
        for spelling in {name, path.rpartition(".")[2], path}:
            paths.setdefault(spelling, []).append(path)
    complaints = []
    for name, value in values.items():
        matches = paths.get(name, [])
        if len(matches) != 1:
            several = f"several keys have this name; one of {listed(matches)}"
            text = several if matches else f"unknown key; {nearest_question(name, list(paths))}"
            complaints.append(Complaint(name, quoted_value(value), text.rstrip()))
            continue
        *tables, last = matches[0].split(".")
        table = data
        for key in tables:
            table = table.setdefault(key, {})
        table[last] = value
    return complaints


def _all_keys(model: type[BaseModel], data: Any, prefix: str = "") -> Iterator[tuple[str, str]]:
    """Yield the name in Python and the path of every key and table below `model`."""
    for name, field in model.model_fields.items():
        key = field.alias or name
        yield name, prefix + key
        inside = data.get(key) if isinstance(data, Mapping) else None
        kind = inside.get("kind") if isinstance(inside, Mapping) else None
        if (table := _pick(field.annotation, kind)) is not None:
            yield from _all_keys(table, inside, f"{prefix}{key}.")


def _complaints(
    root: type[BaseModel], error: ValidationError, data: Mapping[str, Any]
) -> Iterator[Complaint]:
    for item in error.errors(include_url=False):
        kind, context = item["type"], item.get("ctx", {})
        if kind == "value_error" and item["loc"] == ("design",):
            continue  # `design_mistakes` has the key
        missing = kind == "missing"
        keys = _real_path(item["loc"], data, missing=missing)
        key = ".".join(keys) or "scene"
        if missing:
            field = _fields(root, keys[:-1], data)[keys[-1]]
            yield Complaint(key, "", f"required; {field.description}")
        elif kind == "extra_forbidden":
            known = list(_fields(root, keys[:-1], data))
            yield Complaint(key, quoted_value(item["input"]), unknown_key(key, known))
        elif kind == "union_tag_invalid":
            tag = str(context["tag"])
            known = [name.strip("' ") for name in context["expected_tags"].split(",")]
            text = f"{nearest_question(tag, known)}one of {listed(known)}"
            yield Complaint(f"{key}.kind", quoted_value(tag), text)
        elif kind == "union_tag_not_found":
            yield Complaint(f"{key}.kind", "", "required; 'tactile' or 'matrix'")
        else:
            text = item["msg"].removeprefix("Value error, ").replace("Input should be", "expected")
            text = TEXTS[kind].format(**context) if kind in TEXTS else text
            yield Complaint(key, quoted_value(item["input"]), text + share(item["input"], kind))


def _real_path(location: Sequence[int | str], data: Any, *, missing: bool) -> list[str]:
    """Return the keys of a location, without the tags of unions that pydantic adds."""
    keys: list[str] = []
    tag: object = None  # of the table of the previous key
    for place, part in enumerate(location):
        if part == tag:
            tag = None
            continue
        inside = isinstance(data, Mapping) and part in data
        if inside or (missing and place == len(location) - 1):
            keys.append(str(part))
        if inside:
            data = data[part]
            tag = data.get("kind") if isinstance(data, Mapping) else None
    return keys


def _fields(root: type[BaseModel], path: Sequence[str], data: Any) -> dict[str, FieldInfo]:
    """Return the fields of the table at `path`; the kinds in `data` select the models."""
    model = root
    for key in path:
        data = data[key] if isinstance(data, Mapping) else {}
        kind = data.get("kind") if isinstance(data, Mapping) else None
        model = _pick(_by_alias(model)[key].annotation, kind) or model
    return _by_alias(model)


def _by_alias(model: type[BaseModel]) -> dict[str, FieldInfo]:
    return {field.alias or name: field for name, field in model.model_fields.items()}


def _pick(annotation: Any, kind: object) -> type[BaseModel] | None:
    """Return the model in an annotation, in a union that of `kind`; None without a model."""
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
    return kinds.get(kind, options[0] if options else None)
