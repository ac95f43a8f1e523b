"""Linearised decks against ngspice's own small-signal analysis, and against closed forms."""

from __future__ import annotations

import math
from pathlib import Path

import numpy as np
import pytest

import taction
from taction.netlist_gen.analysis import NoiseBand, SmallSignal
from taction.netlist_gen.deck.deck import Deck
from taction.netlist_gen.deck.foreign_deck import read_deck
from taction.system.errors import InputError
from taction.verification.engines.ngspice.executable import find_simulator
from taction.verification.engines.ngspice.listing import expand
from taction.verification.engines.ngspice.process import start
from taction.verification.engines.statespace.linearised.board import LinearBoard
from taction.verification.studies.foreign_board import read_board

pytestmark = pytest.mark.usefixtures("ngspice")
BAND = NoiseBand(1e2, 7, 1)
VT = 1.3806488e-23 * 300.15 / 1.602176565e-19  # as ngspice has it at 27 degrees C
BIPOLAR = """differential pair with a mirror
.model qn npn(is=1e-14 bf=200 vaf=100 cje=1p cjc=1p tf=300p rb=100)
.model qp pnp(is=1e-14 bf=100 vaf=50 cje=1p cjc=1p tf=500p)
Vcc vcc 0 5
Vee vee 0 -5
Vin in 0 DC 0 AC 1
Q1 c1 in e qn
Q2 out 0 e qn
Q3 c1 c1 vcc qp
Q4 out c1 vcc qp
It e vee 1m
CL out 0 10p
RL out 0 100k
.end
"""
FIELD = """common source and follower
.model nm nmos(level=1 vto=1 kp=200u lambda=0.02 cgso=1n cgdo=1n cbd=10f cbs=10f)
.model jf njf(vto=-2 beta=1m lambda=0.01 cgs=3p cgd=2p)
.model ds d(is=1e-12 rs=5 cjo=3p)
Vdd vdd 0 5
Vin in 0 DC 2 AC 1
Rs in g 1k
M1 d g 0 0 nm w=20u l=1u
Rd vdd d 2k
J1 vdd d s jf
D1 s out ds
Rl out 0 1k
.end
"""


def written(folder: Path, text: str) -> Path:
    place = folder / "deck.cir"
    place.write_text(text)
    return place


@pytest.mark.parametrize(("text", "error"), [(BIPOLAR, 1e-3), (FIELD, 1e-6)])
def test_the_response_is_that_of_ngspice_to_the_whole_deck(
    text: str, error: float, tmp_path: Path
) -> None:
    """Symmetric capacitances are exact; those of a bipolar transistor are nearly so."""
    place, simulator = written(tmp_path, text), find_simulator()
    (cards,) = expand(read_deck(place).lines, simulator)
    options = f".options {simulator.solver_option} reltol=1e-9 abstol=1e-15 vntol=1e-12"
    command = f".ac dec {BAND.density} {BAND.start!r} {BAND.stop!r}"
    lines = ["* whole deck", *cards, options, ".save v(out)", command, ".end", ""]
    with start(Deck("\n".join(lines), ("out",), SmallSignal(BAND)), simulator, timeout=20.0) as run:
        frequencies, response = run.response()
    board = LinearBoard(read_board(place, ["out"], linearise=True).circuit)
    dense, step = board.descriptor.dense, board.descriptor.switched
    s = 2j * np.pi * frequencies
    found = [np.linalg.solve(each * dense.mass - dense.stiffness, step) for each in s]
    there = np.array([z[board.descriptor.place("out")] for z in found])
    assert np.abs(there - response[:, 0]).max() < error * np.abs(response).max()
    assert np.abs(there / response[:, 0] - 1.0)[:4].max() < error


