"""Strains as voltages through resistors: the deck, the rest, and values that vary."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

import taction
from taction.netlist_gen.board.circuit import Circuit, Role
from taction.netlist_gen.board.synthesis import synthesise
from taction.netlist_gen.board.variation import parameters
from taction.netlist_gen.scene.scene import Scene
from taction.verification.engines.statespace.linearised.linear_board import LinearBoard
from tests.support.making import make_scene, matrix_problem

T, EPS = [[1.0, -0.5], [0.25, 2.0], [0.5, 0.5]], [0.3, 0.0, -0.2]
G0, GAIN, R, C, GI = 1e-5, 2e5, 1e6, 1e-10, 1e-4
GBW, A0 = 1e6, 1e5
DESIGN: dict[str, Any] = {
    "gain": GAIN,
    "unit_conductance": G0,
    "unit_voltage": 2.0,
    "resistance": R,
    "capacitance": C,
    "inverter_resistance": 1 / GI,
    "stray_capacitance": 0,
    "opamp": {
        **{"base": "ideal", "dc_gain": A0, "gbw": GBW, "voltage_noise": 2e-8},
        "output_resistance": 0,
    },
}


def scene(strain_input: str = "voltage", **changes: Any) -> Scene:
    return make_scene(design={**DESIGN, "strain_input": strain_input, **changes})


def board(strain_input: str, **changes: Any) -> Circuit:
    return synthesise(scene(strain_input, **changes), matrix_problem(T, EPS))


def outputs(circuit: Circuit) -> Any:
    rest = LinearBoard(circuit).equilibrium
    return np.array([output.sign * rest[output.node] for output in circuit.outputs])


def test_the_deck_has_a_voltage_and_a_resistor_for_each_strain() -> None:
    lines = taction.write_deck(
        board("voltage"), taction.netlist("scenes/custom-matrix.toml").analysis
    ).text.splitlines()
    assert [line for line in lines if line.startswith(("Re_", "Veps_", "Ieps_"))] == [
        "Re_1 e_1 c_1 99999.99999999999",
        "Re_2 0 c_2 99999.99999999999",
        "Re_3 e_3 c_3 99999.99999999999",
        "Veps_1 e_1 0 0.6",
        "Veps_3 e_3 0 -0.4",
    ]
    assert "* left out: 1 strain voltages; their strain is zero" in lines


def test_the_resistor_has_a_value_of_the_series_and_varies() -> None:
    circuit = board("voltage", resistor_series="E96", unit_conductance="8.2uS")
    assert {part.ohms for part in circuit.resistors_of(Role.STRAIN_RESISTOR)} == {121e3}
    varied = {parameter.name for parameter in parameters(circuit, scene().tolerances)}
    assert {"Re_1", "Re_2", "Re_3"} <= varied


def test_the_rest_is_that_of_the_currents() -> None:
    """Only the error of the finite gain differs: (1 + s sum G) / A0, of the order of 1e-4 here."""
    ideal = {**DESIGN["opamp"], "dc_gain": 1e9}
    pair = [outputs(board(kind, opamp=ideal)) for kind in ("current", "voltage")]
    assert pair[1] == pytest.approx(pair[0], rel=1e-7)
