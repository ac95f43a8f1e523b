"""Every signal amplifier, with and without bias: three witnesses and a closed form."""

from __future__ import annotations

import functools

import pytest

from taction.netlist_gen.scene.open_tables import AMPLIFIERS
from taction.verification.verdict.verify import Verdict, verify
from tests.support.making import make_scene

NONLINEAR = [name for name in AMPLIFIERS if name != "linear"]
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
