"""Devices of arrays, and antilog stages of transistors, against closed forms and both engines."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

import taction
from taction.netlist_gen.analysis import OperatingPoint, Transient
from taction.netlist_gen.board.synthesis import synthesise
from taction.netlist_gen.board.variation import DEVICE, draw, parameters, vary
from taction.netlist_gen.deck.deck import write_deck
from taction.netlist_gen.scene.check_keys import Tolerances
from taction.netlist_gen.scene.scene import Scene, load_scene, parse_scene
from taction.system.array_types import Floats
from taction.system.errors import InputError
from taction.verification.engines.ngspice.process import Simulation, find_simulator
from taction.verification.engines.statespace.equations import descriptor
from taction.verification.engines.statespace.linearised.linear_board import LinearBoard
from taction.verification.engines.statespace.transients.stepped import simulate
from taction.verification.verdict.verify import Verdict, verify
from tests.support import nightly
from tests.support.paths import SCENES

PATH = SCENES / "paper-exponential-devices.toml"
OPAMP = {"base": "opa189", "input_errors": "none", "level": "small-signal"}
ROWS = [[1.0, 0.5, -0.25], [0.5, 1.0, 0.3], [-0.25, 0.3, 1.0]]
NONE = {"resistor": 0.0, "stray": 0.0, "opamp_gbw": 0.0, "opamp_gain": 0.0, "capacitor": 0.0}


def changed(**design: Any) -> Scene:
    """The shipped scene with other keys of its design."""
    scene = load_scene(PATH)
    data = scene.model_dump(by_alias=True, exclude_unset=True)
    data["design"] |= design
    return parse_scene(data, PATH)


@pytest.fixture(scope="module")
def verified(ngspice: str) -> Verdict:
    return verify(load_scene(PATH))


@pytest.mark.parametrize("name", ["ssm2220", "ssm2212"])
@pytest.mark.parametrize("celsius", [27.0, 60.0])
def test_ngspice_finds_the_same_equilibrium(ngspice: str, name: str, celsius: float) -> None:
    antilog = {"stage": "device", "transistors": name, "temperature": celsius}
    board = LinearBoard(synthesise(changed(antilog=antilog)))
    nodes = [name for name in board.descriptor.names if "." not in name and name != "reference"]
    deck = write_deck(board.circuit, OperatingPoint(), relative=1e-9, saved=nodes)
    with Simulation(deck, find_simulator(), timeout=60.0) as run:
        found = run.result().values[-1]
    np.testing.assert_allclose(found, [board.equilibrium[node] for node in nodes], atol=3e-7)


def test_the_budget_has_the_stages_as_a_part(verified: Verdict) -> None:
    parts = {part.name: part for part in verified.budget}
    board = LinearBoard(synthesise(load_scene(PATH)))
    ideal = LinearBoard(synthesise(changed(antilog="ideal")))
    moved = [
        output.sign * (board.equilibrium[output.node] - ideal.equilibrium[output.node])
        for output in board.circuit.outputs
    ]
    assert parts["antilog"].value == pytest.approx(np.abs(moved).max(), rel=1e-12)
    v, u = board.rest["v_3"], -board.rest["a_3"]
    assert u / np.exp(v / 0.1) - 1.0 == pytest.approx(2.976e-3, rel=0.01)  # solved in 30 digits


@pytest.mark.parametrize("name", ["ssm2220", *nightly("ssm2212")])
def test_large_boards_have_the_same_transient(name: str, monkeypatch: pytest.MonkeyPatch) -> None:
    circuit = synthesise(changed(antilog={"stage": "device", "transistors": name}))
    analysis, times = Transient(5e-5, 1e-6, initial="rest"), np.linspace(0.0, 5e-5, 11)
    reduced = simulate(circuit, analysis, times=times)
    monkeypatch.setattr(descriptor, "LARGE", 10)
    whole = simulate(circuit, analysis, times=times)
    np.testing.assert_allclose(whole.values, reduced.values, atol=2e-8)


@pytest.mark.parametrize(
    ("design", "text"),
    [
        ({"exponential_slope": "25mV"}, "exponential_slope.*above the thermal voltage of 0.0258"),
        ({"antilog": {"stage": "device", "transistors": "lm395"}}, "'ssm2220', 'ssm2212'"),
        ({"amplifier": "sinh"}, "antilog.*'device' needs amplifier = 'exponential'"),
        ({"topology": "passive", "bias": False}, "topology.*expected 'integrator'"),
        ({"antilog": {"stage": "device", "temperature": 300}}, "antilog.temperature.*125"),
    ],
)
def test_a_stage_that_cannot_be_built_is_refused(design: dict[str, Any], text: str) -> None:
    with pytest.raises(InputError, match=text):
        synthesise(changed(**design))


def scene(T: list[list[float]], eps: list[float], **keys: Any) -> Scene:
    common = {"topology": "inv", "unit_conductance": 20e-6, "stray_capacitance": 0.0}
    common |= {"opamp": OPAMP, "engine": "statespace"}
    return taction.Scene.from_arrays(T, eps, **(common | keys))


def test_entries_are_at_levels_within_the_window() -> None:
    """Eight levels from 0.5 to 35.5 uS are 5 uS apart: 20, 10, 5 and 6 uS go to the nearest."""
    keys = {"least_conductance": "0.5uS", "most_conductance": "35.5uS", "cell_levels": 8}
    (matrix,) = taction.synthesise(scene(ROWS, [0.1, 0.2, 0.3], **keys)).matrices
    wanted = [[20.5, 10.5, 5.5], [10.5, 20.5, 5.5], [5.5, 5.5, 20.5]]
    np.testing.assert_allclose(1e6 / matrix.ohms, wanted, rtol=1e-12)


def test_a_programming_error_spreads_one_output_by_its_own_share() -> None:
    """One equation: u = eps / T, so 2 % of the conductance is 2 % of u, and 95 % are in 1.96."""
    asked = scene([[1.0]], [0.5], programming_error="0.4uS")
    (check,) = [each for each in taction.verify(asked).checks if each.name == "steady_state"]
    assert check.value == pytest.approx(1.95996 * 0.02, rel=1e-2)


def test_drift_and_read_noise_spread_the_rest() -> None:
    """u = eps / T: with g (t/t0)^-nu it grows by (t/t0)^nu, by 1 % of read noise, and by sd(nu)."""
    keys = {"drift_exponent": 0.02, "drift_spread": 0.004, "age": 1e4, "read_noise": 0.01}
    verdict = taction.verify(scene([[1.0]], [0.5], **keys))
    u = 0.5 * 1e4**0.02
    assert float(verdict.steady.values[0]) == pytest.approx(u, rel=1e-5)
    parts = {part.name: part.value for part in verdict.budget}
    assert parts["resistors"] == pytest.approx(u - 0.5, rel=1e-4)
    assert verdict.spread is not None
    sigma = u * np.hypot(0.01, 0.004 * np.log(1e4))
    np.testing.assert_allclose(verdict.spread.sigma, sigma, rtol=1e-3)


def test_stuck_cells_are_drawn_but_are_at_no_corner_and_in_no_check() -> None:
    keys = {"cell": "rram-wan", "programming_error": "0.1uS", "stuck_at_least": 0.3}
    asked = scene(ROWS, [0.1, 0.2, 0.3], **keys)
    circuit, tolerances = taction.synthesise(asked), Tolerances(**NONE)
    varied = parameters(circuit, tolerances)

    def least(z: Floats) -> int:
        return int(np.sum(np.isclose(vary(circuit, tolerances, z).matrices[0].ohms, 1e6)))

    drawn = [least(draw(tolerances, varied, 1, k)) for k in range(60)]
    assert sum(drawn) == pytest.approx(0.3 * 9 * 60, abs=4.0 * np.sqrt(0.21 * 9 * 60))
    assert least(np.ones(len(varied))) == 0
    only = scene(ROWS, [0.1, 0.2, 0.3], most_conductance="50uS", stuck_at_most=0.3)
    text = " ".join(taction.verify(only).warnings)
    assert "stuck cells: 2.7 of 9 on average, one or more in 96 % of the boards" in text


def test_drawn_devices_have_the_spread_of_their_source() -> None:
    """rram-milo at 100 uS: 4.782 - 0.9107 uS; every device by itself, whatever others do."""
    asked = scene([[1.0]], [0.5], cell="rram-milo", unit_conductance=100e-6)
    circuit, tolerances = taction.synthesise(asked), Tolerances(**NONE, distribution="uniform")
    varied = parameters(circuit, tolerances)
    assert [parameter.kind for parameter in varied] == [DEVICE]
    drawn = [
        1e6
        / float(vary(circuit, tolerances, draw(tolerances, varied, 7, k)).matrices[0].ohms[0, 0])
        for k in range(1000)
    ]
    assert np.mean(drawn) == pytest.approx(100.0, abs=4.0 * 3.8713 / np.sqrt(1000))
    assert np.std(drawn) == pytest.approx(3.8713, rel=4.0 / np.sqrt(2.0 * 1000))


@pytest.mark.parametrize(
    ("keys", "wrong"),
    [
        ({"cell": "rram"}, "devices.cell"),
        ({"least_conductance": "2uS", "most_conductance": "1uS"}, "devices.most_conductance"),
        ({"cell_levels": 4}, "devices.cell_levels"),
        ({"stuck_at_most": 0.1}, "devices.stuck_at_most"),
        ({"cell": "rram-wan", "stuck_at_most": 0.5, "stuck_at_least": 0.5}, "below 1"),
    ],
)
def test_what_is_no_device_is_refused(keys: dict[str, Any], wrong: str) -> None:
    with pytest.raises(InputError, match=wrong):
        taction.synthesise(scene(ROWS, [0.1, 0.2, 0.3], **keys))
