"""The documents of all commands beside their published schemas."""

from __future__ import annotations

import json
import re
from pathlib import Path
from typing import Any

import jsonschema
import pytest

from cli.main import COMMANDS
from tests.support.entries import write_fast
from tests.support.paths import ROOT
from tests.support.running import document, taction
from verification.report.schemas.catalogue import MODELS, schema, schemas
from verification.report.schemas.head import schema_name
from verification.report.schemas.units import UNIT_OF, units_in

FOLDER = ROOT / "docs" / "schemas"
MATRIX = "2.0,0.5\n0.5,1.0\n"

LINES: dict[str, tuple[str, ...]] = {
    "verify": ("verify", "a.toml", "--margins"),
    "verify, failing": ("verify", "slow.toml", "--changes", "0.5"),
    "verify, oscillating": ("verify", "ringing.toml", "--changes", "0"),
    "verify, ngspice and noise": ("verify", "ngspice.toml"),
    "verify, exponential": ("verify", "exponential.toml", "--changes", "0"),
    "verify-files": ("verify", "a.toml", "bad.toml", "slow.toml", "--jobs", "1"),
    "diff": ("diff", "a.toml", "slow.toml"),
    "netlist": ("netlist", "a.toml", "--explain"),
    "bom": ("bom", "a.toml"),
    "kicad": ("kicad", "a.toml", "-o", "drawing"),
    "solve": ("solve", "exponential.toml"),
    "simulate": ("simulate", "ringing.toml"),
    "montecarlo": ("montecarlo", "a.toml", "-n", "20", "--jobs", "1"),
    "montecarlo-sample": ("montecarlo", "a.toml", "--sample", "3"),
    "corners": ("corners", "a.toml", "--corner", "capacitor=-1"),
    "tune": ("tune", "a.toml"),
    "scale": ("scale", "a.toml"),
    "choose": ("choose", "a.toml", "--opamps", "tl084", "--points", "2", "--jobs", "1"),
    "onset": ("onset", "a.toml", "--over", "C=1fF:1pF:5", "--no-confirm"),
    "sweep": ("sweep", "a.toml", "--over", "C=1fF,10pF", "--engine", "both", "--jobs", "1"),
    "regress": ("regress", ".", "--baseline", "b.json", "--jobs", "1"),
    "stress": ("stress", "--only", "one-channel", "--jobs", "1"),
    "accuracy": ("accuracy", "a.toml", "--budget", "0.5"),
    "models": ("models",),
    "models-show": ("models", "show", "ua741"),
    "new": ("new", "new.toml"),
    "doctor": ("doctor",),
    "error": ("verify", "bad.toml"),
    "error, an option": ("verify", "a.toml", "--jobs", "0"),
    "help": ("--help",),
}
ELSEWHERE = {"reproduce"}  # minutes; its test has a short run


@pytest.fixture
def folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    write_fast(tmp_path / "a.toml", more="[tolerances]\nresistor = 0.01\n")
    write_fast(tmp_path / "slow.toml", limit="1us", capacitance="20pF")
    write_fast(tmp_path / "ringing.toml", capacitance="5fF")
    other = write_fast(tmp_path / "other.toml").read_text()
    (tmp_path / "ngspice.toml").write_text(
        other.replace('"statespace"', '"ngspice"').replace("[checks]", '[checks]\nnoise = "1V"')
    )
    exponential = other.replace("[design]", '[design]\namplifier = "exponential"')
    (tmp_path / "exponential.toml").write_text(exponential)
    (tmp_path / "bad.toml").write_text("[problem]\nkind = 'tactil'\n")
    (tmp_path / "b.json").write_text('{"taction_baseline": 1, "scenes": {}}')
    monkeypatch.chdir(tmp_path)
    return tmp_path


def mistakes(found: Any, name: str) -> list[str]:
    validator = jsonschema.Draft202012Validator(schema(name))
    return [f"{error.json_path}: {error.message[:300]}" for error in validator.iter_errors(found)]


def test_every_schema_has_a_command_and_every_command_a_schema() -> None:
    names = {name.partition(",")[0] for name in LINES} | ELSEWHERE
    assert names == set(MODELS)
    assert {name.partition("-")[0] for name in names} == set(COMMANDS) | {"error", "help"}


def test_the_published_schemas_are_those_of_the_models() -> None:
    published = {path.name: path.read_text(encoding="utf-8") for path in FOLDER.glob("*.json")}
    assert published == dict(schemas()), "run: make schemas"


@pytest.mark.usefixtures("folder")
@pytest.mark.parametrize("name", LINES)
def test_a_real_document_fits_its_schema(name: str, ngspice: str) -> None:
    found = document(taction(*LINES[name], "--json"))
    kind = name.partition(",")[0]
    assert mistakes(found, kind) == []
    head = found["taction"]
    assert head["schema"] == schema_name(kind)
    assert (FOLDER / f"{head['schema']}.json").is_file()
    assert re.fullmatch(r"\d+\.\d+.*", head["version"])
    assert head["simulator"].startswith("ngspice-")
    if kind != "help":
        assert head["units"] == units_in({k: v for k, v in found.items() if k != "taction"})


def test_a_field_that_no_schema_has_is_found() -> None:
    found = document(taction("doctor", "--json"))
    assert mistakes(found | {"more": 1}, "doctor") != []
    del found["ok"]
    assert mistakes(found, "doctor") != []


def test_units_of_a_verdict(folder: Path) -> None:
    found = document(taction("verify", "a.toml", "--json"))
    units = found["taction"]["units"]
    assert units["settling_time"] == "s"
    assert units["equilibrium"] == "V"
    assert units["steady_state.equilibrium"] == "step"
    assert units["rightmost_pole"] == "1/s"
    assert set(units.values()) <= set(UNIT_OF.values()) | {"step", "W"}


def test_published_schemas_are_valid_and_name_units() -> None:
    for path in FOLDER.glob("*.json"):
        known = json.loads(path.read_text(encoding="utf-8"))
        jsonschema.Draft202012Validator.check_schema(known)
        assert known["$id"] == path.stem
    verdict = json.loads((FOLDER / "verify-1.json").read_text(encoding="utf-8"))
    assert verdict["properties"]["settling_time"]["unit"] == "s"
