"""Every signal amplifier, with and without bias: three witnesses and a closed form."""

from __future__ import annotations

import functools

import numpy as np
import pytest

from taction.netlist_gen.scene.open_tables import AMPLIFIERS
from taction.verification.verdict.verify import Verdict, verify
from tests.support.making import make_scene

NONLINEAR = [name for name in AMPLIFIERS if name != "linear"]
INVERSE = {
    "exponential": np.log,
    "sinh": np.arcsinh,
    "softplus": lambda u: np.log(np.expm1(u)),
    "tanh": np.arctanh,
}
STRAIGHT = {
    "deadzone": lambda y: np.sign(y) * np.maximum(np.abs(y) - 1.0, 0.0),
    "rectifier": lambda y: np.maximum(y, 0.0),
    "saturation": lambda y: np.clip(y, -1.0, 1.0),
}
"""g itself where it has no inverse."""
BOARD = {
    "capacitance": "100pF",
    "resistance": "2Mohm",
    "gain": "1Mohm",
    "unit_conductance": "1uS",
    "exponential_slope": "300mV",
    "unit_voltage": "500mV",
    "stray_capacitance": "1pF",
    "opamp": {"base": "ideal", "dc_gain": 1e6, "gbw": "10MHz", "second_pole": "30MHz"},
}


def scene(amplifier: str, bias: bool):
    force = {"deadzone": 15.0, "rectifier": 15.0, "saturation": 6.0}.get(amplifier, 1.5)
    problem = {"kind": "tactile", "channels": 3, "span": 1.5, "load": {"force": force}}
    return make_scene(problem=problem, design=BOARD | {"amplifier": amplifier, "bias": bias})


@functools.cache
def verdict_of(amplifier: str, bias: bool) -> Verdict:
    return verify(scene(amplifier, bias))


@pytest.mark.parametrize("bias", [False, True])
@pytest.mark.parametrize("amplifier", NONLINEAR)
def test_ngspice_the_state_space_and_the_reference_agree(ngspice: str, amplifier: str, bias: bool):
    verdict = verdict_of(amplifier, bias)
    assert verdict.waveforms.engine.startswith("ngspice")
    assert {c.name: c.outcome.value for c in verdict.checks} == {
        "steady_state": "pass",
        "settling_time": "pass",
        "stability": "pass",
        "engines_agree": "pass",
    }


@pytest.mark.parametrize("bias", [False, True])
@pytest.mark.parametrize("amplifier", NONLINEAR)
def test_the_final_outputs_balance_every_signal_node(ngspice: str, amplifier: str, bias: bool):
    """At rest v/R + I_b + sum_k T_kn G0 w_k = 0 with v = Ve g^-1(u/U0): eq (9), by hand."""
    verdict = verdict_of(amplifier, bias)
    T, eps = verdict.problem.matrix, verdict.problem.strain
    G0, U0, R, s, Ve = map(verdict.circuit.value, ("G0", "U0", "R", "gain", "Ve"))
    u = np.array([channel.final for channel in verdict.measurements.channels])
    w = s * G0 * (T @ u - eps * U0)
    feedback = G0 * T.T @ w
    if amplifier in STRAIGHT:
        y = -R * feedback / Ve - bias
        assert u / U0 == pytest.approx(STRAIGHT[amplifier](y), abs=2e-3 * np.abs(y).max())
        return
    v = Ve * INVERSE[amplifier](u / U0)
    currents = v / R + bias * Ve / R
    assert currents + feedback == pytest.approx(0.0, abs=2e-3 * np.max(np.abs(feedback)))
