"""Versions and machine of a study; versions must be equal in its process and in its workers."""

from __future__ import annotations

import os
import platform
import time
from dataclasses import dataclass, replace
from importlib import metadata
from pathlib import Path

from taction.system import plugins
from taction.system.errors import SimulationError, SimulatorNotFound, SimulatorTooOld
from taction.system.processes import THREADS
from taction.verification.engines.ngspice.executable import Simulator, find_simulator
from taction.verification.studies.running.digests import own_code


class OtherVersionsError(Exception):
    """A worker has other versions than the study; its results would not be comparable."""


@dataclass(frozen=True, slots=True)
class Versions:
    """Versions of taction, of its source, of ngspice and of plug-ins."""

    taction: str
    code: bytes
    ngspice: str
    plugins: str = ""  # their names and versions

    def differences(self, other: Versions) -> list[str]:
        """Return the differences of `other` in words; empty if there are none."""
        texts = []
        if self.taction != other.taction:
            texts.append(f"taction {other.taction} instead of {self.taction}")
        if self.plugins != other.plugins:
            names = [versions.plugins or "none" for versions in (other, self)]
            texts.append(f"plug-ins: {names[0]} instead of {names[1]}")
        elif self.taction == other.taction and self.code != other.code:
            source = f"taction {self.taction}{' or of its plug-ins' if self.plugins else ''}"
            texts.append(f"another state of the source of {source}")
        if self.ngspice != other.ngspice:
            texts.append(f"{other.ngspice} instead of {self.ngspice}")
        return texts

    def check_here(self) -> None:
        """Raise OtherVersionsError if this process has other versions, or no ngspice."""
        if texts := self.differences(_versions_here(bool(self.ngspice))):
            raise OtherVersionsError(f"{platform.node()} has {', '.join(texts)}")


def _versions_here(ngspice: bool) -> Versions:
    """Return `own_versions`, also where no ngspice can be used."""
    try:
        return own_versions(ngspice)
    except (SimulatorNotFound, SimulatorTooOld) as error:
        reason = str(error).partition(". ")[0]  # without the remedy, which is for this machine
        return replace(own_versions(False), ngspice=f"no usable ngspice ({reason})")


@plugins.cached
def own_versions(ngspice: bool) -> Versions:
    """Return the versions of this process, with or without that of ngspice.

    Raises
    ------
    SimulatorNotFound, SimulatorTooOld
        No ngspice was found, or it is too old.
    """
    name = simulator_name(find_simulator()) if ngspice else ""
    added = sorted({f"{offer.distribution} {offer.version}" for offer in plugins.offers()})
    return Versions(metadata.version("taction"), own_code(), name, ", ".join(added))


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
