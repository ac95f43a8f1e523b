"""Documents from types: a frozen dataclass gives its JSON, and JSON gives the dataclass.

A field of a result carries its unit as a text in its annotation: ``Annotated[float, "s"]``. From
the type follow the plain data of a document (`plain`), the way back (`read`), and the JSON Schema
(`schema`). Numbers that are not finite are null.

What else an annotation may carry is a table of fields of `DocumentPart`: ``{"key": "lambda"}`` is
another name in the document, ``{"note": "..."}`` is for readers of the schema; `INLINE`, the parts
of the field stand beside it in the document; `HIDDEN`, the field is not part of it; `OPTIONAL`, it
is part of it only where it is not None. The class variable ``SHOWN`` names properties that are part
of it.

A class whose document has another order, or parts of its parts, states it in the class variable
``DOCUMENT``: a tuple of texts ``"key? [unit] = attribute.of.an.attribute # note"``; all but the
key may be missing, and ``?`` is `OPTIONAL`. A name on the right is a field, a property, a method
without arguments, or the key of a mapping; a dotted key is a document in the document; after ``*``
the parts stand beside the others; ``attribute or null`` is null in the place of what is empty. Or
``DOCUMENT`` is the place of a function (`results.load`) that makes the document.
"""

from __future__ import annotations

import dataclasses
import enum
import inspect
import itertools
import math
import re
import sys
import types
import typing
from collections.abc import Mapping, Sequence
from functools import cache
from pathlib import Path, PurePath
from typing import Annotated, Any, Literal, TypeVar, Union, get_args, get_origin

from taction.system.errors import Complaint, TactionError, listed
from taction.system.foreign_files import shortened, visible
from taction.system.output_files import printable
from taction.system.results import load

T = TypeVar("T")

Seconds = Annotated[float | None, "s"]
Volts = Annotated[float | None, "V"]
Steps = Annotated[float | None, "step"]
"""Fraction of the step amplitude."""
Rate = Annotated[float | None, "1/s"]
Hertz = Annotated[float | None, "Hz"]
Number = float | None
"""A number without a unit; null: unknown, or infinite."""


UNIONS = (Union, types.UnionType)
INLINE: dict[str, Any] = {"inline": {}}
HIDDEN = {"hidden": True}
OPTIONAL = {"required": False}


@dataclasses.dataclass(frozen=True)
class DocumentPart:
    """One field of a document."""

    attribute: str
    key: str
    kind: Any  # without its notes
    unit: str = ""
    note: str = ""
    inline: Mapping[str, str] | None = None  # beside the others: parts, or numbers with their units
    required: bool = True
    hidden: bool = False
    filled: bool = False  # null where it is empty

    def of(self, value: Any) -> Any:
        """Return the field of the document of `value`; None where an attribute on the way is."""
        for name in self.attribute.split("."):
            if value is not None:
                value = value.get(name) if isinstance(value, Mapping) else getattr(value, name)
                value = value() if inspect.ismethod(value) else value
        return (value or None) if self.filled else value


@cache
def parts_of(kind: Any) -> tuple[DocumentPart, ...]:
    """Return what is in the document of a dataclass: ``DOCUMENT``, or its fields and ``SHOWN``."""
    names = (*(field.name for field in dataclasses.fields(kind)), *getattr(kind, "SHOWN", ()))
    parts = (_part(kind, entry) for entry in getattr(kind, "DOCUMENT", names))
    return tuple(part for part in parts if not part.hidden)


ENTRY = re.compile(
    r"(?P<key>[\w.*]+)(?P<missing>\??)(?: \[(?P<unit>.*?)\])?"
    r"(?: = (?P<path>[\w.]+)(?P<filled> or null)?)?(?: # (?P<note>.*))?"
)
"""An entry of ``DOCUMENT``."""


