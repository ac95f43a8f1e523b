"""Devices of arrays in the deck, in drawn boards, in the budget and in the check of the rest."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

import taction
from taction.netlist_gen.board.variation import DEVICE, draw, parameters, vary
from taction.netlist_gen.scene.checks import Tolerances
from taction.netlist_gen.scene.scene import Scene
from taction.system.array_types import Floats
from taction.system.errors import InputError

OPAMP = {"base": "opa189", "input_errors": "none", "level": "small-signal"}
ROWS = [[1.0, 0.5, -0.25], [0.5, 1.0, 0.3], [-0.25, 0.3, 1.0]]
NONE = {"resistor": 0.0, "stray": 0.0, "opamp_gbw": 0.0, "opamp_gain": 0.0, "capacitor": 0.0}


def scene(T: list[list[float]], eps: list[float], **keys: Any) -> Scene:
    common = {
        "topology": "inv",
        "unit_conductance": 20e-6,
        "stray_capacitance": 0.0,
        "opamp": OPAMP,
        "engine": "statespace",
    }
    return taction.Scene.from_arrays(T, eps, **(common | keys))


def siemens(asked: Scene) -> Floats:
    (matrix,) = taction.synthesise(asked).matrices
    return np.asarray(1.0 / matrix.ohms)


def test_entries_are_at_levels_within_the_window() -> None:
    """Eight levels from 0.5 to 35.5 uS are 5 uS apart: 20, 10, 5 and 6 uS go to the nearest."""
    keys = {"least_conductance": "0.5uS", "most_conductance": "35.5uS", "cell_levels": 8}
    found = 1e6 * siemens(scene(ROWS, [0.1, 0.2, 0.3], **keys))
    wanted = [[20.5, 10.5, 5.5], [10.5, 20.5, 5.5], [5.5, 5.5, 20.5]]
    np.testing.assert_allclose(found, wanted, rtol=1e-12)


def test_a_programming_error_spreads_one_output_by_its_own_share() -> None:
    """One equation: u = eps / T, so 2 % of the conductance is 2 % of u, and 95 % are in 1.96."""
    asked = scene([[1.0]], [0.5], programming_error="0.4uS")
    verdict = taction.verify(asked)
    parts = {part.name: part for part in verdict.budget}
    # The normal quantile of 97.5 %; the second channel of the sum is that of the other side.
    assert parts["programming"].value == pytest.approx(1.95996 * 0.02 * 0.5, rel=1e-3)
    (check,) = [each for each in verdict.checks if each.name == "steady_state"]
    assert check.value == pytest.approx(1.95996 * 0.02, rel=1e-2)


def test_drift_and_read_noise_are_parts_of_the_error() -> None:
    """u = eps / T: with g (t/t0)^-nu it grows by (t/t0)^nu, by 1 % of read noise, and by sd(nu)."""
    keys = {"drift_exponent": 0.02, "drift_spread": 0.004, "age": 1e4, "read_noise": 0.01}
    verdict = taction.verify(scene([[1.0]], [0.5], **keys))
    u = 0.5 * 1e4**0.02
    assert float(verdict.steady.values[0]) == pytest.approx(u, rel=1e-5)
    parts = {part.name: part.value for part in verdict.budget}
    assert parts["resistors"] == pytest.approx(u - 0.5, rel=1e-4)
    assert parts["read_noise"] == pytest.approx(1.95996 * 0.01 * u, rel=1e-3)
    assert parts["drift"] == pytest.approx(1.95996 * 0.004 * np.log(1e4) * u, rel=1e-3)


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
        for k in range(4000)
    ]
    assert np.mean(drawn) == pytest.approx(100.0, abs=4.0 * 3.8713 / np.sqrt(4000))
    assert np.std(drawn) == pytest.approx(3.8713, rel=4.0 / np.sqrt(2.0 * 4000))


def test_devices_leave_their_window_for_no_error() -> None:
    asked = scene([[1.0]], [0.5], unit_conductance=51e-6, cell="rram-milo")
    circuit, tolerances = taction.synthesise(asked), Tolerances(**NONE)
    far = vary(circuit, tolerances, np.array([5.0]))
    assert float(far.matrices[0].ohms[0, 0]) == pytest.approx(1.0 / 50e-6)


def test_a_part_may_still_have_a_tolerance_of_its_own() -> None:
    circuit = taction.synthesise(scene(ROWS, [1.0] * 3, programming_error="1uS"))
    found = parameters(circuit, Tolerances(**NONE, parts={"Rf_1_2": 0.03}))
    kinds = {p.name: (p.kind, p.tolerance) for p in found}
    assert kinds["Rf_1_2"] == (DEVICE, 0.03) or kinds["Rf_1_2"] == ("resistor", 0.03)
    assert kinds["Rf_2_2"][1] == pytest.approx(np.expm1(3.0 * 0.05))


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
