"""Description of the machine and the versions of a study."""

from __future__ import annotations

import os
import platform
import time
from importlib import metadata
from pathlib import Path

from taction.system.errors import SimulationError
from taction.system.processes import THREADS
from taction.verification.engines.ngspice.executable import find_simulator

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
