"""Figures on test benches: of the presets, and of netlists whose response has a closed form."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from taction.netlist_gen.board.circuit import Output
from taction.netlist_gen.board.opamp_choice import as_opamp
from taction.netlist_gen.board.parts import Capacitor, OpAmpCell, Resistor
from taction.netlist_gen.deck.flat_cards import circuit_of, read_cards
from taction.spice_models.imported import ImportedOpAmp
from taction.system.errors import InputError
from taction.verification.engines.statespace.linearised.linear_board import LinearBoard
from taction.verification.studies.decks.vendor_model import import_opamp

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


def imported(
    folder: Path, text: str, pins: tuple[str, ...] = PINS, farads: float = 0.0, name: str = "amp"
) -> ImportedOpAmp:
    file = folder / "amp.cir"
    file.write_text(text)
    return import_opamp(str(file), name, pins, 15.0, farads)


def board_of(opamp: ImportedOpAmp, inverting: str, *parts: Resistor | Capacitor) -> LinearBoard:
    """An imported op-amp with parts about it, and 1 V at the node ``in``."""
    circuit = circuit_of(read_cards(["v1 in 0 1"]), "bench", ["in"])
    more = replace(
        circuit,
        models={"m": as_opamp("m", opamp)},
        opamps=(OpAmpCell("one", "m", "p" if parts else "in", inverting, "out"),),
        resistors=tuple(part for part in parts if isinstance(part, Resistor)),
        capacitors=tuple(part for part in parts if isinstance(part, Capacitor)),
        outputs=(Output("out", 1.0),),
        supply=15.0,
    )
    return LinearBoard(more)


def poles_of(opamp: ImportedOpAmp, inverting: str, *parts: Resistor | Capacitor) -> list[complex]:
    """The poles of that board by the state-space engine, the rightmost first."""
    found = np.linalg.eigvals(board_of(opamp, inverting, *parts).state_space.A)
    return sorted(found.tolist(), key=lambda pole: -pole.real)


OAMP5 = (Path(__file__).parents[2] / "data/cases/oamp5.lib").read_text()


def test_a_resistance_between_the_inputs_stays_between_them(ngspice: str, tmp_path: Path) -> None:
    """A buffer behind 1 Mohm, a Wien bridge of 1 Mohm: poles from the cards, by mpmath."""
    opamp = imported(tmp_path, OAMP5, name="oamp")
    assert opamp.figures.differential_resistance == pytest.approx(2e6, rel=1e-6)
    buffer = Resistor("s", "in", "p", 1e6), Capacitor("s", "p", "0", 10e-12)
    load = Resistor("l", "out", "0", 10e3)
    board = board_of(opamp, "out", *buffer, load)
    assert board.equilibrium["out"] == pytest.approx(0.99998, abs=1e-5)
    assert poles_of(opamp, "out", *buffer, load)[0] == pytest.approx(-99.19e3, rel=1e-3)
    bridge = (
        Resistor("1", "out", "x", 1e6), Capacitor("1", "x", "p", 160e-9),
        Resistor("2", "p", "0", 1e6), Capacitor("2", "p", "0", 160e-9),
        Resistor("3", "m", "0", 10e3), Resistor("4", "out", "m", 20.3e3),
    )  # fmt: skip
    pair = poles_of(opamp, "m", *bridge)[0]
    assert pair.real == pytest.approx(0.0934, abs=2e-4)
    assert abs(pair.imag) / (2.0 * np.pi) == pytest.approx(0.9946, abs=1e-4)


CLAMPED = """
.subckt opbip inp inn vcc vee out
Rid inp inn 1MEG
G1 0 a inp inn 1m
R1 a 0 1e8
C1 a 0 159.155p
E1 b 0 a 0 1
Ro b out 75
D1 a vcc DX
D2 vee a DX
.model DX D(IS=1e-18)
.ends
"""


def test_one_pole_with_clamps_stays_one_pole(ngspice: str, tmp_path: Path) -> None:
    """A gain of two: -2.9909 M/s by mpmath from the cards, and no pole of a fit."""
    opamp = imported(tmp_path, CLAMPED, name="opbip")
    halves = Resistor("1", "m", "0", 100e3), Resistor("2", "out", "m", 100e3)
    found = poles_of(opamp, "m", *halves, Resistor("s", "in", "p", 1.0))
    assert len(found) == 1
    assert found[0] == pytest.approx(-2.9909e6, rel=1e-3)


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
    assert linear.error <= 1e-6
    assert figures.differential_resistance == pytest.approx(2e6, rel=1e-6)
    assert (figures.common_resistance, figures.differential_capacitance) == (None, None)
    assert figures.common_capacitance == pytest.approx(3e-12, rel=1e-6)
    assert figures.offset_voltage == pytest.approx(-1e-3, rel=1e-3)
    values = {part.letter + part.name.rpartition(".")[2]: part.value for part in linear.parts}
    assert values["Rro"] == 75.0
    assert values["Cca"] == 100e-12


def test_a_netlist_unstable_by_itself_has_no_linear_model(ngspice: str, tmp_path: Path) -> None:
    unstable = TWO_POLES.replace("rb b 0 1k", "rb b 0 -1k")  # a pole in the right half plane
    opamp = imported(tmp_path, unstable.replace("g2 0 b a 0 1m", "g2 b 0 a 0 1m"))
    assert opamp.linear is None
    assert "the netlist itself has a pole at +20 M/s" in opamp.missing


@pytest.mark.parametrize(
    ("pins", "text"),
    [
        (("inp", "inn", "vcc", "vee"), "one role for each of the 5 ports"),
        (("inp", "inn", "vcc", "vee", "vee"), "each once"),
        (("inn", "inp", "vcc", "vee", "out"), "the gain is negative: exchange"),
        (("inp", "inn", "vcc", "comp", "out"), "each once"),
    ],
)
def test_wrong_pins_are_refused(
    pins: tuple[str, ...], text: str, ngspice: str, tmp_path: Path
) -> None:
    with pytest.raises(InputError, match=text):
        imported(tmp_path, TWO_POLES, pins)


# Stages of transistors and of the expressions of PSpice; the gain from `half` to the output is 1.
# A current of 30 uA into 3 pF: 10 V/us. The ends are 12 V of the supplies less 0.1 V of the switch.
PSPICE = """* made up for this test
.subckt amp/x in+ in- vcc vee out
.model quiet res (tce=0 t_abs=-273.15)
.model clamp vswitch (ron=1 roff=1e15 von=100e-3 voff=0)
rin in+ in- quiet 1meg
ib 0 in- 40n
ios in+ 0 10n
vos in+ x dc 2m
gm 0 half value={limit(gm*v(x,in-), -islew, islew)}
rh half 0 quiet {a0/gm}
ch half 0 {cstage}
.param cstage={gm/(6.283185307*gbw)}
.param islew={slew*cstage} gm=1m
.param a0=200k gbw=3meg slew=10meg
vtop top 0 12
vend end 0 -12
s1 half top half top clamp
s2 end half end half clamp
e2 b 0 table {v(half)} = (-20,-20) (20,20)
r2 b c 1k
c2 c 0 15p
e3 d 0 value={if(v(c)>100, 100, v(c))}
ro d out quiet 100
iq vcc vee 1m
.ends
\x1a\x1a"""


def test_a_model_in_the_words_of_pspice_has_its_figures(ngspice: str, tmp_path: Path) -> None:
    opamp = imported(tmp_path, PSPICE, name="AMP/X")
    found = opamp.figures
    # One pole at gbw / a0, one of 1 kohm and 15 pF.
    assert found.dc_gain == pytest.approx(2e5, rel=1e-3)
    y = np.roots([(3e6 / 10.610e6) ** 2, 1.0, -1.0]).max() ** 0.5
    assert found.unity_gain_bandwidth == pytest.approx(3e6 * y, rel=1e-3)
    assert found.slew_rate == pytest.approx(10e6, rel=1e-2)
    assert found.swing == pytest.approx(12.05 * 10e3 / 10.1e3, rel=5e-3)
    # -40 nA flow into the inverting input, 10 nA into the other, and 2 mV over 1 Mohm between them.
    assert found.offset_voltage == pytest.approx(-2e-3, rel=1e-3)
    assert found.bias_current == pytest.approx(-15e-9, rel=1e-2)
    assert found.offset_current == pytest.approx(50e-9 + 2 * 2e-9, rel=1e-2)
    assert found.supply_current == pytest.approx(1e-3, rel=1e-2)
    assert opamp.linear is not None
    assert opamp.doubts == ()


@pytest.mark.parametrize("decades", [4, 8])
def test_a_large_gain_is_no_matter_of_rounding(decades: int, ngspice: str, tmp_path: Path) -> None:
    """A first pole of 0.03 Hz below a unity-gain bandwidth of 3 MHz."""
    text = PSPICE.replace("a0=200k", f"a0=1e{decades}").replace("slew=10meg", "slew=1000meg")
    found = imported(tmp_path, text, name="amp/x").figures
    assert found.dc_gain == pytest.approx(10.0**decades, rel=1e-2)
    assert found.unity_gain_bandwidth == pytest.approx(2.9e6, rel=0.02)
    assert found.phase_margin == pytest.approx(74.7, abs=0.5)
    assert found.slew_rate is None  # 38 V/us for 2 V: the slope follows the input
    assert found.swing == pytest.approx(12.05 * 10e3 / 10.1e3, rel=5e-3)


ONE_POLE = """
.subckt amp 1 2 3 4 5
r1 1 2 1meg
e1 6 cm 1 2 1e5
e9 cm 0 1 0 100
r2 6 7 1k
c1 7 0 16u
e2 5 0 7 0 1
.ends
"""


def test_one_pole_and_an_ideal_output_have_a_linear_model(ngspice: str, tmp_path: Path) -> None:
    opamp = imported(tmp_path, ONE_POLE)
    figures = opamp.figures
    assert figures.dc_gain == pytest.approx(1e5, rel=1e-6)
    assert figures.unity_gain_bandwidth == pytest.approx(1e5 / (2e3 * np.pi * 16e-6), rel=1e-6)
    assert figures.common_mode_rejection == pytest.approx(20.0 * np.log10(1e5 / 100.0), rel=1e-6)
    assert (figures.slew_rate, figures.swing) == (None, None)
    assert opamp.linear.error <= 1e-6
    assert figures.output_resistance == 0.0
    # A follower by the state-space engine: its pole is that of 1 kohm and 16 uF, (1 + 1e5) times.
    (pole,) = poles_of(opamp, inverting="out")
    assert pole == pytest.approx(-62.5 * (1.0 + 1e5), rel=1e-9)


CURRENT_FEEDBACK = """
.subckt amp 1 2 3 4 5
r1 1 0 10meg
e1 x 0 1 0 1
vs x y 0
rb y 2 50
f1 0 z vs 1
rz z 0 1meg
cz z 0 1p
e2 w 0 z 0 1
ro w 5 10
rs 3 4 10k
.ends
"""


@pytest.mark.parametrize(
    ("text", "reason"),
    [
        (CURRENT_FEEDBACK, r"current-feedback amplifier: its inverting input has 5\d ohm"),
        (ONE_POLE.replace("c1 7 0 16u", "c1 7 0 1f"), "never crosses 1.*compensation capacitor"),
        (ONE_POLE.replace("e2 5 0 7 0 1", "e2 5 9 7 0 1\nv9 9 0 3e5"), "rests at 3 V"),
    ],
)
def test_what_is_no_opamp_is_refused_with_the_reason(
    text: str, reason: str, ngspice: str, tmp_path: Path
) -> None:
    with pytest.raises(InputError, match=reason):
        imported(tmp_path, text)


def test_a_compensation_capacitor_stands_between_two_ports(ngspice: str, tmp_path: Path) -> None:
    text = TWO_POLES.replace("pos neg out", "pos neg out a one").replace(
        "ca a 0 100p", "v1 one 0 0"
    )
    pins = (*PINS, "comp", "comp")
    opamp = imported(tmp_path, text, pins, 100e-12)
    assert opamp.figures.unity_gain_bandwidth == pytest.approx(1.51e6, rel=0.05)
    assert "Ccomp comp5 comp6 1e-10" in opamp.text("m")
    with pytest.raises(InputError, match="two ports 'comp' belong together"):
        imported(tmp_path, text, pins)
    with pytest.raises(InputError, match="two ports 'comp' belong together"):
        imported(tmp_path, TWO_POLES, PINS, 1e-12)
