"""Written scenes read as the scenes that were written."""

from __future__ import annotations

import tomllib
from pathlib import Path

import pytest

from netlist_gen.scene.file import load_scene
from netlist_gen.scene.scene import parse_scene
from netlist_gen.scene.writing import scene_text
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
    assert (tmp_path / matrix).resolve() == ROOT / "scenes" / scene.problem.matrix  # type: ignore[union-attr]


def test_odd_characters_of_a_file_name() -> None:
    data = {"problem": {"kind": "matrix", "matrix": 'a "b"\\\t\x7fé.csv', "strain": "e.csv"}}
    scene = parse_scene(data, "scene.toml")
    assert parse_scene(tomllib.loads(scene_text(scene)), "scene.toml") == scene
