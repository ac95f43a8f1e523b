"""The published schema, the template, tables of other packages, and scenes that are written."""

from __future__ import annotations

import json
import pickle
import tomllib
from collections.abc import Callable
from pathlib import Path
from typing import Any

import jsonschema
import pytest

from taction.netlist_gen.scene.axes import parse_axes, with_settings
from taction.netlist_gen.scene.keys import scene_text
from taction.netlist_gen.scene.scene import Scene, load_scene, parse_scene, scene_schema
from taction.system.errors import InputError
from taction.verification.studies.running.versions import digest
from tests.support.making import make_scene
from tests.support.paths import ROOT, SCENES
from tests.support.running import taction as command

SCHEMA = json.loads((ROOT / "docs" / "scene.schema.json").read_text(encoding="utf-8"))


def mistakes(value: Any) -> list[str]:
    """Return the places at which `value` breaks the schema, with what breaks it."""
    validator = jsonschema.Draft202012Validator(SCHEMA)
    return [f"{each.json_path}: {each.validator}" for each in validator.iter_errors(value)]


def test_the_published_schema_is_current() -> None:
    now = json.loads(json.dumps(scene_schema()))
    assert now == SCHEMA, "run: make schemas"


@pytest.mark.parametrize(
    ("scene", "where"),
    [
        ({}, "$: required"),
        ({"problem": {"kind": "tactil"}}, "$.problem: oneOf"),
        ({"problem": {"kind": "matrix"}}, "$.problem: oneOf"),
        ({"problem": {"kind": "tactile", "channels": 0}}, "$.problem: oneOf"),
        ({"problem": {"kind": "tactile"}, "design": {"lam": 1}}, "$.design: additionalProperties"),
        ({"problem": {"kind": "tactile"}, "design": {"opamp": "x"}}, "$.design.opamp: anyOf"),
        ({"problem": {"kind": "tactile"}, "name": "a b"}, "$.name: pattern"),
        ({"problem": {"kind": "tactile"}, "design": {"prune": -0.1}}, "$.design.prune: minimum"),
        (
            {"problem": {"kind": "tactile"}, "design": {"supply_tolerance": 1.0}},
            "$.design.supply_tolerance: exclusiveMaximum",
        ),
    ],
)
def test_the_schema_refuses(scene: dict[str, Any], where: str) -> None:
    assert where in " ".join(mistakes(scene))


def test_the_template_is_the_defaults(tmp_path: Path) -> None:
    path = tmp_path / "my board.toml"
    result = command("new", str(path))
    assert result.exit_code == 0
    scene = load_scene(path)
    assert scene.name == "my-board"
    default = make_scene(design={"opamp": {"input_errors": "typical"}})
    assert scene.problem == default.problem
    assert scene.analysis == default.analysis
    limits = scene.checks.steady_state, scene.checks.settling_time
    assert [limits[0].tolerance, limits[1].band] == [0.02, 0.04]  # what these parts can keep
    kept = {"steady_state": default.checks.steady_state}
    kept["settling_time"] = default.checks.settling_time
    assert scene.checks.model_copy(update=kept) == default.checks
    assert scene.tolerances == default.tolerances
    parts = {"capacitance", "resistance", "gain", "unit_conductance", "unit_voltage"}
    parts |= {"opamp", "resistor_series", "strain_input"}
    left = (design.model_dump(exclude=parts) for design in (scene.design, default.design))
    assert next(left) == next(left)
    assert scene.design.opamp.input_errors == "typical"
    assert scene.design.strain_input == "voltage"


Plugin = Callable[..., Path]
GROUPS = {
    "taction.checks": {"droop": "DROOP", "quiet": "QUIET"},
    "taction.topologies": {"ladder": "LADDER", "mesh": "MESH"},
    "taction.engines": {"spectre": "SPECTRE"},
}
SOURCE = """
from types import SimpleNamespace
from pydantic import Field
from taction.netlist_gen.scene.check_keys import UpperLimit
from taction.netlist_gen.scene.fields import Count, Model, NonNegative, Ohms, Seconds

class DroopCheck(UpperLimit):
    max: NonNegative = Field(description="fraction of the step amplitude")
    after: Seconds = 1e-3

class LadderKeys(Model):
    sections: Count = 3
    rung: Ohms = 1e3

DROOP, QUIET = SimpleNamespace(keys=DroopCheck), SimpleNamespace(keys=None)
LADDER, MESH = SimpleNamespace(keys=LadderKeys), SimpleNamespace()
SPECTRE = object()
"""


def data(**tables: object) -> dict[str, object]:
    return {"problem": {"kind": "tactile"}, **tables}


