"""The head of every document: what made it, its schema, and the units of its fields."""

from __future__ import annotations

from importlib import metadata
from typing import Any

from taction.system.errors import SimulationError
from taction.verification.engines.ngspice.executable import find_simulator
from taction.verification.report.schemas.units import units_in

VERSION = 2  # of all schemas; a field that changes its name or its meaning increases it
ERROR = "error"


def document_head(name: str, document: object) -> dict[str, Any]:
    """Return the field ``taction`` of a document of the schema `name`."""
    simulator = solver = None
    try:
        found = find_simulator()
        simulator, solver = found.engine, "KLU" if found.klu else "SPARSE"
    except SimulationError:  # none, or none that can be used
        pass
    return {
        "taction": {
            "version": metadata.version("taction"),
            "schema": schema_name(name),
            "simulator": simulator,
            "solver": solver,
            "units": units_in(document),
        }
    }


def schema_name(name: str) -> str:
    """Return the name of a schema with its version, and of its file without the ending.

    Examples
    --------
    >>> schema_name("verify")
    'verify-2'
    """
    return f"{name}-{VERSION}"
