"""``taction models`` and ``taction doctor``."""

from __future__ import annotations

import os
import platform
import sys
from importlib import metadata, util
from pathlib import Path
from typing import Any

import click

from cli.common import json_option, print_json, reports_errors
from spice_models.errors import SimulationError

FIGURES = (
    ("dc_gain", "", "gain"),
    ("gbw", "Hz", "GBW"),
    ("second_pole", "Hz", "second pole"),
    ("input_resistance", "ohm", "R in"),
    ("differential_capacitance", "F", "C diff"),
    ("input_capacitance", "F", "C in"),
    ("output_resistance", "ohm", "R out"),
)
EXTRAS = (
    ("matplotlib", "--plot", "pip install 'taction[plot]'"),
    ("pyarrow", "waveforms and sweeps as Parquet", "pip install 'taction[parquet]'"),
    ("xarray", "sweeps as netCDF", "pip install 'taction[netcdf]'"),
    ("distributed", "sweeps on a cluster", "pip install 'taction[cluster]'"),
)


@click.command(short_help="The op-amp presets and their figures.")
@json_option
@reports_errors
def models(as_json: bool) -> None:
    """List the op-amp presets: figures in SI units, and where they were published."""
    from netlist_gen.quantities import show
    from spice_models.presets import load_presets

    presets = load_presets()
    if as_json:
        print_json(
            {
                name: {figure: getattr(model, figure) for figure, _, _ in FIGURES}
                | {"source": model.source}
                for name, model in presets.items()
            }
        )
        return
    from rich.console import Console
    from rich.table import Table

    table = Table("preset", *(title for _, _, title in FIGURES))
    for name, model in presets.items():
        table.add_row(name, *(show(getattr(model, f), unit) for f, unit, _ in FIGURES))
    console = Console()
    console.print(table)
    for name, model in presets.items():
        console.print(f"[bold]{name}[/bold]: {model.source}", highlight=False)


@click.command(short_help="What is installed, and what that means.")
@json_option
@reports_errors
def doctor(as_json: bool) -> None:
    """Say what is installed and what follows from it. Ends with 3 where ngspice is missing."""
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
    versions = ", ".join(f"{name} {metadata.version(name)}" for name in packages)
    return {
        "what": "Python",
        "ok": True,
        "found": f"{platform.python_version()} on {platform.system()}, {os.cpu_count()} cores",
        "means": versions,
    }


def _simulator() -> dict[str, Any]:
    from verification.engines.ngspice.executable import find_simulator

    try:
        found = find_simulator()
    except SimulationError as error:
        means = "taction works on its state-space engine alone; one witness less"
        return {"what": "ngspice", "ok": False, "found": str(error), "means": means}
    klu = "with KLU: fast on large boards" if found.klu else "no KLU: slow beyond 32 channels"
    return {
        "what": "ngspice",
        "ok": True,
        "found": f"{found.version} at {found.executable}",
        "means": klu,
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
            "means": f"needed for {purpose}, nothing else",
        }
        for package, purpose, remedy in EXTRAS
    ]
