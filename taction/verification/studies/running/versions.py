"""Versions and machine of a study, equal in all its processes, and the digests of its inputs.

Digests of plain data are the keys of stored results. The encoding contains the type of every value
and the shape of every array, and mappings are sorted, so equal content gives equal digests on any
machine and in any version of Python.
"""

from __future__ import annotations

import dataclasses
import enum
import functools
import hashlib
import operator
import os
import platform
import time
from collections.abc import Callable, Mapping, Sequence
from importlib import metadata
from pathlib import Path
from typing import Any

import numpy as np
from pydantic import BaseModel

from taction import netlist_gen, spice_models, system, verification
from taction.system import plugins
from taction.system.errors import SimulationError, SimulatorNotFound, SimulatorTooOld
from taction.system.processes import THREADS
from taction.verification.engines.ngspice.executable import Simulator, find_simulator

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
    if kind in PLAIN:
        parts.append(_word(repr(value)))
    elif isinstance(value, tuple | list):
        _encode_items(b"t", value, parts)
    elif (fields := _fields(kind)) is not None:
        _encode_items(kind.__name__.encode(), fields(value), parts)
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


def _encode_items(name: bytes, values: Sequence[object], parts: list[bytes]) -> None:
    """Encode some values; plain ones together, because a board has hundreds of small parts."""
    parts.append(b"%b%d:" % (name, len(values)))
    if PLAIN.issuperset(map(type, values)):
        parts.append(_word(repr(tuple(values))))
        return
    for value in values:
        _encode(value, parts)


def _word(text: str) -> bytes:
    """Encode the text of plain values, which shows their types."""
    return f"{len(text)}:{text}".encode()


@functools.cache
def _fields(kind: Any) -> Callable[[Any], tuple[object, ...]] | None:
    """Return what reads the fields of a dataclass that its digest needs; None of another type."""
    if not dataclasses.is_dataclass(kind):
        return None
    names = [f.name for f in dataclasses.fields(kind) if f.metadata.get("digest", True)]
    if len(names) > 1:
        return operator.attrgetter(*names)
    return lambda value: tuple(getattr(value, name) for name in names)


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


class OtherVersionsError(Exception):
    """A worker has other versions than the study; its results would not be comparable."""


@plugins.cached
def own_version(ngspice: bool) -> str:
    """Return taction, its source, its plug-ins and ngspice, as far as they can change a result.

    Raises
    ------
    SimulatorNotFound, SimulatorTooOld
        No ngspice was found, or it is too old.
    """
    added = sorted(set(map(plugins.distribution, plugins.offers())))
    name = simulator_name(find_simulator()) if ngspice else "no ngspice"
    source = f"taction {metadata.version('taction')} ({own_code().hex()[:8]})"
    return ", ".join((source, *added, name))


def check_version(version: str) -> None:
    """Raise OtherVersionsError if this process has another version than the study."""
    try:
        here = own_version(not version.endswith("no ngspice"))
    except (SimulatorNotFound, SimulatorTooOld) as error:
        here = f"no usable ngspice ({str(error).partition('. ')[0]})"
    if here != version:
        raise OtherVersionsError(f"{platform.node()} has {here} instead of {version}")


def simulator_name(simulator: Simulator) -> str:
    """Return version and matrix solver of an ngspice, the properties that can change a result."""
    return f"{simulator.engine} {simulator.solver_option}"


PACKAGES = ("taction", "numpy", "scipy")


def describe_machine() -> dict[str, str | int | float | None]:
    """Return versions, processor, load and threads as plain data."""
    try:
        simulator = find_simulator()
        ngspice: str | None = f"{simulator.version} ({simulator.solver_option})"
    except SimulationError:
        ngspice = None
    set_threads = {name: os.environ[name] for name in THREADS if name in os.environ}
    return {
        "date": time.strftime("%Y-%m-%dT%H:%M:%SZ", time.gmtime()),
        "processor": _processor(),
        "cores": os.cpu_count(),
        "load": os.getloadavg()[0] if hasattr(os, "getloadavg") else None,
        "threads": ", ".join(f"{k}={v}" for k, v in set_threads.items()) or "not limited",
        "system": f"{platform.system()} {platform.release()}",
        "python": platform.python_version(),
        "ngspice": ngspice,
        **{package: metadata.version(package) for package in PACKAGES},
    }


def _processor() -> str:
    """Return the processor's name, on Linux from /proc."""
    listing = Path("/proc/cpuinfo")
    if listing.exists():
        for line in listing.read_text(encoding="utf-8", errors="replace").splitlines():
            if line.startswith("model name"):
                return line.partition(":")[2].strip()
    return platform.processor() or platform.machine()
