"""Digests of plain data, the keys of stored results.

The encoding contains the type of every value and the shape of every array, and mappings are
sorted, so equal content gives equal digests on any machine and in any version of Python.
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

from taction import netlist_gen, spice_models, system, verification
from taction.netlist_gen.scene.scene import Scene
from taction.system import plugins

FILES = ("problem.matrix", "problem.strain", "problem.stress", "problem.load.file")
PLAIN = frozenset((type(None), bool, int, float, str))


def digest(*values: object) -> bytes:
    """Return the SHA-256 of `values`: dataclasses, models, containers, arrays, plain values.

    Raises
    ------
    TypeError
        A value of another type has no canonical encoding.
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
    """Encode a string; the cache pays because all points have the same element names."""
    text = repr(value)
    return f"str{len(text)}:{text}".encode()


@functools.cache
def _names(kind: Any) -> tuple[str, ...] | None:
    """Return the fields of a dataclass that its digest needs; None for any other type."""
    if not dataclasses.is_dataclass(kind):
        return None
    fields = dataclasses.fields(kind)
    return tuple(field.name for field in fields if field.metadata.get("digest", True))


def files_of(scene: Scene) -> dict[str, object]:
    """Return the file names in a scene by key; None where the scene has no such key or file."""
    top: Any = scene
    return {
        path: functools.reduce(lambda at, key: getattr(at, key, None), path.split("."), top)
        for path in FILES
    }


@plugins.cached
def own_code() -> bytes:
    """Return the digest of the code between scene and verdict, with that of installed plug-ins.

    A change makes stored results outdated.
    """
    texts = []
    for package in (system, spice_models, netlist_gen, verification):
        folder = Path(str(package.__file__)).parent
        files = sorted(file for file in folder.rglob("*") if file.suffix in plugins.CODE)
        texts += [
            (f"{folder.name}/{file.relative_to(folder)}", file.read_bytes()) for file in files
        ]
    return digest(texts, *([tuple(plugins.sources())] if plugins.offers() else []))
