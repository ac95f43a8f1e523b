"""What is installed, and what each part is needed for."""

from __future__ import annotations

import os
import platform
from dataclasses import dataclass
from importlib import metadata, util
from typing import Annotated

from taction.system.documents import HIDDEN
from taction.system.errors import SimulationError
from taction.system.results import Result
from taction.verification.engines.ngspice.executable import find_simulator

PACKAGES = ("PySpice", "numpy", "scipy", "pydantic", "click", "rich")
EXTRAS = (
    ("matplotlib", "--plot", "pip install 'taction[plot]'"),
    ("jinja2", "--report", "pip install 'taction[report]'"),
    ("plotly", "--report", "pip install 'taction[report]'"),
    ("starlette", "explore", "pip install 'taction[explore]'"),
    ("pyarrow", "waveforms and sweeps as Parquet", "pip install 'taction[parquet]'"),
    ("xarray", "sweeps as netCDF", "pip install 'taction[netcdf]'"),
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
    versions = ", ".join(f"{name} {metadata.version(name)}" for name in PACKAGES)
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
