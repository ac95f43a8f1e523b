"""JSON Schema of the documents of a type, and the units of its names."""

from __future__ import annotations

import dataclasses
import enum
import itertools
import types
from collections.abc import Iterator, Mapping, Sequence
from pathlib import PurePath
from typing import Any, Literal, Union, get_args, get_origin

from taction.system.documents import document_of, parts_of, unwrapped


def schema(kind: Any) -> dict[str, Any]:
    """Return the JSON Schema of the documents of a type; a field with a unit has it as `unit`.

    >>> from taction.system.documents import Seconds
    >>> schema(dict[str, Seconds])["additionalProperties"]
    {'type': ['number', 'null'], 'unit': 's'}
    """
    shared: dict[str, Any] = {}
    made = _schema(kind, shared)
    if "$ref" in made:
        made = shared.pop(made["$ref"].rpartition("/")[2])
    return made | ({"$defs": dict(sorted(shared.items()))} if shared else {})


_PLAIN = {bool: "boolean", int: "integer", str: "string", type(None): "null"}
_NUMBER = {"type": ["number", "null"]}


def _schema(kind: Any, shared: dict[str, Any]) -> dict[str, Any]:
    kind, notes = unwrapped(kind)
    unit = next((note for note in notes if isinstance(note, str)), "")
    return _schema_of(kind, shared) | ({"unit": unit} if unit else {})


def _schema_of(kind: Any, shared: dict[str, Any]) -> dict[str, Any]:
    origin, inner = get_origin(kind), get_args(kind)
    if kind is Any:
        return {}
    if origin in (Union, types.UnionType):
        return _any_of([_schema(each, shared) for each in inner])
    if origin is Literal:
        return {"enum": list(inner)}
    if origin is not None and issubclass(origin, Mapping):
        return {"type": "object", "additionalProperties": _schema(inner[1], shared) or True}
    if origin in (tuple, list, Sequence):
        return {"type": "array", "items": _schema(inner[0], shared)}
    if kind is float:
        return {**_NUMBER}
    if kind in _PLAIN:
        return {"type": _PLAIN[kind]}
    if dataclasses.is_dataclass(kind):
        kind = document_of(kind)
        name = kind.__name__
        if name not in shared:
            shared[name] = {}  # a type may contain itself
            shared[name] = _object(kind, shared)
        return {"$ref": f"#/$defs/{name}"}
    if kind is complex or origin is not None or not isinstance(kind, type):  # an array of NumPy
        return {"type": "array", "items": {**_NUMBER}}
    if issubclass(kind, enum.Enum):
        return {"enum": [one.value for one in kind]}
    if issubclass(kind, PurePath):
        return {"type": "string"}
    raise TypeError(f"a document cannot hold {kind.__name__}")


def _any_of(found: list[dict[str, Any]]) -> dict[str, Any]:
    """Return the schema of either; plain types are listed in one."""
    if not all(one.keys() == {"type"} for one in found):
        return {"anyOf": found}
    kinds = [one["type"] if isinstance(one["type"], list) else [one["type"]] for one in found]
    names = list(dict.fromkeys(itertools.chain(*kinds)))
    return {"type": names if len(names) > 1 else names[0]}


def _object(kind: Any, shared: dict[str, Any]) -> dict[str, Any]:
    found = _no_parts((kind.__doc__ or "").partition("\n")[0])
    for part in parts_of(kind):
        inside, (*places, key) = found, part.key.split(".")
        for place in places:
            if place not in inside["properties"]:
                inside["properties"][place] = _no_parts("")
                inside["required"].append(place)
            inside = inside["properties"][place]
        properties, required = inside["properties"], inside["required"]
        unit = {"unit": part.unit} if part.unit else {}
        if part.inline is None:
            note = {"description": part.note} if part.note else {}
            properties[key] = _schema(part.kind, shared) | unit | note
            required += [key] * part.required
        elif part.inline.units:
            for name, known in part.inline.units.items():
                properties[name] = _NUMBER | ({"unit": known} if known else {})
            required += part.inline.units
        else:
            kinds = (*get_args(part.kind), part.kind)
            inner = next(each for each in kinds if dataclasses.is_dataclass(each))
            beside = _object(document_of(inner), shared)
            properties |= beside["properties"]
            required += beside["required"]
    return found


def _no_parts(text: str) -> dict[str, Any]:
    head = {"type": "object", "description": text} if text else {"type": "object"}
    return head | {"properties": {}, "required": [], "additionalProperties": False}


def units(kind: Any) -> dict[str, str]:
    """Return the unit of every name in the documents of a type.

    Where a name has several units, the first is by the name, the others are by the path.
    """
    made, found = schema(kind), dict[str, str]()
    for inside, name, unit in _units(made, "", made.get("$defs", {}), frozenset()):
        if found.setdefault(name, unit) != unit:
            found[f"{inside}.{name}".lstrip(".")] = unit
    return dict(sorted(found.items()))


def _units(
    part: Any, inside: str, shared: Mapping[str, Any], seen: frozenset[str]
) -> Iterator[tuple[str, str, str]]:
    if not isinstance(part, dict):  # of `additionalProperties`
        return
    reference = part.get("$ref", "").rpartition("/")[2]
    if reference and reference not in seen:
        yield from _units(shared[reference], inside, shared, seen | {reference})
    for name, field in part.get("properties", {}).items():
        if found := _unit_in(field):
            yield inside, name, found
        yield from _units(field, name, shared, seen)
    for each in (part.get("items"), *part.get("anyOf", ()), part.get("additionalProperties")):
        yield from _units(each, inside, shared, seen)


def _unit_in(field: Any) -> str:
    """Return the unit of a field, also where it is a list or a table of numbers."""
    if not isinstance(field, dict):
        return ""
    inner = (field.get("items", field.get("additionalProperties")), *field.get("anyOf", ()))
    return field.get("unit") or next(filter(None, map(_unit_in, inner)), "")
