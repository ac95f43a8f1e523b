"""The documents of all commands by name: their head, and their schemas as they are published."""

from __future__ import annotations

import json
from collections.abc import Iterator
from dataclasses import dataclass
from functools import cache
from importlib import import_module, metadata
from typing import Annotated, Any

from taction.system import documents
from taction.system.errors import SimulationError
from taction.verification.engines.ngspice.process import find_simulator

VERSION = 2  # of all schemas; a field that changes its name or its meaning increases it
ERROR = "error"


@dataclass(frozen=True, slots=True)
class Head:
    """What made a document: `units` has the unit of every field of the document that has one."""

    version: str
    name: Annotated[str, {"key": "schema"}, {"note": "name and version of the schema"}]
    simulator: Annotated[str | None, {"note": "ngspice of this machine; null where there is none"}]
    solver: Annotated[str | None, {"note": "its matrix solver"}]
    units: dict[str, str]


MODELS = {
    "verify": "verification.report.documents.verdict.VerdictBody",
    "verify-files": "verification.report.documents.plain.VerifyFilesDocument",
    "check": "verification.studies.decks.board_check.BoardCheck",
    "demo": "verification.evidence.demonstration.Demonstration",
    "diff": "verification.studies.regression.difference.VerdictDifference",
    "netlist": "verification.verdict.board_files.Netlist",
    "bom": "verification.verdict.board_files.PartsList",
    "build": "verification.verdict.board_files.BuiltBoard",
    "explore": "verification.report.documents.plain.ExploreDocument",
    "solve": "verification.reference.problem.Solution",
    "simulate": "verification.report.documents.verdict.VerdictBody",
    "montecarlo": "verification.studies.tolerance.montecarlo.YieldReport",
    "corners": "verification.studies.tolerance.corners.CornerStudy",
    "tune": "verification.design.tune.Tuned",
    "scale": "verification.design.scaling.Scaled",
    "choose": "verification.design.choose.Choice",
    "onset": "verification.studies.onset.Onset",
    "sweep": "verification.studies.sweep.SweepResult",
    "regress": "verification.studies.regression.regress.RegressionReport",
    "stress": "verification.evidence.stress.run_cases.StressReport",
    "accuracy": "verification.studies.work_precision.WorkPrecisionStudy",
    "reproduce": "verification.evidence.paper.reproduce.Reproduction",
    "models": "verification.report.documents.plain.ModelsDocument",
    "models-show": "verification.report.documents.plain.ShowDocument",
    "models-import": "verification.report.documents.plain.ImportDocument",
    "new": "verification.report.documents.plain.NewDocument",
    "new-matrix": "verification.report.documents.plain.NewMatrixDocument",
    ERROR: "system.documents.ErrorDocument",
}
"""By the name of the schema: that of the command, or of one of its documents."""


def model(name: str) -> Any:
    """Return the type of the documents `name`; its module is loaded at the first use."""
    module, _, kind = MODELS[name].rpartition(".")
    return getattr(import_module(f"{__name__.partition('.')[0]}.{module}"), kind)


@cache
def units(name: str) -> dict[str, str]:
    """Return the unit of every field of the documents `name` that has one."""
    return documents.units(model(name))


def document_head(name: str) -> dict[str, Any]:
    """Return the field ``taction`` of a document of the schema `name`."""
    simulator = solver = None
    try:
        found = find_simulator()
        simulator, solver = found.engine, "KLU" if found.klu else "SPARSE"
    except SimulationError:  # none, or none that can be used
        pass
    head = Head(metadata.version("taction"), schema_name(name), simulator, solver, units(name))
    return {"taction": documents.plain(head)}


def schema_name(name: str) -> str:
    """Return the name of a schema with its version, and of its file without the ending."""
    return f"{name}-{VERSION}"


def schemas() -> Iterator[tuple[str, str]]:
    """Yield the name of each file in ``docs/schemas`` and its text."""
    for name in MODELS:
        text = json.dumps(schema(name), indent=1, ensure_ascii=False)
        yield f"{schema_name(name)}.json", f"{text}\n"


def schema(name: str) -> dict[str, Any]:
    """Return the JSON Schema of the documents `name`; a field with a unit has it as `unit`."""
    made = documents.schema(model(name))
    first = {"$schema": "https://json-schema.org/draft/2020-12/schema", "$id": schema_name(name)}
    properties = {"taction": documents.schema(Head), **made.pop("properties", {})}
    required = ["taction", *made.pop("required", [])]
    return first | made | {"properties": properties, "required": required}
