"""Tuning: faster within the limits, verified by ngspice, the solution held, and errors."""

from __future__ import annotations

import functools
import json
import tomllib
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import taction
from taction.netlist_gen.board.bill_of_materials import buyable
from taction.netlist_gen.board.synthesis import synthesise
from taction.netlist_gen.scene.axes import with_values
from taction.netlist_gen.scene.scene import Scene, load_scene
from taction.system.errors import EngineError, InputError
from taction.system.quantities import parse
from taction.verification.design import tune as tune_module
from taction.verification.design.scaling import Scaled
from taction.verification.design.tune import Tuned
from taction.verification.verdict.verify import verify
from tests.support import nightly
from tests.support.making import make_scene, write_matrix_scene
from tests.support.measured import named
from tests.support.paths import ROOT
from tests.support.running import taction as command

REAL = {"base": "ideal", "dc_gain": 1e5, "gbw": "1MHz", "second_pole": "3MHz"}
DESIGN = {"capacitance": "100pF", "gain": "100kohm", "stray_capacitance": "5pF", "opamp": REAL}
DESIGN |= {"unit_conductance": "10uS", "lambda": 0.1}


def scene(**tables: Any) -> Scene:
    return make_scene({"channels": 2, "span": 1.2}, design=DESIGN, **tables)


def tune(scene: Scene, over: str | Sequence[str] = "gain", **limits: Any) -> Tuned:
    return taction.tune(scene.with_engine("statespace"), over=over, **limits)


@functools.cache
def tuned() -> Tuned:
    return tune(scene(), overshoot=0.02, margin=1.3)


def test_the_board_becomes_faster_within_the_limits_and_lambda_is_held() -> None:
    found = tuned()
    assert found.after.settling_time < 0.5 * found.before.settling_time
    assert found.after.overshoot <= 0.02
    assert found.after.good
    assert found.after.values["design.gain"] > 1e5
    before, after = synthesise(scene()).value, synthesise(found.scene).value
    assert after("lambda") == pytest.approx(before("lambda"), rel=1e-12)
    assert after("R") * after("gain") == pytest.approx(before("R") * before("gain"))


def test_ngspice_verifies_what_was_found(ngspice: str) -> None:
    found = tuned()
    verdict = verify(found.scene.with_engine("ngspice"))
    assert verdict.waveforms.engine.startswith("ngspice")
    assert {check.outcome.value for check in verdict.checks} == {"pass"}
    assert named(verdict, "overshoot").expected == 0.02
    assert named(verdict, "stability").expected == 1.3
    settling = verdict.measurements.settling_time
    assert settling.value == pytest.approx(found.after.settling_time, rel=0.05)


