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
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Any

import numpy as np
from pydantic import BaseModel

import netlist_gen
import spice_models

CODE = (".py", ".toml")


def digest(*values: object) -> bytes:
    """Return the SHA-256 of `values`: dataclasses, models, containers, arrays, plain values.

    Raises
    ------
    TypeError
        A value of another kind: its content is not known.
    """
    found = hashlib.sha256()
    for part in _encode(values):
        found.update(part)
    return found.digest()


def _encode(value: object) -> Iterator[bytes]:
    if value is None or isinstance(value, bool | int | float | str):
        yield _plain(value)
    elif isinstance(value, enum.Enum):
        yield from _encode(value.value)
    elif isinstance(value, bytes):
        yield b"y%d:" % len(value) + value
    elif isinstance(value, np.ndarray):
        little = np.ascontiguousarray(value, dtype=value.dtype.newbyteorder("<"))
        yield f"a{little.dtype.str}{little.shape}:".encode() + little.tobytes()
    elif isinstance(value, tuple | list):
        yield b"t%d:" % len(value)
        for item in value:
            yield from _encode(item)
    elif isinstance(value, Mapping):
        yield from _encode(tuple(sorted(value.items())))
    elif isinstance(value, BaseModel):
        yield from _encode(value.model_dump(by_alias=True))
    elif dataclasses.is_dataclass(value):
        kind: Any = type(value)
        yield type(value).__name__.encode() + b":"
        for name in _names(kind):
            yield from _encode(getattr(value, name))
    else:
        raise TypeError(f"no canonical encoding of {type(value).__name__}")


def _plain(value: object) -> bytes:
    text = repr(value)
    return f"{type(value).__name__}{len(text)}:{text}".encode()


@functools.cache
def _names(kind: Any) -> tuple[str, ...]:
    return tuple(field.name for field in dataclasses.fields(kind))


@functools.cache
def design_code() -> bytes:
    """Digest of the code that turns a scene into a circuit.

    A scene that was met before need not be synthesised again to know its circuit, as long as
    this is the same.
    """
    folders = (Path(str(package.__file__)).parent for package in (spice_models, netlist_gen))
    files = sorted(f for folder in folders for f in folder.iterdir() if f.suffix in CODE)
    return digest([(file.name, file.read_bytes()) for file in files])