def test_a_scene_has_the_tables_and_names_of_plugins(plugin: Plugin) -> None:
    before = parse_scene(data(), "scene.toml")
    plugin("acme", GROUPS, SOURCE)
    scene = parse_scene(
        data(
            checks={"droop": {"max": 0.1, "after": "2ms"}},
            design={"topology": "ladder", "ladder": {"rung": "2.2k"}},
            analysis={"engine": "spectre"},
        ),
        "scene.toml",
    )
    assert isinstance(scene, Scene)
    assert (scene.checks.droop.max, scene.checks.droop.after) == (0.1, 2e-3)  # type: ignore[attr-defined]
    assert scene.design.ladder.model_dump() == {"sections": 3, "rung": 2200.0}  # type: ignore[attr-defined]
    assert scene.design.topology == "ladder"
    assert scene.with_engine("spectre") == scene
    plain = parse_scene(data(checks={"droop": 0.2}), "scene.toml")
    assert plain.checks.droop.max == 0.2  # type: ignore[attr-defined]
    assert parse_scene(data(), "scene.toml").checks.droop is None  # type: ignore[attr-defined]
    assert not hasattr(before.checks, "droop")


def test_a_scene_with_plugins_can_be_sent_stored_written_and_varied(plugin: Plugin) -> None:
    plugin("acme", GROUPS, SOURCE)
    tables = {"checks": {"droop": 0.1}, "design": {"topology": "ladder", "ladder": {"rung": 50}}}
    scene = parse_scene(data(**tables), "scene.toml")
    again = pickle.loads(pickle.dumps(scene))  # noqa: S301 - our own
    assert again == scene
    assert type(again) is type(scene)
    assert digest(again) == digest(scene)
    assert digest(parse_scene(data(**{**tables, "checks": {"droop": 0.2}}), "s")) != digest(scene)
    text = scene_text(scene)
    assert "droop = { max = 0.1 }" in text
    assert "ladder = { rung = 50.0 }" in text or 'ladder = { rung = "50ohm" }' in text
    ((axis,),) = parse_axes(scene, ["design.ladder.rung=10:1k:3"])
    assert axis.key.unit == "ohm"
    moved = with_settings(scene, ["checks.droop.after=5ms", "design.ladder.sections=7"])
    assert moved.checks.droop.after == 5e-3  # type: ignore[attr-defined]
    assert moved.design.ladder.sections == 7  # type: ignore[attr-defined]


def test_keys_that_are_no_model_are_refused(plugin: Plugin) -> None:
    plugin("acme", {"taction.checks": {"droop": "DROOP"}}, "class DROOP:\n    keys = dict\n")
    with pytest.raises(InputError) as refused:
        parse_scene(data(), "scene.toml")
    assert str(refused.value) == (
        "plug-in acme 1.0: taction.checks = 'droop': acme:DROOP.keys is dict; expected Model"
    )


@pytest.mark.parametrize("path", sorted(SCENES.glob("*.toml")), ids=lambda path: path.stem)
def test_a_shipped_scene_loads_comes_back_and_has_the_schema(path: Path) -> None:
    assert mistakes(tomllib.loads(path.read_text(encoding="utf-8"))) == []
    scene = load_scene(path)
    assert (scene.name, scene.file, scene.folder) == (path.stem, path, SCENES)
    assert parse_scene(tomllib.loads(scene_text(scene)), path) == scene


def test_files_of_another_folder(tmp_path: Path) -> None:
    scene = load_scene(ROOT / "scenes" / "custom-matrix.toml")
    written = tmp_path / "moved.toml"
    written.write_text(scene_text(scene, tmp_path), encoding="utf-8")
    matrix = load_scene(written).problem.matrix  # type: ignore[union-attr]
    assert (tmp_path / matrix).resolve() == ROOT / "taction" / "scenes" / scene.problem.matrix  # type: ignore[union-attr]


@pytest.mark.parametrize(
    ("key", "value", "text"),
    [
        ("gain", 2400.0, '"2.4kohm"'),
        ("capacitance", 1e-11, '"10pF"'),
        ("unit_conductance", 3.3e-7, '"330nS"'),
        ("gain", 2400.0000000001, "2400.0000000001"),  # no short text reads as this number
        ("supply", 15.0, '"15V"'),
        ("opamp", {"gbw": 4e6, "slew_rate": 13e6}, '{ gbw = "4MHz", slew_rate = "13V/us" }'),
    ],
)
def test_quantities_stand_as_an_engineer_writes_them(key: str, value: Any, text: str) -> None:
    data = {"problem": {"kind": "tactile"}, "design": {key: value}}
    scene = parse_scene(data, "scene.toml")
    assert f"\n{key} = {text}\n" in scene_text(scene)
    assert parse_scene(tomllib.loads(scene_text(scene)), "scene.toml") == scene


def test_the_name_of_a_part_with_a_dot_is_quoted() -> None:
    data = {"tolerances": {"parts": {"v_1.gbw": 0.1, "Rf_1_1": 0.002, 'a"b': 0.5}}}
    scene = parse_scene({"problem": {"kind": "tactile"}, **data}, "scene.toml")
    assert tomllib.loads(scene_text(scene))["tolerances"] == data["tolerances"]