def _part(kind: Any, entry: str) -> DocumentPart:
    found = ENTRY.fullmatch(entry)
    if found is None:
        raise ValueError(f"{kind.__name__}.DOCUMENT: {entry!r} is no entry")
    key, path, filled = found["key"], found["path"] or found["key"], bool(found["filled"])
    inner, notes = _kind_at(kind, path)
    stated: dict[str, Any] = dict(INLINE if key.endswith("*") else {})
    for note in notes:
        own = note if isinstance(note, dict) else {}  # others are of pydantic
        stated |= {"unit": note} if isinstance(note, str) else own
    stated |= OPTIONAL if found["missing"] else {}
    stated |= {name: found[name] for name in ("unit", "note") if found[name]}
    given = {"key": key, "kind": inner | None if filled else inner, "filled": filled}
    return DocumentPart(path, **given | stated)


def _kind_at(kind: Any, path: str) -> tuple[Any, tuple[Any, ...]]:
    """Return the type of an attribute of an attribute, and its notes."""
    inner, notes, optional = kind, tuple[Any, ...](), False
    for name in path.split("."):
        if get_origin(inner) in UNIONS:
            (inner,) = (each for each in get_args(inner) if each is not types.NoneType)
            optional = True
        is_mapping = issubclass(get_origin(inner) or object, Mapping)
        inner, notes = unwrapped(get_args(inner)[1] if is_mapping else _hint(inner, name))
    return inner | None if optional else inner, notes


def _hint(kind: Any, name: str) -> Any:
    """Return the annotation of a field, of a property, or of what a method returns."""
    for base in kind.__mro__:
        if name in inspect.get_annotations(base):
            return _hints(base)[name]
    found = inspect.getattr_static(kind, name)
    return _returned(getattr(found, "fget", None) or getattr(found, "func", found))


@cache
def _hints(of: Any) -> dict[str, Any]:
    return typing.get_type_hints(of, include_extras=True)


def _returned(function: Any) -> Any:
    return _hints(function)["return"]


def document_of(kind: Any) -> Any:
    """Return the type of the documents of a type: itself, or what its ``DOCUMENT`` returns."""
    place = getattr(kind, "DOCUMENT", ())
    if not isinstance(place, str):
        return kind
    return _returned(load(place))


def unwrapped(hint: Any) -> tuple[Any, tuple[Any, ...]]:
    """Return a type without its annotations, and these."""
    if get_origin(hint) is Annotated:
        inner, *notes = get_args(hint)
        return inner, tuple(notes)
    return hint, ()


def plain(value: Any) -> Any:
    """Return `value` in the types of JSON.

    >>> plain({"poles": (complex(-1.0, 2.0),), "margin": float("inf")})
    {'poles': [[-1.0, 2.0]], 'margin': None}
    """
    if isinstance(value, enum.Enum):
        return plain(value.value)
    if value is None or isinstance(value, bool | int):
        return value
    if isinstance(value, float):
        return float(value) if math.isfinite(value) else None
    if isinstance(value, str | PurePath):
        return printable(str(value))
    if isinstance(value, complex):
        return [plain(value.real), plain(value.imag)]
    if isinstance(value, Mapping):
        return {printable(str(key)): plain(item) for key, item in value.items()}
    if isinstance(value, list | tuple | set | frozenset):
        return [plain(item) for item in value]
    if dataclasses.is_dataclass(value) and not isinstance(value, type):
        place = getattr(value, "DOCUMENT", ())
        return plain(load(place)(value)) if isinstance(place, str) else _plain_parts(value)
    if hasattr(value, "tolist"):
        return plain(value.tolist())
    raise TypeError(f"{type(value).__name__} has no form in a document")


def _plain_parts(value: Any) -> dict[str, Any]:
    found: dict[str, Any] = {}
    kind: type = type(value)
    for part in parts_of(kind):
        item = plain(part.of(value))
        if item is not None or (part.required and part.inline is None):
            inside, (*places, key) = found, part.key.split(".")
            for place in places:
                inside = inside.setdefault(place, {})
            inside |= {key: item} if part.inline is None else item
    return found


def taken(kind: type[T], source: object, /, **others: Any) -> T:
    """Return a value of a type from `others`, and attributes of `source` of the same names."""
    fields = dataclasses.fields(kind)  # type: ignore[arg-type]
    names = [field.name for field in fields if field.name not in others]
    same = {name: getattr(source, name) for name in names if hasattr(source, name)}
    return kind(**same, **others)


