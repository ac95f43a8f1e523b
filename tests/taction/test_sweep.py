"""`taction.sweep`: axes from Python, results as tables, grids and pictures."""

from __future__ import annotations

from pathlib import Path

import pytest

import taction
from taction.verification.studies.sweep.result import SweepResult
from tests.support.entries import write_fast


@pytest.fixture(scope="module")
def scene(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return write_fast(tmp_path_factory.mktemp("boards") / "a.toml")


@pytest.fixture(scope="module")
def result(scene: Path) -> SweepResult:
    over = {"C": ("10pF", "20pF", 2), "topology": ["integrator", "passive"]}
    return taction.sweep(scene, over=over, jobs=1)


def test_a_table_has_one_row_a_point(result: SweepResult) -> None:
    table = result.to_pandas()
    assert table["C"].tolist() == [1e-11, 1e-11, 2e-11, 2e-11]
    assert table["topology"].tolist() == ["integrator", "passive"] * 2
    assert table["settling_time"].tolist() == [r["settling_time"] for r in result.records()]


def test_a_grid_has_the_axes_as_coordinates(result: SweepResult) -> None:
    grid = result.to_xarray()
    assert dict(grid.sizes) == {"C": 2, "topology": 2}
    table = result.to_pandas().set_index(["C", "topology"])["settling_time"]
    chosen = grid["settling_time"].sel(C=2e-11, topology="passive")
    assert float(chosen) == table[(2e-11, "passive")]


def test_arrays_are_swept_in_other_processes() -> None:
    parts = {"capacitance": "1nF", "gain": "100kohm", "unit_conductance": "10uS", "opamp": "opa189"}
    made = taction.Scene.from_arrays([[1.0, 0.5], [0.5, 1.0]], [0.2, 0.1], lam=0.1, **parts)
    result = taction.sweep(made, over={"C": ["1nF", "2nF"]}, engine="statespace", jobs=2)
    assert result.to_pandas()["outcome"].tolist() == ["pass", "pass"]
