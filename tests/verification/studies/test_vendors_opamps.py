"""Decks with op-amps of vendors: linear models in their place, and the supplies that they have."""

from __future__ import annotations

import math
from collections.abc import Callable
from pathlib import Path

import pytest

from taction.system.errors import InputError
from taction.verification.stability.poles import poles
from taction.verification.studies.board_check import BoardCheck, check_board
from taction.verification.studies.foreign_board import ForeignBoard, read_board
from taction.verification.studies.wanted_checks import wanted

pytestmark = pytest.mark.usefixtures("ngspice")

Read = Callable[[str], ForeignBoard]


def checked(board: ForeignBoard) -> BoardCheck:
    return check_board(board.circuit, wanted(), initial=board.initial, deck=board)


def test_an_opamp_of_a_vendor_is_replaced(tmp_path: Path) -> None:
    """An inverter with transistors: poles of its linear model, and ngspice's own transient of the
    macromodel beside them."""
    model = Path("tests/data/fet100.cir")
    (tmp_path / "fet100.lib").write_bytes(model.read_bytes())
    place = tmp_path / "inverter.cir"
    place.write_text(
        "inverter\n.include fet100.lib\nVp vp 0 15\nVm vm 0 -15\nV1 in 0 PULSE(0 10m 1u)\n"
        "R1 in x 10k\nR2 x out 10k\nC2 x out 10p\nX1 0 x vp vm out FET100\n.tran 1n 10u\n.end\n"
    )
    board = read_board(place)
    assert any("x1: the macromodel fet100 is replaced" in note for note in board.notes)
    found = check_board(board.circuit, wanted(), initial=board.initial, witness=board.witness)
    (check,) = (each for each in found.checks if each.name == "engines_agree")
    assert check.outcome.value == "pass", check.reason
    assert found.outputs[0].rest - found.outputs[0].before == pytest.approx(-0.01, rel=1e-3)


CLAMPED = """\
.param f=1k
.param t = 1/f double={2*t} third = double / 2
.subckt clamped p n vcc vee out params: gain=20k pole=20
Voff p q dc {1m*(temp - 27)}
G1 0 x q n 100u
R1 x 0 {gain/100u}
C1 x 0 {1/(6.283185307179586*gain/100u*pole)} ic=0
E1 y 0 x 0 1
Ro y out 10
E2 low 0 vee 0 1
E3 high 0 vcc 0 1
D1 low x limit
D2 x high limit
.model limit d n=0.01
.ends
Vp vp 0 15
Vm vm 0 -15
V1 in 0 PULSE(0 10m 1u)
R1 in m 10k
R2 m out 20k
X1 0 m vp vm out clamped
"""


def test_an_opamp_beside_parameters_without_braces(tmp_path: Path) -> None:
    """With the gain A at DC and the noise gain N = 3 the pole is near -2 pi f (1 + A / N)."""
    place = tmp_path / "clamped.cir"
    place.write_text(f"clamped\n{CLAMPED}C1 m 0 {{t*1p}}\n.end\n")
    board = read_board(place)
    lead = poles(board.circuit).rightmost
    loop = 1.0 + 2e4 / (3.0 + 10.0 / 1e4)
    assert lead.real == pytest.approx(-2.0 * math.pi * 20.0 * loop, rel=1e-3)
    assert lead.imag == 0.0


def test_a_macromodel_that_ngspice_does_not_measure_is_named(tmp_path: Path) -> None:
    place = tmp_path / "clamped.cir"
    place.write_text(f"t\n{CLAMPED.replace('n=0.01', 'n=0.01 is=1e-300 bv=1')}.end\n")
    with pytest.raises(InputError, match=r"\.subckt clamped: ngspice does not measure it"):
        read_board(place)


@pytest.fixture
def powered(tmp_path: Path) -> Read:
    """Read a deck with op-amps of a vendor between lines that hold their supplies."""

    def board(text: str) -> ForeignBoard:
        (tmp_path / "fet100.lib").write_bytes(Path("tests/data/fet100.cir").read_bytes())
        place = tmp_path / "single.cir"
        place.write_text(f"single\n.include fet100.lib\n{text}\n.end\n")
        return read_board(place)

    return board


INVERTER = "R1 in x 10k\nR2 x out 10k\nC2 x out 10p\nX1 ref x vp {low} out FET100\n.tran 1n 10u\n"


def test_a_single_supply_shifts_all_voltages(powered: Read) -> None:
    """The macromodel knows its supplies only: at 2 V and 26 V it is the op-amp at ±12 V."""
    found = []
    for low, middle in ((-12.0, 0.0), (2.0, 14.0)):
        lines = (
            f"Vp vp 0 {middle + 12.0}\nVm vm 0 {low}\nVref ref 0 {middle}\n"
            f"V1 in 0 PULSE({middle} {middle + 0.01} 1u)\n"
        )
        board = powered(lines + INVERTER.format(low="vm"))
        check = check_board(board.circuit, wanted(), initial=board.initial, witness=board.witness)
        assert check.checks[0].outcome.value == "pass", check.checks[0].reason
        (row,) = check.outputs
        assert row.rest is not None
        assert row.before is not None
        found.append((row.before - middle, row.rest - middle, check.poles.rightmost.real))
    assert found[0] == pytest.approx(found[1], rel=1e-4, abs=1e-6)
    assert found[1][1] - found[1][0] == pytest.approx(-0.01, rel=1e-3)


