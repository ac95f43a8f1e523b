"""Figures on test benches: of the presets, and of netlists whose response has a closed form."""

from __future__ import annotations

import doctest
import math
import tomllib
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from taction import spice_models
from taction.netlist_gen.analysis import Band
from taction.netlist_gen.scene.open_tables import OPAMPS
from taction.spice_models import presets
from taction.spice_models.imported import ImportedOpAmp
from taction.spice_models.opamp import OpAmp
from taction.system.errors import InputError
from taction.verification.characterise import characterise as module
from taction.verification.characterise.bench import Bench
from taction.verification.characterise.characterise import (
    UNITS,
    bode,
    characterise,
    import_opamp,
    step_response,
)
from taction.verification.characterise.witnesses import Equations, Simulation
from taction.verification.engines.ngspice.process import find_simulator

PRESETS = OPAMPS
PRINTED = tomllib.loads((Path(spice_models.__file__).parent / "presets.toml").read_text("utf-8"))
# What a soft limit or a loop gain leaves of a figure: the knees of slew rate and current are 1 % to
# 2 % wide, and a follower has a gain of 1 - 1/A0.
TOLERANCES = {
    "dc_gain": 1e-4,  # at 1 % of the first pole
    "unity_gain_bandwidth": 1e-7,
    "phase_margin": 1e-7,
    "slew_rate": 5e-3,  # the input resistance passes a part of the step to the output
    "swing": 1e-3,
    "output_current": 1e-2,
    "offset_voltage": 1e-4,
    "voltage_noise": 2e-5,
}


def printed(name: str) -> dict[str, float]:
    """The figures of the data file that the benches measure."""
    figures = {key: value for key, value in PRINTED[name].items() if key in UNITS}
    if "saturation" in PRINTED[name]:
        figures["swing"] = min(15.0, PRINTED[name]["most_supply"]) - PRINTED[name]["saturation"]
    return {key: value for key, value in figures.items() if math.isfinite(value)}


@pytest.mark.parametrize("name", PRESETS)
def test_a_preset_has_the_figures_of_its_data_sheet(ngspice: str, name: str) -> None:
    ours = {f.name: f.value for f in characterise(PRESETS[name], Equations())}
    theirs = {f.name: f.value for f in characterise(PRESETS[name], Simulation(find_simulator()))}
    wanted = printed(name)
    assert ours.keys() == theirs.keys() == wanted.keys()
    for figure, value in wanted.items():
        assert ours[figure] == pytest.approx(value, rel=TOLERANCES[figure]), figure
        assert theirs[figure] == pytest.approx(ours[figure], rel=2e-5), figure


def two_poles() -> OpAmp:
    return OpAmp("two", 1e5, gbw=1e6, second_pole=2e6)


def test_the_open_loop_is_that_of_two_poles(ngspice: str) -> None:
    opamp, band = two_poles(), Band(1.0, 14, 2)
    f = 10.0 ** (np.arange(15) / 2)
    expected = 1e5 / ((1 + 1j * f / 10.0) * (1 + 1j * f / 2e6))
    for witness in (Equations(), Simulation(find_simulator())):
        found = witness.response(Bench(opamp, follower=False), band)
        assert found == pytest.approx(expected, rel=1e-8)


def test_the_crossing_of_unity_gain_is_found_between_the_points() -> None:
    # |A| = 1 at f with f^2 (1 + (f/2 MHz)^2) = (1 MHz)^2, nearly: f = 1 MHz sqrt(2 (sqrt(2) - 1))
    frequency, margin = bode(two_poles(), Equations()).crossing()
    assert frequency == pytest.approx(1e6 * math.sqrt(2.0 * (math.sqrt(2.0) - 1.0)), rel=1e-6)
    assert margin == pytest.approx(90.0 - math.degrees(math.atan(frequency / 2e6)), abs=1e-3)


def test_a_follower_steps_as_the_loop_of_second_order() -> None:
    # 1 / (1 + s/w (1 + s/p)) with w = 2 pi 1 MHz, p = 2 w: damping sqrt(2)/2, overshoot exp(-pi)
    time, response = step_response(replace(two_poles(), dc_gain=1e9), Equations())
    assert response.max() - 1.0 == pytest.approx(math.exp(-math.pi), rel=1e-3)
    assert time[np.argmax(response)] == pytest.approx(0.5e-6, rel=1e-2)  # pi / (w_n sqrt(1/2))