def read(kind: type[T], data: Any) -> T:
    """Return the value of a type from its plain data: the inverse of `plain`.

    ValueError: a field is missing or has another type; the text begins with its place.
    """
    return typing.cast(T, _read(kind, data, ""))


def _read(kind: Any, data: Any, place: str) -> Any:
    kind, _ = unwrapped(kind)
    origin, inner = get_origin(kind), get_args(kind)
    if kind is Any:
        return data
    if origin in UNIONS:
        reasons = list[str]()
        for each in inner:
            try:
                return _read(each, data, place)
            except ValueError as error:
                reasons.append(str(error))
        raise ValueError(reasons[0])
    if dataclasses.is_dataclass(kind):
        return _read_parts(kind, data, place)
    if origin in (tuple, list):
        fixed = origin is tuple and inner[-1] is not Ellipsis
        if not isinstance(data, list | tuple) or (fixed and len(data) != len(inner)):
            raise _wrong(place, data, f"a list of {len(inner)}" if fixed else "a list")
        kinds = zip(inner if fixed else itertools.repeat(inner[0]), data, strict=False)
        return origin(_read(each, item, f"{place}[{n}]") for n, (each, item) in enumerate(kinds))
    if origin is not None and origin is not Literal and issubclass(origin, Mapping):
        items = _table(data, place).items()
        return {key: _read(inner[1], item, f"{place}.{key}".lstrip(".")) for key, item in items}
    return _read_one(kind, data, place)


WORDS = {bool: "true or false", int: "a whole number", float: "a finite number", str: "a text"}
"""What is expected where a value is of another type."""
TYPES: dict[Any, Any] = {float: int | float, int: int}


def _table(data: Any, place: str) -> Mapping[str, Any]:
    if not isinstance(data, Mapping):
        raise _wrong(place, data, "a table")
    return data


def _wrong(place: str, data: Any, expected: str) -> ValueError:
    if isinstance(data, Mapping | list | tuple):
        found = "a table" if isinstance(data, Mapping) else f"a list of {len(data)}"
    else:
        found = "null" if data is None else shortened(visible(repr(data)), 60)
    return ValueError(f"{place or 'the document'} = {found}: expected {expected}")


def _read_one(kind: Any, data: Any, place: str) -> Any:
    """Return a value of a plain type, of an enumeration or of a `Literal`."""
    if get_origin(kind) is Literal or issubclass(kind, enum.Enum):
        known = get_args(kind) or tuple(each.value for each in kind)
        if data not in known:
            raise _wrong(place, data, f"one of {listed(known)}")
        return data if get_args(kind) else kind(data)
    fits = isinstance(data, TYPES.get(kind, kind))
    if kind in TYPES:
        fits = fits and not isinstance(data, bool) and abs(data) <= sys.float_info.max  # no NaN
    if not fits:
        raise _wrong(place, data, WORDS.get(kind, "null"))
    return float(data) if kind is float else data


def _read_parts(kind: Any, data: Any, place: str) -> Any:
    """Return a value of a dataclass; what its document has beside its fields is left out."""
    table, values = _table(data, place), {}
    fields = {field.name: field for field in dataclasses.fields(kind)}
    for part in parts_of(kind):
        field, here = fields.get(part.attribute), f"{place}.{part.key}".lstrip(".")
        if field is None:
            continue
        inside, (*places, last) = table, part.key.split(".")
        for name in places:
            inside = _table(inside.get(name, {}), name)
        if part.inline is not None:
            names = part.inline or table
            known = {key: table[key] for key in names if key in table}
            values[part.attribute] = _read(part.kind, known, place)
        elif last in inside:
            values[part.attribute] = _read(part.kind, inside[last], here)
        elif field.default is field.default_factory:  # both are missing
            raise ValueError(f"{here}: missing")
    return kind(**values)


Ending = Literal["bad input", "inconclusive"]


@dataclasses.dataclass(frozen=True, slots=True)
class Failure:
    """Why there is no result."""

    kind: str
    message: str
    file: Annotated[str | None, OPTIONAL, {"note": "of bad input"}] = None
    complaints: Annotated[tuple[Complaint, ...] | None, OPTIONAL] = None
    log: Annotated[str | None, OPTIONAL, {"note": "of a simulation"}] = None
    folder: Annotated[Path | None, OPTIONAL, {"note": "what reproduces the failed simulation"}] = (
        None
    )


