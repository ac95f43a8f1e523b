"""The published schema, the template, and values that are frozen."""

from __future__ import annotations

import json
import tomllib
from pathlib import Path
from typing import Any

import jsonschema
import pytest

from taction.netlist_gen.scene.loading import load_scene
from tests.support.making import make_scene
from tests.support.paths import ROOT, SCENES
from tests.support.running import taction as command

SCHEMA = json.loads((ROOT / "docs" / "scene.schema.json").read_text(encoding="utf-8"))


def mistakes(value: Any) -> list[str]:
    """Return the places at which `value` breaks the schema, with what breaks it."""
    validator = jsonschema.Draft202012Validator(SCHEMA)
    return [f"{each.json_path}: {each.validator}" for each in validator.iter_errors(value)]


def test_the_published_schema_is_current() -> None:
    result = command("new", "--schema")
    assert result.exit_code == 0
    now = json.loads(result.stdout)
    assert now == SCHEMA, "run: taction new --schema > docs/scene.schema.json"


@pytest.mark.parametrize("path", sorted(SCENES.glob("*.toml")), ids=lambda path: path.stem)
def test_the_schema_accepts_every_shipped_scene(path: Path) -> None:
    assert mistakes(tomllib.loads(path.read_text(encoding="utf-8"))) == []


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
