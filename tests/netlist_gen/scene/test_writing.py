"""Written scenes read as the scenes that were written."""

from __future__ import annotations

import tomllib
from pathlib import Path
from typing import Any

import pytest

from taction.netlist_gen.scene.keys import scene_text
from taction.netlist_gen.scene.loading import load_scene
from taction.netlist_gen.scene.scene import parse_scene
from tests.support.paths import ROOT

SCENES = sorted((ROOT / "scenes").glob("*.toml"))


@pytest.mark.parametrize("path", SCENES, ids=lambda path: path.stem)
def test_a_shipped_scene_comes_back(path: Path) -> None:
    scene = load_scene(path)
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
