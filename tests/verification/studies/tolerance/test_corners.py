"""Worst cases: against every corner, against random samples, and a user's own."""

from __future__ import annotations

import itertools
import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from click.testing import CliRunner, Result

from cli.main import main
from spice_models.errors import InputError
from tests.support.studying import QUIET, one_thread, scene_file, small_scene
from verification.studies.tolerance.corners import Corner, named_corner, worst_corners
from verification.studies.tolerance.varied_board import evaluate, prepare
from verification.studies.tolerance.yield_report import SampleCollection, run_samples

WORN = {"resistor": 0.05, "capacitor": 0.1, "distribution": "uniform"}
FEW = QUIET | {"capacitor": 0.1, "temperature": 30.0}
CHECKS = {"steady_state": {"tolerance": 0.05}, "settling_time": {"band": 0.3}}
QUANTITIES = ("settling_time", "overshoot", "undershoot", "steady_state", "growth_rate")


def worst(found: tuple[Corner, ...], quantity: str) -> float:
    corner = next(corner for corner in found if corner.quantity == quantity)
    value = getattr(corner.result, quantity)
    assert isinstance(value, float)
    return value


def taction(*arguments: str) -> Result:
    return CliRunner().invoke(main, ["corners", *arguments])


def test_no_corner_is_worse_than_the_worst() -> None:
    scene = small_scene(tolerances=FEW, checks=CHECKS)
    study = prepare(scene)
    assert [p.name for p in study.varied] == ["Cc_1", "Cc_2", "temperature"]
    with one_thread() as workers:
        found = worst_corners(scene, workers)
    every = [
        evaluate(study, 0, np.array(ends)) for ends in itertools.product((-1.0, 1.0), repeat=3)
    ]
    for quantity in QUANTITIES:
        most = max(getattr(sample, quantity) for sample in every)
        assert worst(found, quantity) == pytest.approx(most, rel=1e-9)


def test_the_worst_corner_is_worse_than_any_random_sample() -> None:
    scene = small_scene(tolerances=WORN, checks=CHECKS)
    study, tally = prepare(scene), SampleCollection(60)
    with one_thread() as workers:
        found = worst_corners(scene, workers)
        list(run_samples(study, range(60), 1, workers, tally))
    for quantity in QUANTITIES:
        values = [getattr(sample, quantity) for sample in tally.samples]
        assert worst(found, quantity) >= max(value for value in values if value is not None)
    # Most resistors count for the steady state: random samples stay away from the corner.
    steady = [sample.steady_state or 0.0 for sample in tally.samples]
    assert worst(found, "steady_state") > 1.25 * max(steady)


def test_the_nominal_board_comes_first_and_corners_say_what_moves_them() -> None:
    with one_thread() as workers:
        found = worst_corners(small_scene(tolerances=FEW, checks=CHECKS), workers)
    assert [corner.name for corner in found] == ["nominal", *(f"worst {q}" for q in QUANTITIES)]
    assert found[0].deviations == {}
    slowest = next(corner for corner in found if corner.quantity == "growth_rate")
    assert set(slowest.deviations.values()) <= {-1.0, 1.0}
    assert {"+Cc_1", "+Cc_2"} <= set(slowest.largest)


def test_a_margin_that_is_checked_has_its_corner() -> None:
    real = {"base": "ideal", "dc_gain": 1e5, "gbw": "1MHz", "second_pole": "3MHz"}
    design: dict[str, Any] = {
        "capacitance": "10pF",
        "gain": "300kohm",
        "stray_capacitance": "5pF",
        "opamp": real,
    }
    design |= {"unit_conductance": "10uS", "lambda": 0.1}
    tolerances = QUIET | {"stray": 0.5, "opamp_gbw": 0.3}
    checks = CHECKS | {"stability": {"margin": 1.5}}
    scene = small_scene(design=design, tolerances=tolerances, checks=checks)
    with one_thread() as workers:
        found = worst_corners(scene, workers)
    nominal, least = found[0].result.margin, worst(found, "margin")
    assert nominal is not None
    assert least < 0.9 * nominal
    tight = next(corner for corner in found if corner.quantity == "margin")
    assert all(v == 1.0 for name, v in tight.deviations.items() if name.startswith("Cstray_c"))


def test_a_corner_of_one_s_own_by_kind_and_by_name() -> None:
    study = prepare(small_scene(tolerances=WORN, checks=CHECKS))
    corner = named_corner(study, "mine", {"resistor": 1.0, "Rf_1_2": -0.5, "capacitor": -1.0})
    assert corner.deviations["Rf_1_2"] == -0.5
    assert corner.deviations["Rf_1_1"] == corner.deviations["Rb_1_2"] == 1.0
    assert corner.deviations["Cc_2"] == -1.0
    assert "v_1.dc_gain" not in corner.deviations
    z = np.array([corner.deviations.get(p.name, 0.0) for p in study.varied])
    assert corner.result == evaluate(study, 0, z)


def test_an_unknown_component_is_named() -> None:
    study = prepare(small_scene(tolerances=WORN))
    with pytest.raises(InputError, match="Rf_9_9: neither a component that varies nor one of"):
        named_corner(study, "mine", {"Rf_9_9": 1.0})


def test_the_command(tmp_path: Path) -> None:
    scene = scene_file(tmp_path)
    found = taction(scene, "--jobs", "1", "--engine", "statespace")
    assert found.exit_code == 1, found.stderr
    assert "worst steady" in found.stdout
    assert "fails steady_state" in found.stdout
    mine = ["--corner", "resistor=0", "--corner", "capacitor=1,Rf_1_1=-1"]
    own = taction(scene, *mine, "--engine", "statespace", "--json")
    document = json.loads(own.stdout)
    assert [corner["name"] for corner in document["corners"]] == mine[1::2]
    assert document["corners"][0]["result"]["outcome"] == "pass"
    assert document["corners"][1]["deviations"] == {"Rf_1_1": -1.0, "Cc_1": 1.0, "Cc_2": 1.0}


@pytest.mark.parametrize("text", ["capacitor", "capacitor=", "capacitor=x", "Cc_1=nan", "a=inf"])
def test_a_deviation_that_is_none(tmp_path: Path, text: str) -> None:
    found = taction(scene_file(tmp_path), "--corner", text)
    assert found.exit_code == 2
    assert f"KEY=Z = {text!r}: expected KEY=Z" in found.stderr
