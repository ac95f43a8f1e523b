"""The documents of all commands beside their schemas, and what stands in a terminal."""

from __future__ import annotations

import json
import re
from itertools import count, pairwise
from pathlib import Path
from typing import Any

import jsonschema
import pytest

from taction.cli.commands import COMMANDS
from taction.cli.printing import StageLine
from taction.verification.report.documents.document_catalogue import (
    MODELS,
    schema,
    schema_name,
    schemas,
    units,
)
from tests.support.command_lines import LINES, line
from tests.support.entries import write_fast
from tests.support.paths import ROOT
from tests.support.running import document, printed_objects, shown_at, taction, words_of

FOLDER = ROOT / "docs" / "schemas"
ONE = """
[problem]
kind = "matrix"
matrix = [[2.0]]
strain = [1.0]
[design]
capacitance = "1nF"
gain = "10kohm"
[analysis]
engine = "statespace"
"""


@pytest.fixture
def folder(boards: Path) -> Path:
    (boards / "ringing.toml").write_text(ONE.replace("1nF", "10pF").replace('gain = "10kohm"', ""))
    other = write_fast(boards / "other.toml").read_text()
    (boards / "ngspice.toml").write_text(
        other.replace('"statespace"', '"ngspice"').replace("[checks]", '[checks]\nnoise = "1V"')
    )
    exponential = other.replace("[design]", '[design]\namplifier = "exponential"')
    (boards / "exponential.toml").write_text(exponential)
    short = other.replace('"statespace"', '"ngspice"\nstop = "10ns"')
    (boards / "short.toml").write_text(short)
    return boards


def mistakes(found: Any, name: str) -> list[str]:
    validator = jsonschema.Draft202012Validator(schema(name))
    return [f"{error.json_path}: {error.message[:300]}" for error in validator.iter_errors(found)]


def test_every_schema_has_a_command_and_every_command_a_schema() -> None:
    names = {name.partition(",")[0] for name in LINES}
    assert names == set(MODELS) - {"explore"}  # which serves until Ctrl-C: `test_explore`
    known = {name.partition("-")[0] for name in MODELS}
    assert known == set(COMMANDS) - {"mcp"} | {"error", "help"}  # its stdout is the protocol's


def test_the_published_schemas_are_those_of_the_models() -> None:
    published = {path.name: path.read_text(encoding="utf-8") for path in FOLDER.glob("*.json")}
    assert published == dict(schemas()), "run: make schemas"


@pytest.mark.usefixtures("folder", "quick_stories")
@pytest.mark.parametrize("name", LINES)
def test_a_real_document_fits_its_schema(
    name: str, ngspice: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    if name == "error, no ngspice":
        monkeypatch.setenv("TACTION_NGSPICE", "/nowhere/ngspice")
    found = document(taction(*line(name), "--json"))
    kind = name.partition(",")[0]
    assert mistakes(found, kind) == []
    head = found["taction"]
    assert head["schema"] == schema_name(kind)
    assert (FOLDER / f"{head['schema']}.json").is_file()
    assert re.fullmatch(r"\d+\.\d+.*", head["version"])
    if name != "error, no ngspice":
        assert head["simulator"].startswith("ngspice-")
        assert head["solver"] in ("KLU", "SPARSE")
    if kind != "help":
        assert head["units"] == units(kind)


def open_parts(part: Any, place: str) -> list[str]:
    """The places of a schema at which any field, or any value, is accepted."""
    found = []
    if isinstance(part, list):
        return [name for item in part for name in open_parts(item, place)]
    if not isinstance(part, dict):
        return []
    if part.get("type") == "object" and part.get("additionalProperties", True) is True:
        found.append(place)
    for name, field in part.get("properties", {}).items():
        kinds = {"type", "$ref", "anyOf", "const", "enum"}
        found += [] if kinds & set(field) else [f"{place}.{name}"]
        found += open_parts(field, f"{place}.{name}")
    for key in part.keys() - {"properties"}:
        inside = f"{place}.{key}" if key not in ("$defs", "anyOf", "items") else place
        found += open_parts(part[key], inside)
    return found


def test_no_schema_has_an_open_part() -> None:
    assert [place for name in MODELS for place in open_parts(schema(name), name)] == []


def test_published_schemas_are_valid_and_name_units() -> None:
    for path in FOLDER.glob("*.json"):
        known = json.loads(path.read_text(encoding="utf-8"))
        jsonschema.Draft202012Validator.check_schema(known)
        assert known["$id"] == path.stem
    verdict = json.loads((FOLDER / "verify-2.json").read_text(encoding="utf-8"))
    assert verdict["properties"]["settling_time"]["unit"] == "s"


def test_lines_become_rare() -> None:
    said: list[str] = []
    seconds = count(0.0, 1.0)
    line = StageLine(say=said.append, clock=lambda: next(seconds))
    for number in range(1, 3601):
        line(str(number))
    assert said[:5] == ["10", "15", "23", "35", "53"]  # seconds, each 1.5 times the last
    assert len(said) == 20
    assert max(int(b) - int(a) for a, b in pairwise(said)) == 300


WIDTHS = (40, 80, 100)

# The variant of a command with the widest tables.
WIDE = {
    "verify": "verify a.toml --margins -v",
    "check": "check filter.cir --over Rf=1k:100k:5 --check stable --no-ngspice",
    "corners": "corners a.toml --corner capacitor=-1 --corner resistor=1",
    "sweep": "sweep a.toml --over C=1pF:10pF:2 --over opamp=ua741,op27 --jobs 1",
}
SAME = ("verify-files", "diff", "bom", "montecarlo", "regress", "models-show", "tune")
TABLES = {**{name: LINES[name] for name in SAME}, **WIDE}


@pytest.mark.usefixtures("boards")
@pytest.mark.parametrize("name", TABLES)
def test_a_narrow_page_loses_nothing(name: str, monkeypatch: pytest.MonkeyPatch) -> None:
    objects = printed_objects(monkeypatch, *TABLES[name].split())
    wide = words_of(shown_at(200, objects))
    assert len(wide) > 10
    for width in WIDTHS:
        narrow = shown_at(width, objects)
        lost = wide - words_of(narrow)
        assert not lost, f"{width} columns:\n{narrow}"
        assert "…" not in narrow