def test_each_opamp_has_its_own_supplies(powered: Read) -> None:
    """Two inverters, at ±12 V and at 0 V and 24 V by way of two sources in series."""
    board = powered(
        "Vp vp 0 12\nVm 0 vm 12\nVh vh vp 12\nVr r 0 12\nV1 in 0 PULSE(0 10m 1u)\n"
        "R1 in x 10k\nR2 x a 10k\nX1 0 x vp vm a FET100\n"
        "R3 a y 10k\nR4 y out 10k\nX2 r y vh 0 out FET100\n.save v(out)"
    )
    assert {(model.supply, model.middle) for model in board.opamps.values()} == {
        (12.0, 0.0),
        (12.0, 12.0),
    }
    (row,) = checked(board).outputs
    assert row.before == pytest.approx(24.0, rel=1e-4)  # 2 x 12 V less the output of the first one
    assert row.rest == pytest.approx(24.01, rel=1e-4)


def test_an_output_beyond_its_swing_is_said(powered: Read) -> None:
    lines = "Vp vp 0 24\nVref ref 0 0\nV1 in 0 PULSE(0 1 1u)\n" + INVERTER.format(low="0")
    notes = checked(powered(lines)).notes
    assert any("would rest at -0.9999 V, beyond its swing" in note for note in notes)


def test_a_source_with_ac_and_a_bias_steps_to_its_bias(powered: Read) -> None:
    """A gain of -10 around 12 V: switched on from 0 V it would start beyond the rails."""
    lines = "Vp vp 0 24\nVref ref 0 12\nV1 in 0 DC 12.1 AC 1\n"
    stage = INVERTER.format(low="0").replace("R2 x out 10k", "R2 x out 100k")
    assert "100k" in stage
    board = powered(lines + stage)
    assert board.notes[0].endswith("at t = 0 from 99% to the DC value: V1")
    check = check_board(board.circuit, wanted(), initial=board.initial, witness=board.witness)
    (row,) = check.outputs
    assert row.rest == pytest.approx(12.0 - 10 * 0.1, rel=1e-3)
    assert row.before == pytest.approx(12.0 + 10 * 0.021, rel=1e-3)  # from 11.979 V
    assert check.checks[0].outcome.value == "pass", check.checks[0].reason
    assert not any("swing" in note for note in check.notes)


def test_supplies_are_not_switched_on(powered: Read) -> None:
    lines = "Vp vp 0 24\nVref ref 0 12\nV1 in 0 12.01\n" + INVERTER.format(low="0")
    assert powered(lines).notes[0].endswith("switched on at t = 0: Vref, V1")


def test_a_supply_may_come_through_a_resistor(powered: Read) -> None:
    lines = "Vp v 0 24\nRp v vp 10\nCp vp 0 1u\nVref ref 0 12\nV1 in 0 PULSE(12 12.01)\n"
    board = powered(lines + INVERTER.format(low="0"))
    assert {(model.supply, model.middle) for model in board.opamps.values()} == {(12.0, 12.0)}


def test_the_output_may_stand_before_the_supplies(tmp_path: Path) -> None:
    """The order + - out V+ V- of some vendors is told from the nodes that sources hold."""
    text = Path("tests/data/fet100.cir").read_text()
    text = text.replace(".subckt FET100 1 2 3 4 5", ".subckt FET100 1 2 5 3 4")
    (tmp_path / "other.lib").write_text(text)
    place = tmp_path / "follower.cir"
    place.write_text(
        "t\n.include other.lib\nVp vp 0 15\nVm vm 0 -15\nV1 in 0 PULSE(0 10m)\n"
        "X1 in out out vp vm FET100\n.end\n"
    )
    (row,) = checked(read_board(place)).outputs
    assert row.rest == pytest.approx(0.01, rel=1e-3)


@pytest.mark.parametrize(
    ("lines", "says"),
    [
        ("Vp v 0 24\nRp v vp 10\nRq vp 0 1k\n", "voltage source at its supplies, such as 'VP vp 0"),
        ("Vp vp 0 -5\n", "-5 V and 0 V: x1 needs V. above V-"),
    ],
)
def test_supplies_that_no_source_holds_are_refused(lines: str, says: str, powered: Read) -> None:
    with pytest.raises(InputError, match=says):
        powered(lines + "Vref ref 0 12\nV1 in 0 12\n" + INVERTER.format(low="0"))
