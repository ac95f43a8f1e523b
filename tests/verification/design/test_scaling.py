"""Scalings: lambda kept, limits of the parts by another engine, ranges of resistors, errors."""

from __future__ import annotations

import json
import tomllib
from pathlib import Path

import numpy as np
import pytest

from taction.netlist_gen.board.bill_of_materials import buyable, values_between
from taction.netlist_gen.board.part_warnings import ANY_PART
from taction.netlist_gen.board.synthesis import synthesise
from taction.netlist_gen.scene.axes import with_values
from taction.netlist_gen.scene.loading import load_scene
from taction.netlist_gen.scene.scene import Scene
from taction.system.errors import InputError
from taction.system.quantities import parse
from taction.verification.design.scaling import find_scaling
from taction.verification.verdict.verify import verify
from tests.support.making import write_matrix_scene
from tests.support.paths import ROOT
from tests.support.running import taction as command


def shipped(name: str, opamp: str) -> Scene:
    scene = load_scene(ROOT / "scenes" / f"{name}.toml").with_engine("statespace")
    return with_values(scene, {"design.opamp": opamp, "design.opamp.input_errors": "none"})


@pytest.mark.parametrize("name", ["tuned-breadboard", "eleven-channel", "custom-matrix"])
def test_lambda_stays_and_the_parts_can_be_bought(name: str) -> None:
    scene = shipped(name, "tl084")
    found = find_scaling(scene)
    before, after = synthesise(scene), synthesise(found.scene)
    assert after.value("lambda") == pytest.approx(before.value("lambda"), rel=1e-12)
    # eq (21) of the paper, corrected: lam = 1 / (R s G0²)
    G0, gain, R, lam = map(found.circuit.value, ("G0", "gain", "R", "lambda"))
    assert R * gain * G0**2 * lam == pytest.approx(1.0, rel=1e-12)
    assert 10.0 <= found.matrix_ohms[0] <= found.matrix_ohms[1] <= 10e6
    assert gain in values_between(10.0, 10e6, "E24")
    assert pytest.approx(buyable(R, "E24"), rel=1e-12) == R
    assert max(load.share for load in found.loads) <= 0.9


def test_ngspice_measures_the_loads_that_were_promised(ngspice: str) -> None:
    """The peak of the outputs by ngspice is that share of the swing, or below the slope's limit."""
    slow = with_values(shipped("custom-matrix", "tl084"), {"design.opamp.slew_rate": 1e9})
    found = find_scaling(slow, 0.4)
    assert found.loads[0].quantity == "voltage"
    record = verify(found.scene.with_engine("ngspice"))
    assert record.parts.loads[0].share == pytest.approx(0.4, rel=0.06)  # U0 has two digits
    largest = float(np.abs(record.u).max())
    assert largest <= 0.4 * 13.5  # volts of 15 V less 1.5 V


def test_an_unstable_board_becomes_stable() -> None:
    scene = with_values(shipped("tuned-breadboard", "tl084"), {"design.capacitance": 1e-12})
    assert not verify(scene).poles.stable
    assert verify(find_scaling(scene).scene).outcome.value == "pass"


def test_a_larger_capacitance_is_named() -> None:
    scene = with_values(shipped("tuned-breadboard", "ideal"), {"design.opamp.gbw": 3e6})
    found = find_scaling(scene)
    assert found.circuit.value("C") > scene.design.capacitance
    assert any("C is another than the scene's" in note for note in found.notes)


def test_a_smaller_gain_lets_the_outputs_use_the_swing() -> None:
    """With the balanced s the slew rate keeps the outputs of this board at 16 % of the swing."""
    found = find_scaling(shipped("tuned-breadboard", "tl084"))
    assert max(load.share for load in found.loads if load.quantity == "voltage") > 0.45
    assert not any("it sets U0" in note for note in found.notes)
    slow = find_scaling(shipped("tuned-breadboard", "ua741"))
    assert any("it sets U0" in note for note in slow.notes)


def test_a_matrix_that_no_resistors_have(tmp_path: Path) -> None:
    path = write_matrix_scene(tmp_path, [[1.0, 1e-7], [1e-7, 1.0]], [1.0, 0.5])
    with pytest.raises(InputError, match=r"small entries with design\.prune = 1e-06"):
        find_scaling(load_scene(path))
    assert find_scaling(load_scene(path), accepted=ANY_PART).matrix_ohms[1] > 10e6
    other = load_scene(write_matrix_scene(tmp_path, [[1.0, 1e-3]], [1.0]))
    assert find_scaling(other).matrix_ohms[1] < 10e6


def test_the_command_writes_a_scene_that_passes(tmp_path: Path) -> None:
    file = tmp_path / "scaled.toml"
    arguments = ["scale", str(ROOT / "scenes" / "eleven-channel.toml"), "--opamp", "opa189"]
    found = command(*arguments, "--supply", "±12V", "-o", str(file), "--json")
    assert found.exit_code == 0, found.stderr
    document = json.loads(found.stdout)
    design = tomllib.loads(file.read_text("utf-8"))["design"]
    assert parse(design["unit_voltage"], "V") == document["unit_voltage"]
    assert design["supply"] == "12V"
    assert verify(load_scene(file).with_engine("statespace")).outcome.value == "pass"
    shown = command(*arguments)
    assert shown.stdout.splitlines()[-2:] == ["verified by the state-space engine", "PASS"]