@dataclasses.dataclass(frozen=True, slots=True)
class ErrorDocument:
    """Any command that ended without its document."""

    outcome: Ending
    error: Failure


def error_document(error: Exception, message: str = "") -> ErrorDocument:
    """Return `error` with its outcome, ``bad input`` or ``inconclusive``, and all that it knows."""
    known = error if isinstance(error, TactionError) else None
    failure = taken(Failure, known, kind=type(error).__name__, message=message or str(error))
    # As the error of a command line, of click, a mistake of the user has the exit status 2.
    ours = getattr(error, "exit_status", getattr(error, "exit_code", None)) == 2
    return ErrorDocument("bad input" if ours else "inconclusive", failure)


def schema(kind: Any) -> dict[str, Any]:
    """Return the JSON Schema of the documents of a type; a field with a unit has it as `unit`.

    >>> schema(dict[str, Seconds])["additionalProperties"]
    {'type': ['number', 'null'], 'unit': 's'}
    """
    shared: dict[str, Any] = {}
    made = _schema(kind, shared)
    if "$ref" in made:
        made = shared.pop(made["$ref"].rpartition("/")[2])
    return made | ({"$defs": dict(sorted(shared.items()))} if shared else {})


_NUMBER = {"type": ["number", "null"]}
_PLAIN: dict[Any, Any] = {bool: "boolean", int: "integer", str: "string", type(None): "null"}
_PLAIN[float] = _NUMBER["type"]


def _schema(kind: Any, shared: dict[str, Any], unit: str = "", note: str = "") -> dict[str, Any]:
    kind, notes = unwrapped(kind)
    unit = unit or next((each for each in notes if isinstance(each, str)), "")
    more = {"unit": unit, "description": note}
    return _schema_of(kind, shared) | {name: text for name, text in more.items() if text}


def _schema_of(kind: Any, shared: dict[str, Any]) -> dict[str, Any]:
    origin, inner = get_origin(kind), get_args(kind)
    if kind is Any:
        return {}
    if origin in UNIONS:
        return _any_of([_schema(each, shared) for each in inner])
    if origin is Literal:
        return {"enum": list(inner)}
    if origin is not None and issubclass(origin, Mapping):
        return {"type": "object", "additionalProperties": _schema(inner[1], shared) or True}
    if origin in (tuple, list, Sequence):
        return {"type": "array", "items": _schema(inner[0], shared)}
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
        if part.inline is None:
            beside = {key: _schema(part.kind, shared, part.unit, part.note)}
            required = [key] * part.required
        elif part.inline:
            beside = {name: _schema(Number, shared, unit) for name, unit in part.inline.items()}
            required = list(beside)
        else:
            kinds = (*get_args(part.kind), part.kind)
            inner = next(each for each in kinds if dataclasses.is_dataclass(each))
            whole = _object(document_of(inner), shared)
            beside, required = whole["properties"], whole["required"]
        inside["properties"] |= beside
        inside["required"] += required
    return found


def _no_parts(text: str) -> dict[str, Any]:
    head = {"type": "object", "description": text} if text else {"type": "object"}
    return head | {"properties": {}, "required": [], "additionalProperties": False}


def units(kind: Any) -> dict[str, str]:
    """Return the unit of every name in the documents of a type.

    Where a name has several units, the first is by the name, the others are by the path.
    """
    made, found = schema(kind), dict[str, str]()

    def walk(part: Any, inside: str, key: str, seen: frozenset[str]) -> None:
        unit = part.get("unit")
        if unit and found.setdefault(key, unit) != unit:
            found[f"{inside}.{key}".lstrip(".")] = unit
        name = part.get("$ref", "").rpartition("/")[2]
        if name and name not in seen:
            walk(made["$defs"][name], inside, key, seen | {name})
        for below, field in part.get("properties", {}).items():
            walk(field, key, below, seen)
        for each in (part.get("items"), part.get("additionalProperties"), *part.get("anyOf", ())):
            if isinstance(each, dict):  # of a list or a table, or one of either
                walk(each, inside, key, seen)

    walk(made, "", "", frozenset())
    return dict(sorted(found.items()))
