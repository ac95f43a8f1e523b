"""What a study depends on: versions, the machine, and digests of its inputs."""

from __future__ import annotations

import functools
import hashlib
import json
import os
import platform
import re
import time
from contextlib import suppress
from importlib import metadata
from pathlib import Path
from typing import Any

import numpy as np
from pydantic import BaseModel

from taction import netlist_gen, spice_models, system, verification
from taction.netlist_gen.scene.scene import Scene
from taction.system import plugins
from taction.system.errors import SimulationError
from taction.system.foreign_files import LARGEST, UnusableFileError, read_bounded
from taction.system.processes import THREADS
from taction.verification.engines.ngspice.process import find_simulator


def digest(*values: object) -> bytes:
    """Return the SHA-256 of `values`: models, lists, dicts, arrays, bytes, plain values.

    Types and borders count and dicts are sorted: equal content has equal digests on any machine.
    """
    return hashlib.sha256(json.dumps(values, default=_plain, sort_keys=True).encode()).digest()


def _plain(value: Any) -> Any:
    """Return the content of a value as plain data."""
    if isinstance(value, bytes):
        return {"bytes": value.hex()}
    if isinstance(value, np.ndarray):
        little = np.ascontiguousarray(value, dtype=value.dtype.newbyteorder("<"))
        return {little.dtype.str: little.shape, "bytes": little.tobytes().hex()}
    if isinstance(value, BaseModel):
        return value.model_dump(by_alias=True)
    raise TypeError(f"no digest of {type(value).__name__}")


def file_content(scene: Scene, name: str) -> bytes:
    """Return the SHA-256 of a file that a scene names; empty where it cannot be read."""
    with suppress(UnusableFileError):
        return hashlib.sha256(read_bounded(scene.folder / name, LARGEST)).digest()
    return b""


@functools.cache
def own_code() -> bytes:
    """Return the digest of the code between scene and verdict, with that of plug-ins."""
    packages = (system, spice_models, netlist_gen, verification)
    folders = [Path(str(package.__file__)).parent for package in packages]
    texts = [
        (f"{folder.name}/{file.relative_to(folder)}", file.read_bytes())
        for folder in folders
        for file in sorted(each for each in folder.rglob("*") if each.suffix in plugins.CODE)
    ]
    return digest(texts, *([tuple(plugins.sources())] if plugins.offers() else []))


def simulator_name(engine: str = "ngspice") -> str:
    """Return version and matrix solver of ngspice; empty for another engine."""
    if engine != "ngspice":
        return ""
    simulator = find_simulator()
    return f"{simulator.engine} {simulator.solver_option}"


def study_key(engine: str, *values: object) -> bytes:
    """Return the digest of `values`, of the code and of the simulator that give a result."""
    return digest(own_code(), simulator_name(engine), engine, *values)


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
    text = listing.read_text(encoding="utf-8", errors="replace") if listing.exists() else ""
    named = re.search(r"^model name\s*:\s*(.+)$", text, re.MULTILINE)
    return named[1].strip() if named else platform.processor() or platform.machine()