def test_a_noise_density_is_that_of_a_follower(ngspice: str) -> None:
    noisy = replace(two_poles(), voltage_noise=10e-9)
    for witness in (Equations(), Simulation(find_simulator())):
        found = witness.noise(Bench(noisy), Band(990.0, 1, 115))
        assert found == pytest.approx(10e-9, rel=3e-5)


def test_the_examples_of_the_docstrings_hold() -> None:
    for each in (module, presets):
        result = doctest.testmod(each)
        assert (result.failed, result.attempted > 0) == (0, True)


PINS = ("inp", "inn", "vcc", "vee", "out")
TWO_POLES = """
.subckt amp plus minus pos neg out
rin plus minus 2meg
cin minus 0 3p
g1 0 a plus shifted 1m
vos shifted minus dc 1m
ra a 0 100meg
ca a 0 100p
g2 0 b a 0 1m
rb b 0 1k
cb b 0 50p
e3 c 0 b 0 1
ro c out 75
rs pos neg 10k
.ends
"""
# A0 = 1m 100M = 1e5, first pole 1 / (100M 100p), second 1 / (1k 50p).
A0, P1, P2 = 1e5, 100.0, 2e7


def imported(folder: Path, text: str, pins: tuple[str, ...] = PINS) -> ImportedOpAmp:
    file = folder / "amp.cir"
    file.write_text(text)
    return import_opamp(str(file), "amp", pins, 15.0)


def test_the_figures_are_those_of_the_circuit(ngspice: str, tmp_path: Path) -> None:
    opamp = imported(tmp_path, TWO_POLES)
    figures, linear = opamp.figures, opamp.linear
    assert figures.dc_gain == pytest.approx(A0, rel=1e-6)
    y = np.roots([(P1 / P2) ** 2, 1 + (P1 / P2) ** 2, 1 - A0**2]).max() ** 0.5  # w / P1 at |A| = 1
    assert figures.unity_gain_bandwidth == pytest.approx(y * P1 / (2 * np.pi), rel=1e-3)
    margin = 180.0 - np.degrees(np.arctan(y) + np.arctan(y * P1 / P2))
    assert figures.phase_margin == pytest.approx(margin, abs=0.05)
    assert figures.output_resistance == pytest.approx(75.0, rel=1e-6)
    assert figures.supply_current == pytest.approx(3e-3, rel=1e-3)
    assert linear is not None
    assert linear.error < 1e-6
    assert sorted(pole.real for pole in linear.gain.poles) == pytest.approx([-P2, -P1], rel=1e-5)
    assert linear.conductance == pytest.approx(1 / 2e6, rel=1e-3)
    assert linear.capacitance == pytest.approx(3e-12, rel=1e-3)
    assert -linear.offset == pytest.approx(-1e-3, rel=1e-3)  # the output settles at -1 mV


def test_a_response_without_a_stable_fit_has_a_reason(ngspice: str, tmp_path: Path) -> None:
    unstable = TWO_POLES.replace("rb b 0 1k", "rb b 0 -1k")  # a pole in the right half plane
    opamp = imported(tmp_path, unstable.replace("g2 0 b a 0 1m", "g2 b 0 a 0 1m"))
    assert opamp.linear is None
    assert "no stable linear model: its gain is" in opamp.missing


@pytest.mark.parametrize(
    ("pins", "text"),
    [
        (("inp", "inn", "vcc", "vee"), "one role for each of the 5 ports"),
        (("inp", "inn", "vcc", "vee", "vee"), "each once"),
        (("inn", "inp", "vcc", "vee", "out"), "the gain is negative: exchange"),
    ],
)
def test_wrong_pins_are_refused(
    pins: tuple[str, ...], text: str, ngspice: str, tmp_path: Path
) -> None:
    with pytest.raises(InputError, match=text):
        imported(tmp_path, TWO_POLES, pins)


def test_a_missing_file_and_a_hostile_one_are_named(tmp_path: Path) -> None:
    with pytest.raises(InputError, match=r"nowhere.cir.*No such file"):
        import_opamp(str(tmp_path / "nowhere.cir"), "amp", PINS, 15.0)
    with pytest.raises(InputError, match=r"amp.cir.*line 3 '.control'"):
        imported(tmp_path, "* x\n* y\n.control\nquit\n.endc\n")
