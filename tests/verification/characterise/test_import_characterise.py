"""Characterisation in ngspice of netlists whose response has a closed form."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from taction.spice_models.imported import ImportedOpAmp
from taction.system.errors import InputError
from taction.verification.characterise.import_characterise import import_opamp

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
