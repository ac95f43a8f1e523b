"""What a sweep leaves behind: JSON, tables, CSV, grids and pictures."""

from __future__ import annotations

import csv
import json
from contextlib import nullcontext
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from click.testing import Result

from taction.verification.studies.running import study
from taction.verification.studies.running.pool import HERE
from taction.verification.studies.sweep.result import sweep
from tests.support.making import write_matrix_scene
from tests.support.running import taction as command

DESIGN = """[design]
gain = "100kohm"
capacitance = "100pF"
stray_capacitance = 0
opamp = { base = "ideal", dc_gain = 1e12 }
"""
OVER = ("--over", "C=50p:200p:3", "--over", "gain=50k,100k")


@pytest.fixture
def folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """A scene, and a command line that computes in this process."""
    write_matrix_scene(tmp_path, [[1.0, 0.2], [0.2, 1.0]], [1.0, 0.5], DESIGN)
    monkeypatch.setattr(study, "local", lambda jobs: nullcontext(HERE))
    monkeypatch.chdir(tmp_path)
    return tmp_path


def taction(*words: str) -> Result:
    return command("sweep", "scene.toml", "--engine", "statespace", *words)


def test_json_has_one_record_a_point(folder: Path) -> None:
    done = taction(*OVER, "--json", "-o", "a.sqlite")
    assert done.exit_code == 0, done.output
    document = json.loads(done.stdout)
    assert [axis["key"] for axis in document["axes"]] == ["design.capacitance", "design.gain"]
    assert document["axes"][0]["values"][1] == pytest.approx(100e-12)
    assert document["outcomes"] == {"pass": 6}
    assert [point["values"]["gain"] for point in document["points"]] == [5e4, 1e5] * 3
    for point in document["points"]:
        # Ideal op-amps: the slowest pole is at -1 / (R C) or further left (eq 9).
        slowest = 1.0 / (point["resistance"] * point["values"]["C"])
        assert point["rightmost_pole"][0] < -slowest
        assert point["settling_time"] > 0.0
    again = json.loads(taction(*OVER, "--json", "-o", "a.sqlite").stdout)
    assert (again["ran"], again["points"]) == (0, document["points"])


def test_a_strict_sweep_ends_with_1_if_a_point_fails(folder: Path) -> None:
    failing = ("--over", "checks.steady_state.tolerance=1e-15,0.5", "-o", "a.sqlite")
    assert taction(*failing).exit_code == 0
    done = taction(*failing, "--strict")
    assert done.exit_code == 1, done.output
    assert "1 pass, 1 fail" in done.stdout
    assert taction("--over", "checks.steady_state.tolerance=0.4,0.5", "--strict").exit_code == 0


def test_no_verdict_at_any_point_ends_with_3(folder: Path) -> None:
    done = taction("--over", "R=100M,200M", "--fix", "topology=passive")
    assert done.exit_code == 3, done.output
    assert "the same command computes the points without a verdict" in done.stdout


def test_csv_has_every_number_exactly(folder: Path) -> None:
    done = taction(*OVER, "--export", "a.csv", "--json")
    rows = list(csv.DictReader((folder / "a.csv").read_text().splitlines()))
    points = json.loads(done.stdout)["points"]
    assert len(rows) == len(points) == 6
    for row, point in zip(rows, points, strict=True):
        assert float(row["C"]) == point["values"]["C"]
        assert float(row["settling_time"]) == point["settling_time"]
        assert row["margin"] == ""
        assert (row["outcome"], row["stable"]) == ("pass", "True")


def grid(folder: Path, *over: str) -> Any:
    pytest.importorskip("xarray")
    return sweep(folder / "scene.toml", over=over, engine="statespace").to_xarray()


def test_a_grid_has_named_axes_and_units(folder: Path) -> None:
    points = json.loads(taction(*OVER, "--json").stdout)["points"]
    data = grid(folder, *OVER[1::2])
    assert dict(data.sizes) == {"C": 3, "gain": 2}
    assert (data.C.attrs["units"], data.settling_time.attrs["units"]) == ("F", "s")
    assert data.gain.attrs["long_name"] == "design.gain"
    found = data.settling_time.sel(gain=1e5).values
    assert found.tolist() == [point["settling_time"] for point in points[1::2]]
    assert data.outcome.attrs["flag_meanings"].split()[0] == "pass"
    assert np.all(data.outcome.values == 0)
    data.to_netcdf(folder / "a.nc", engine="scipy")


def test_other_formats_hold_the_same_numbers(folder: Path) -> None:
    pandas, xarray = pytest.importorskip("pandas"), pytest.importorskip("xarray")
    taction(*OVER, "--export", "a.parquet")
    table = pandas.read_parquet(folder / "a.parquet")
    points = json.loads(taction(*OVER, "--export", "a.nc", "--json").stdout)["points"]
    assert table["settling_time"].tolist() == [point["settling_time"] for point in points]
    assert table["stable"].tolist() == [True] * 6
    with xarray.open_dataset(folder / "a.nc", engine="scipy") as data:
        assert data.settling_time.values.ravel().tolist() == table["settling_time"].tolist()


def test_zipped_axes_share_a_dimension(folder: Path) -> None:
    data = grid(folder, "C=50p,100p gain=100k,50k", "lambda=0.1,1")
    assert dict(data.sizes) == {"C": 2, "lambda": 2}
    assert data.gain.dims == ("C",)
    assert data.gain.values.tolist() == [1e5, 5e4]


def test_what_cannot_be_written_is_refused_before_any_work(folder: Path) -> None:
    for words, says in (
        (("--export", "a.xls"), ".csv, .parquet, .nc"),
        (("--export", "missing/a.csv"), "folder does not exist"),
        (("--plot", "a.gif"), ".png, .svg, .pdf"),
        (
            ("--plot", "a.png", "--over", "R=1M,2M", "--over", "stray_capacitance=1p,2p"),
            "a picture has at most three",
        ),
    ):
        done = taction(*OVER, *words)
        assert done.exit_code == 2, done.output
        assert says in done.stderr
    assert not (folder / "scene.sqlite").exists()