def test_a_diode_is_its_conductance(tmp_path: Path) -> None:
    """1 mA through D1: g = (I + Is) / Vt, and the rest is Vt ln(1 + I / Is)."""
    text = "diode\n.model dd d(is=1e-14)\nI1 0 out 1m\nIs 0 out DC 0 AC 1\nD1 out 0 dd\n"
    place = written(tmp_path, text + "C1 out 0 1u\n.end\n")
    found = taction.check(place, outputs="out", linearise=True, ngspice=False)
    assert found.poles.rightmost.real == pytest.approx(-(1e-3 + 1e-14) / VT / 1e-6, rel=1e-6)
    (row,) = found.outputs
    assert row.before == pytest.approx(VT * math.log1p(1e-3 / 1e-14), rel=1e-6)
    assert "linearised at ngspice's operating point" in found.notes[0]


def test_both_engines_agree_on_the_linearised_circuit(tmp_path: Path) -> None:
    found = taction.check(written(tmp_path, BIPOLAR), outputs="out", linearise=True)
    assert [check.name for check in found.checks] == ["stability", "engines_agree"]
    assert found.outcome.value == "pass"


@pytest.mark.parametrize(
    ("card", "words"),
    [
        ("B1 out 0 V=v(in)^2", ("B1", "not linear")),
        ("Q9 out in 0 nomodel", ("q9 out in 0 nomodel", "modelname")),
        ("S1 out 0 in 0 sw\n.model sw sw(vt=1)", ("S1",)),
        ("D1 in 0 dx\nV2 in 0 5\n.model dx d", ("deck.cir",)),
    ],
)
def test_other_devices_are_refused_by_name(
    card: str, words: tuple[str, ...], tmp_path: Path
) -> None:
    text = f"title\nV1 in 0 DC 1 AC 1\nR1 in out 1k\n{card}\nC1 out 0 1n\n.end\n"
    with pytest.raises(InputError) as error:
        taction.check(written(tmp_path, text), outputs="out", linearise=True, ngspice=False)
    for word in words:
        assert word in str(error.value)


def test_without_the_option_a_transistor_is_refused_with_it(tmp_path: Path) -> None:
    with pytest.raises(InputError, match="--linearise"):
        taction.check(written(tmp_path, BIPOLAR), ngspice=False)


COMMON_EMITTER = """common emitter
VCC vcc 0 12
Vin in 0 AC 1
C1 in b 10u
R1 vcc b 100k
R2 b 0 22k
RC vcc c 2.2k
RE e 0 1k
CE e 0 100u
C2 c out 10u
RL out 0 10k
Q1 c b e q
.model q NPN(Is=6.734f Bf=255.9 Vaf=74.03 Cje=4.493p Tf=301.2p)
.end
"""


def test_a_charge_of_one_side_adds_no_pole(tmp_path: Path) -> None:
    """Without a collector capacitance C1, CE and the base form a loop: three poles.

    The base charge follows the collector through the Early voltage, and nothing follows it back:
    half of that as a capacitor was a fourth pole, which rounding decided.
    """
    place = tmp_path / "amplifier.cir"
    place.write_text(COMMON_EMITTER)
    found = taction.check(place, linearise=True)
    assert len(found.poles.poles) == 3
    assert found.poles.known_stable
    assert found.agreement is not None
    assert found.agreement < 1e-3


@pytest.mark.parametrize("base", [100e3, 100.003e3, 100.007e3])
def test_a_stiff_amplifier_is_compared_with_ngspice(tmp_path: Path, base: float) -> None:
    """Poles from 10 /s to 1e10 /s: with 50 steps a record the first is too short.

    The coupling capacitor's charge rounds its current by 1e-8 A in a step: an iteration that is to
    converge to 1e-12 A ends by chance.
    """
    place = tmp_path / "amplifier.cir"
    text = COMMON_EMITTER.replace("Cje=4.493p Tf=301.2p", "Rb=10 Rc=1 Cjc=3.6p Cje=4.5p Tf=301p")
    text = text.replace("RE e 0 1k\nCE e 0 100u", "RE e 0 4.7k").replace("C2 c out", "C2 e out")
    text = text.replace("RC vcc c 2.2k", "RC vcc c 1m").replace("R1 vcc b 100k", f"R1 vcc b {base}")
    place.write_text(text)
    found = taction.check(place, linearise=True)
    assert found.poles.poles.real.min() < -1e9
    assert found.agreement is not None, found.notes
    assert found.agreement < 1e-3
