"""What a study depends on: versions, the machine, digests of its inputs; and what is installed."""

from __future__ import annotations

import functools
import hashlib
import json
import os
import platform
import re
import time
from contextlib import suppress
from dataclasses import dataclass
from importlib import metadata, util
from pathlib import Path
from typing import Annotated, Any

import numpy as np
from pydantic import BaseModel

from taction import netlist_gen, spice_models, system, verification
from taction.netlist_gen.scene.scene import Scene
from taction.system import plugins
from taction.system.documents import HIDDEN
from taction.system.errors import SimulationError
from taction.system.foreign_files import LARGEST, UnusableFileError, read_bounded
from taction.system.processes import THREADS
from taction.system.results import Result
from taction.verification.engines.ngspice.executable import find_simulator


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


NEEDED = ("PySpice", "numpy", "scipy", "pydantic", "click", "rich")
EXTRAS = (
    ("matplotlib", "--plot", "pip install 'taction[plot]'"),
    ("jinja2", "--report", "pip install 'taction[report]'"),
    ("plotly", "--report", "pip install 'taction[report]'"),
    ("starlette", "explore", "pip install 'taction[explore]'"),
    ("pyarrow", "waveforms and sweeps as Parquet", "pip install 'taction[parquet]'"),
    ("spicelib", "diff with raw files in text or of LTspice", "pip install 'taction[raw]'"),
    ("mcp", "mcp: tools for programs", "pip install 'taction[mcp]'"),
    ("pandas", "to_pandas() of studies, in Python", "pip install 'taction[data]'"),
    ("distributed", "sweeps on a cluster", "pip install 'taction[cluster]'"),
)
"""Optional packages, what each is needed for, and how to install it."""


@dataclass(frozen=True, slots=True)
class InstalledPart:
    """A part of the installation."""

    what: str
    ok: bool
    found: str
    means: str


@dataclass(frozen=True, slots=True)
class Installation(Result):
    """The results of `taction.doctor`: what is installed, and what it is needed for."""

    VIEW = "taction.verification.report.views.answer_view:installation_view"
    SHOWN = ("ok",)

    findings: tuple[InstalledPart, ...]

    @property
    def ok(self) -> bool:
        """Whether nothing is missing."""
        return all(each.ok for each in self.findings)

    @property
    def outcome(self) -> Annotated[str, HIDDEN]:
        """``inconclusive`` if ngspice is missing."""
        simulator = next(each for each in self.findings if each.what == "ngspice")
        return "pass" if simulator.ok else "inconclusive"


def doctor() -> Installation:
    """List what is installed and what each part is needed for.

    Returns
    -------
    Installation
        `findings`: Python, ngspice and the optional packages.

    Examples
    --------
    >>> import taction
    >>> [finding.what for finding in taction.doctor().findings][:2]
    ['Python', 'ngspice']
    """
    python = f"{platform.python_version()} on {platform.system()}, {os.cpu_count()} cores"
    versions = ", ".join(f"{name} {metadata.version(name)}" for name in NEEDED)
    extras = (
        InstalledPart(name, there, "installed" if there else f"not installed: {remedy}", needed)
        for name, purpose, remedy in EXTRAS
        for there, needed in [(util.find_spec(name) is not None, f"needed only for {purpose}")]
    )
    first = InstalledPart("Python", True, python, versions)
    return Installation((first, _simulator(), *extras))


def _simulator() -> InstalledPart:
    try:
        simulator = find_simulator()
    except SimulationError as error:
        means = "taction uses its state-space engine only, without the comparison with ngspice"
        return InstalledPart("ngspice", False, str(error), means)
    slow = "without the matrix solver KLU: slow on boards of more than 32 channels"
    means = "with the matrix solver KLU: fast on large boards" if simulator.klu else slow
    return InstalledPart("ngspice", True, f"{simulator.version} at {simulator.executable}", means)
