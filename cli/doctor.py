"""``taction doctor``."""

from __future__ import annotations

import os
import platform
import sys
from importlib import metadata, util
from pathlib import Path
from typing import Any

import click

from taction.cli.common import command, print_json
from taction.system.errors import SimulationError

EXTRAS = (
    ("matplotlib", "--plot", "pip install 'taction[plot]'"),
    ("jinja2", "--report", "pip install 'taction[report]'"),
    ("plotly", "--report", "pip install 'taction[report]'"),
    ("schemdraw", "--report", "pip install 'taction[report]'"),
    ("nicegui", "explore", "pip install 'taction[explore]'"),
    ("pyarrow", "waveforms and sweeps as Parquet", "pip install 'taction[parquet]'"),
    ("xarray", "sweeps as netCDF", "pip install 'taction[netcdf]'"),
    ("pandas", "to_pandas() of studies, in Python", "pip install 'taction[data]'"),
    ("nicegui", "taction explore", "pip install 'taction[explore]'"),
    ("distributed", "sweeps on a cluster", "pip install 'taction[cluster]'"),
)


@command
def doctor(as_json: bool) -> None:
    """List what is installed and what each part is needed for.

    Exit status: 3 if ngspice is missing.
    """
    findings = [_python(), _simulator(), *_blas(), *_extras()]
    if as_json:
        print_json({"findings": findings, "ok": all(f["ok"] for f in findings)})
    else:
        for finding in findings:
            mark = "ok     " if finding["ok"] else "missing"
            click.echo(f"{mark}  {finding['what']}: {finding['found']}")
            click.echo(f"         {finding['means']}")
    if not findings[1]["ok"]:
        sys.exit(3)


def _python() -> dict[str, Any]:
    packages = ("PySpice", "numpy", "scipy", "pydantic", "click", "quantiphy", "rich")
    return {
        "what": "Python",
        "ok": True,
        "found": f"{platform.python_version()} on {platform.system()}, {os.cpu_count()} cores",
        "means": ", ".join(f"{name} {metadata.version(name)}" for name in packages),
    }


def _simulator() -> dict[str, Any]:
    from taction.verification.engines.ngspice.executable import find_simulator

    try:
        simulator = find_simulator()
    except SimulationError as error:
        means = "taction uses its state-space engine only, without the comparison with ngspice"
        return {"what": "ngspice", "ok": False, "found": str(error), "means": means}
    return {
        "what": "ngspice",
        "ok": True,
        "found": f"{simulator.version} at {simulator.executable}",
        "means": "with the matrix solver KLU: fast on large boards"
        if simulator.klu
        else "without the matrix solver KLU: slow on boards of more than 32 channels",
    }


def _blas() -> list[dict[str, Any]]:
    """One finding a BLAS library: numpy and scipy bring their own."""
    import numpy as np  # noqa: F401
    import scipy.linalg  # noqa: F401
    from threadpoolctl import threadpool_info

    return [
        {
            "what": f"BLAS of {Path(library['filepath']).parent.name.partition('.')[0]}",
            "ok": True,
            "found": f"{library['internal_api']} {library['version'] or 'of no stated version'}, \
{library.get('architecture', 'unnamed')} kernels, threads: {library['num_threads']}",
            "means": "rounding differs between kernels; OPENBLAS_CORETYPE chooses others",
        }
        for library in threadpool_info()
        if library["user_api"] == "blas"
    ]


def _extras() -> list[dict[str, Any]]:
    return [
        {
            "what": package,
            "ok": util.find_spec(package) is not None,
            "found": "installed" if util.find_spec(package) else f"not installed: {remedy}",
            "means": f"needed only for {purpose}",
        }
        for package, purpose, remedy in EXTRAS
    ]
