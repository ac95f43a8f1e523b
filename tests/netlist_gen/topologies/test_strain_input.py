"""Strains as voltages through resistors: the deck, the rest, poles and noise of one channel.

The loop of one channel is computed here by hand. An op-amp with the gain A whose summing node has
the admittances Y to its inputs and Yf to its output has ``out = -(sum Y V + J) / D`` with
``D = Yf + (Yf + sum Y) / A`` and a current J into the node; a noise voltage e of the op-amp is the
current ``(Yf + sum Y) e``. So a channel of an inverter, a constraint stage with the gain s and an
integrator of R and C has the poles ``D_i D_w D_v + G_i G² = 0``.
"""

from __future__ import annotations

import math
from typing import Any

import numpy as np
import pytest
from numpy.polynomial import Polynomial

import taction
from taction.netlist_gen.board.circuit import Circuit, Role
from taction.netlist_gen.board.synthesis import synthesise
from taction.netlist_gen.board.variation import parameters
from taction.netlist_gen.scene.scene import Scene
from taction.verification.engines.statespace.linearised.board import LinearBoard
from taction.verification.engines.statespace.linearised.output_noise import output_noise
from tests.support.making import make_scene, matrix_problem

T, EPS = [[1.0, -0.5], [0.25, 2.0], [0.5, 0.5]], [0.3, 0.0, -0.2]
G0, GAIN, R, C, GI = 1e-5, 2e5, 1e6, 1e-10, 1e-4
GBW, A0, EN, KT4 = 1e6, 1e5, 2e-8, 4 * 1.380649e-23 * 300.15
DESIGN: dict[str, Any] = {
    "gain": GAIN,
    "unit_conductance": G0,
    "unit_voltage": 2.0,
    "resistance": R,
    "capacitance": C,
    "inverter_resistance": 1 / GI,
    "stray_capacitance": 0,
    "opamp": {
        **{"base": "ideal", "dc_gain": A0, "gbw": GBW, "voltage_noise": EN},
        "output_resistance": 0,
    },
}


def scene(strain_input: str = "voltage", **changes: Any) -> Scene:
    return make_scene(design={**DESIGN, "strain_input": strain_input, **changes})


def board(strain_input: str, **changes: Any) -> Circuit:
    return synthesise(scene(strain_input, **changes), matrix_problem(T, EPS))


def one(strain_input: str, **changes: Any) -> LinearBoard:
    problem = matrix_problem([[1.0]], [0.3])
    return LinearBoard(synthesise(scene(strain_input, **changes), problem))


def outputs(circuit: Circuit) -> Any:
    rest = LinearBoard(circuit).equilibrium
    return np.array([output.sign * rest[output.node] for output in circuit.outputs])


def stages(strain_input: str, gain: float = GAIN) -> tuple[Polynomial, ...]:
    """Return D of inverter, constraint stage and integrator over p, and all at their nodes."""
    p, extra = Polynomial([0.0, 1.0]), G0 if strain_input == "voltage" else 0.0
    over = 1 / A0 + p / (math.tau * GBW)
    sums = Polynomial([2 * GI]), Polynomial([1 / gain + G0 + extra]), 1 / R + p * C + G0
    own = Polynomial([GI]), Polynomial([1 / gain]), 1 / R + p * C
    return *(each + total * over for each, total in zip(own, sums, strict=True)), *sums


def poles(strain_input: str, gain: float = GAIN) -> Any:
    inverter, constraint, integrator, *_ = stages(strain_input, gain)
    return (inverter * constraint * integrator + GI * G0**2).roots()


def noise(strain_input: str) -> float:
    """Return the noise of the channel, rms: resistors and voltages of the op-amps."""
    stage = stages(strain_input)
    extra = G0 if strain_input == "voltage" else 0.0

    p = 1j * np.geomspace(1e-2, 1e14, 400_001)  # rad/s
    Di, Dw, Dv, Yi, Yw, Yv = (each(p) for each in stage)
    loop = Di * Dw * Dv + GI * G0**2
    heat = 2 * GI, 1 / GAIN + G0 + extra, 1 / R + G0
    every = zip(heat, (Yi, Yw, Yv), (G0**2, G0 * Di, Di * Dw), strict=True)
    density = sum((KT4 * S + np.abs(EN * Y) ** 2) * np.abs(way / loop) ** 2 for S, Y, way in every)
    return math.sqrt(float(np.trapezoid(density, p.imag)) / math.tau)


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


@pytest.mark.parametrize("kind", ["current", "voltage"])
def test_poles_and_noise_of_a_channel_are_those_of_the_closed_form(kind: str) -> None:
    found, expected = one(kind).state_space.modes.poles, poles(kind)
    assert np.sort_complex(found) == pytest.approx(np.sort_complex(expected), rel=1e-6)
    rms, _ = output_noise(one(kind))
    assert rms[0] == pytest.approx(noise(kind), rel=1e-6)
