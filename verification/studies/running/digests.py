"""Digests of plain data: what a stored result is keyed by.

The encoding is canonical: every value carries its type, arrays their shape and their bytes, and
mappings are sorted, so equal content gives equal digests on any machine and in any version of
Python.
"""

from __future__ import annotations

import dataclasses
import enum
import functools
import hashlib
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np
from pydantic import BaseModel

import netlist_gen
import spice_models
import verification
from netlist_gen.scene.scene import Scene

FILES = ("problem.matrix", "problem.strain", "problem.stress", "problem.load.file")
CODE = (".py", ".toml")
PLAIN = frozenset((type(None), bool, int, float, str))


def digest(*values: object) -> bytes:
    """Return the SHA-256 of `values`: dataclasses, models, containers, arrays, plain values.

    Raises
    ------
    TypeError
        A value of another kind: its content is not known.
    """
    parts: list[bytes] = []
    _encode(values, parts)
    return hashlib.sha256(b"".join(parts)).digest()


def _encode(value: object, parts: list[bytes]) -> None:
    kind: Any = type(value)
    if kind is str:
        parts.append(_word(value))
    elif kind in PLAIN:
        text = repr(value)
        parts.append(f"{kind.__name__}{len(text)}:{text}".encode())
    elif isinstance(value, tuple | list):
        parts.append(b"t%d:" % len(value))
        for item in value:
            _encode(item, parts)
    elif (names := _names(kind)) is not None:
        parts.append(b"%b:" % kind.__name__.encode())
        for name in names:
            _encode(getattr(value, name), parts)
    elif isinstance(value, np.ndarray):
        little = np.ascontiguousarray(value, dtype=value.dtype.newbyteorder("<"))
        parts += [f"a{little.dtype.str}{little.shape}:".encode(), little.tobytes()]
    elif isinstance(value, Mapping):
        _encode(tuple(sorted(value.items())), parts)
    elif isinstance(value, bytes):
        parts.append(b"y%d:" % len(value) + value)
    elif isinstance(value, BaseModel):
        _encode(value.model_dump(by_alias=True), parts)
    elif isinstance(value, enum.Enum):
        _encode(value.value, parts)
    else:
        raise TypeError(f"no canonical encoding of {kind.__name__}")


@functools.lru_cache(maxsize=1 << 14)
def _word(value: object) -> bytes:
    """Encode a string; the same parts and nodes come up at every point."""
    text = repr(value)
    return f"str{len(text)}:{text}".encode()


@functools.cache
def _names(kind: Any) -> tuple[str, ...] | None:
    """Return the fields of a dataclass; None of any other kind."""
    if not dataclasses.is_dataclass(kind):
        return None
    return tuple(field.name for field in dataclasses.fields(kind))


def files_of(scene: Scene) -> dict[str, object]:
    """Return the file names in a scene, by their keys; None where it has no such key or file."""
    top: Any = scene
    return {
        path: functools.reduce(lambda at, key: getattr(at, key, None), path.split("."), top)
        for path in FILES
    }


@functools.cache
def own_code() -> bytes:
    """Digest of the code that a result follows from, from the scene to the verdict.

    A result that another state of it gave is another result.
    """
    found = []
    for package in (spice_models, netlist_gen, verification):
        folder = Path(str(package.__file__)).parent
        files = sorted(file for file in folder.rglob("*") if file.suffix in CODE)
        found += [(file.relative_to(folder.parent).as_posix(), file.read_bytes()) for file in files]
    return digest(found)