def test_limits_are_those_of_the_scene_and_ranges_are_kept(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(tune_module, "GRID", {1: 5})
    asked = scene(checks={"overshoot": {"max": 0.07}, "stability": {"margin": 1.2}})
    found = tune(asked)
    assert (found.overshoot_limit, found.margin) == (0.07, 1.2)
    assert tune(scene()).overshoot_limit == tune_module.OVERSHOOT
    found = tune(scene(), ["gain=100k:120k"], overshoot=0.02)
    assert 1e5 <= found.after.values["design.gain"] <= 1.2e5
    assert found.at_edges == {"design.gain": 1.2e5}
    assert not tuned().at_edges
    # The gain would like to grow beyond the 40 Mohm that the scene has.
    design = DESIGN | {"gain": "40Mohm", "unit_conductance": "50nS", "capacitance": "100pF"}
    huge = make_scene({"channels": 2, "span": 1.2}, design=design | {"opamp": "ideal"})
    found = tune(huge, ["gain=10M:400M"], overshoot=0.9)
    assert found.after.values["design.gain"] <= 1.05 * 40e6


@pytest.mark.parametrize(
    ("keys", "text"),
    [
        (["gian"], "did you mean 'gain'"),
        ([], "one to 3 different keys"),
        (["gain", "C", "G0", "Ve"], "one to 3 different keys"),
        (["gain", "design.gain"], "one to 3 different keys"),
        (["channels"], "only the design can be tuned"),
        (["design.amplifier"], "a search needs a key with numbers"),
    ],
)
def test_keys_that_cannot_be_tuned(keys: list[str], text: str) -> None:
    with pytest.raises(InputError, match=text):
        tune(scene(), keys)


def test_nothing_feasible_says_what_came_closest(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(tune_module, "GRID", {1: 3})
    ringing = with_values(scene(), {"design.gain": 3e5, "design.capacitance": 1e-11})
    closest = r"closest is design.gain = .* with an overshoot of .* does not pass overshoot"
    with pytest.raises(EngineError, match=closest):
        tune(ringing, overshoot=1e-9, reach=1.1)
    with pytest.raises(EngineError, match=r"a margin of 90 in C; .* does not pass .*stability"):
        tune(ringing, margin=90.0, reach=1.1)


def test_every_check_of_the_scene_counts(monkeypatch: pytest.MonkeyPatch) -> None:
    """A least rise time, which the fastest design does not keep."""
    monkeypatch.setattr(tune_module, "GRID", {1: 7})
    free = tune(scene(), overshoot=0.02)
    fastest = verify(free.scene.with_engine("statespace")).measurements.rise_time
    asked = scene(checks={"rise_time": {"min": 2.0 * fastest.value}})
    slower = tune(asked, overshoot=0.02)
    rise = verify(slower.scene.with_engine("statespace")).measurements.rise_time
    assert rise.value >= 2.0 * fastest.value
    assert slower.after.settling_time > free.after.settling_time


def test_values_are_those_of_the_series(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(tune_module, "GRID", {1: 5, 2: 4})
    series = {"design.capacitor_series": "E6", "design.resistor_series": "E96"}
    loose = with_values(scene(), series | {"checks.steady_state.tolerance": 0.05})
    found = tune(loose, ["C", "gain"], overshoot=0.05)
    farads, ohms = found.after.values["design.capacitance"], found.after.values["design.gain"]
    assert f"{farads:.1e}"[:3] in {"1.0", "1.5", "2.2", "3.3", "4.7", "6.8"}
    steps = [round(10 ** (k / 96), 2) for k in range(96)]  # IEC 60063
    assert min(abs(float(f"{ohms:.3e}"[:5]) - step) for step in steps) < 1e-9


def shipped(name: str, opamp: str) -> Scene:
    scene = load_scene(ROOT / "scenes" / f"{name}.toml").with_engine("statespace")
    return with_values(scene, {"design.opamp": opamp, "design.opamp.input_errors": "none"})


def scaled(scene: Scene, share: float = 0.5, **options: Any) -> Scaled:
    return taction.scale(scene, share=share, **options)


@functools.cache
def scaled_shipped(name: str, opamp: str) -> Scaled:
    return scaled(shipped(name, opamp))


@pytest.mark.parametrize("name", ["tuned-breadboard", *nightly("eleven-channel", "custom-matrix")])
def test_lambda_stays_and_the_parts_can_be_bought(name: str) -> None:
    found = scaled_shipped(name, "tl084")
    before, after = synthesise(shipped(name, "tl084")), found.verdict.circuit
    assert after.value("lambda") == pytest.approx(before.value("lambda"), rel=1e-12)
    # eq (21) of the paper, corrected: lam = 1 / (R s G0²)
    G0, gain, R, lam = map(after.value, ("G0", "gain", "R", "lambda"))
    assert R * gain * G0**2 * lam == pytest.approx(1.0, rel=1e-12)
    assert 10.0 <= found.matrix_ohms[0] <= found.matrix_ohms[1] <= 10e6
    assert 10.0 <= gain <= 10e6
    assert buyable(gain, "E24") == gain
    assert pytest.approx(buyable(R, "E24"), rel=1e-12) == R
    assert max(load.share for load in found.verdict.parts.loads) <= 0.9


def test_ngspice_measures_the_loads_that_were_promised(ngspice: str) -> None:
    """The peak of the outputs by ngspice is that share of the swing, or below the slope's limit."""
    slow = with_values(shipped("custom-matrix", "tl084"), {"design.opamp.slew_rate": 1e9})
    found = scaled(slow, 0.4)
    assert found.verdict.parts.loads[0].quantity == "voltage"
    record = verify(found.scene.with_engine("ngspice"))
    assert record.parts.loads[0].share == pytest.approx(0.4, rel=0.06)  # U0 has two digits
    largest = float(np.abs(record.u).max())
    assert largest <= 0.4 * 13.5  # volts of 15 V less 1.5 V


def test_an_unstable_board_becomes_stable_and_a_larger_capacitance_is_named() -> None:
    scene = with_values(shipped("tuned-breadboard", "tl084"), {"design.capacitance": 1e-12})
    assert not verify(scene).poles.stable
    assert scaled(scene).outcome == "pass"
    scene = with_values(shipped("tuned-breadboard", "ideal"), {"design.opamp.gbw": 3e6})
    found = scaled(scene)
    assert found.verdict.circuit.value("C") > scene.design.capacitance
    assert any("C is another than the scene's" in note for note in found.notes)


def test_a_smaller_gain_lets_the_outputs_use_the_swing() -> None:
    """With the balanced s the slew rate keeps the outputs of this board at 16 % of the swing."""
    found = scaled_shipped("tuned-breadboard", "tl084")
    loads = found.verdict.parts.loads
    assert max(load.share for load in loads if load.quantity == "voltage") > 0.45
    assert not any("it sets U0" in note for note in found.notes)
    slow = scaled(shipped("tuned-breadboard", "ua741"))
    assert any("it sets U0" in note for note in slow.notes)


def test_a_matrix_that_no_resistors_have(tmp_path: Path) -> None:
    path = write_matrix_scene(tmp_path, [[1.0, 1e-7], [1e-7, 1.0]], [1.0, 0.5])
    with pytest.raises(InputError, match=r"small entries with design\.prune = 1e-06"):
        scaled(load_scene(path))
    other = load_scene(write_matrix_scene(tmp_path, [[1.0, 1e-3]], [1.0]))
    assert scaled(other).matrix_ohms[1] < 10e6


def test_the_command_writes_a_scene_that_passes(tmp_path: Path) -> None:
    file = tmp_path / "scaled.toml"
    arguments = ["scale", str(ROOT / "scenes" / "tuned-breadboard.toml"), "--opamp", "opa189"]
    found = command(*arguments, "--supply", "±12V", "-o", str(file), "--json")
    assert found.exit_code == 0, found.stderr
    document = json.loads(found.stdout)
    design = tomllib.loads(file.read_text("utf-8"))["design"]
    assert parse(design["unit_voltage"], "V") == document["unit_voltage"]
    assert design["supply"] == "12V"
    assert verify(load_scene(file).with_engine("statespace")).outcome.value == "pass"
    shown = command(*arguments)
    assert shown.stdout.splitlines()[-2:] == ["verified by the state-space engine", "PASS"]
