"""The schemas of all documents, as they are published in ``docs/schemas``."""

from __future__ import annotations

import json
from collections.abc import Iterator
from typing import Any

from pydantic import BaseModel

from taction.system import documents
from taction.verification.report.schemas import (
    benchmarks,
    choice,
    grids,
    opamps,
    plain,
    shared,
    studies,
    verdict,
)
from taction.verification.report.schemas.head import ERROR, schema_name
from taction.verification.report.schemas.units import UNIT_OF
from taction.verification.studies.difference import VerdictDifference

MODELS: dict[str, type] = {
    "verify": verdict.VerifyDocument,
    "verify-files": verdict.VerifyFilesDocument,
    "diff": VerdictDifference,
    "netlist": plain.NetlistDocument,
    "bom": plain.BomDocument,
    "kicad": plain.KicadDocument,
    "explore": plain.ExploreDocument,
    "solve": plain.SolveDocument,
    "simulate": verdict.SimulateDocument,
    "montecarlo": studies.MontecarloDocument,
    "montecarlo-sample": verdict.SampleDocument,
    "corners": studies.CornersDocument,
    "tune": plain.TuneDocument,
    "scale": plain.ScaleDocument,
    "choose": choice.ChooseDocument,
    "onset": grids.OnsetDocument,
    "sweep": grids.SweepDocument,
    "regress": studies.RegressDocument,
    "stress": benchmarks.StressDocument,
    "accuracy": benchmarks.AccuracyDocument,
    "reproduce": benchmarks.ReproduceDocument,
    "models": opamps.ModelsDocument,
    "models-show": opamps.ShowDocument,
    "models-import": opamps.ImportDocument,
    "new": plain.NewDocument,
    "new-matrix": plain.NewMatrixDocument,
    "help": plain.HelpDocument,
    "doctor": plain.DoctorDocument,
    ERROR: shared.ErrorDocument,
}
"""By the name of the schema: that of the command, or of one of its documents."""


def schemas() -> Iterator[tuple[str, str]]:
    """Yield the name of each file in ``docs/schemas`` and its text."""
    for name in MODELS:
        text = json.dumps(schema(name), indent=1, ensure_ascii=False)
        yield f"{schema_name(name)}.json", f"{text}\n"


def schema(name: str) -> dict[str, Any]:
    """Return the JSON Schema of the documents `name`; a field with a unit has it as `unit`."""
    kind = MODELS[name]
    if issubclass(kind, BaseModel):
        made = kind.model_json_schema(by_alias=True)
        _with_units(made)
    else:
        made = documents.schema(kind)
        definitions = shared.Head.model_json_schema(by_alias=True)
        made["properties"] = {"taction": definitions} | made["properties"]
        made["required"] = ["taction", *made["required"]]
    head = {"$schema": "https://json-schema.org/draft/2020-12/schema", "$id": schema_name(name)}
    return head | made


def fields() -> dict[str, dict[str, Any]]:
    """Return for every field of a document its unit, if it has one, and the schemas that have it.

    Examples
    --------
    >>> found = fields()["stable_ranges"]
    >>> found["unit"], found["schemas"]
    (None, ['verify-2', 'verify-files-2', 'montecarlo-sample-2', 'tune-2', 'scale-2', 'onset-2', \
'new-matrix-2'])
    """
    found: dict[str, dict[str, Any]] = {}
    for name in MODELS:
        for field in sorted(set(_names(schema(name)))):
            entry = found.setdefault(field, {"unit": UNIT_OF.get(field), "schemas": []})
            entry["schemas"].append(schema_name(name))
    return dict(sorted(found.items()))


def _names(part: Any) -> Iterator[str]:
    if isinstance(part, dict):
        yield from part.get("properties", {})
        part = list(part.values())
    if isinstance(part, list):
        for item in part:
            yield from _names(item)


def _with_units(part: Any) -> None:
    if isinstance(part, dict):
        for name, field in part.get("properties", {}).items():
            if name in UNIT_OF and "unit" not in part["properties"] and "$ref" not in field:
                field["unit"] = UNIT_OF[name]
        for item in part.values():
            _with_units(item)
    elif isinstance(part, list):
        for item in part:
            _with_units(item)
