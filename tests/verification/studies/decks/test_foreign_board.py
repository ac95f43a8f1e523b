"""Decks of a designer's hand against nodal analysis with 100 digits, and against closed forms.

Last come decks with several operating points, and steps that leave the linear range.
"""

from __future__ import annotations

import functools
import math
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import pytest

import taction
from taction.system.errors import EngineError, InputError
from taction.verification.engines.statespace.linearised.linear_board import LinearBoard
from taction.verification.engines.statespace.transients.exact import exact_solution
from taction.verification.stability.poles import poles
from taction.verification.studies.decks.board_check import BoardCheck, check_board
from taction.verification.studies.decks.board_sweep import swept_axis
from taction.verification.studies.decks.foreign_board import ForeignBoard, read_board
from taction.verification.studies.decks.questions import wanted
from tests.support.designer_decks import DECKS, deck, written
from tests.support.measured import named
from tests.support.nodal_analysis import exact_poles

pytestmark = pytest.mark.usefixtures("ngspice")
SEPARATED = 1e-2  # relative distance of a pole from all others from which it is well separated
IDEAL = ("wien-resistors",)  # gains of 1e9: rounding of the stamped values alone is 1e-7

Read = Callable[[str], ForeignBoard]
RC = 1.0 / (2.0 * math.pi * 1e4 * 1e-8)  # Hz: 1 / (2 pi R C)


@pytest.fixture(scope="module")
def read(tmp_path_factory: pytest.TempPathFactory) -> Read:
    """Return the board of a deck; each is read once."""

    @functools.cache
    def board(text: str) -> ForeignBoard:
        place = tmp_path_factory.mktemp("deck") / "deck.cir"
        place.write_text(text)
        return read_board(place)

    return board


def checked(board: ForeignBoard, *over: str, checks: tuple[str, ...] = ()) -> BoardCheck:
    swept = [swept_axis(each, board) for each in over]
    return check_board(board, wanted(checks), ngspice=False, over=swept)


@pytest.mark.parametrize("name", DECKS)
def test_poles_are_those_of_nodal_analysis(name: str, read: Read) -> None:
    """Every pole within its bound, and within 1e-9 where it is well separated."""
    board = read(DECKS[name])
    found, left = poles(board.circuit), exact_poles(board.point.cards)
    assert len(found.poles) == len(left)
    for pole, bound in zip(found.poles.tolist(), found.errors.tolist(), strict=True):
        true = min(left, key=lambda each: abs(each - pole))
        left.remove(true)
        assert abs(true - pole) <= bound
        others = [abs(each - true) for each in [*found.poles.tolist()] if each != pole]
        if name not in IDEAL and min(others, default=math.inf) > SEPARATED * abs(true):
            assert abs(true - pole) <= 1e-9 * abs(true)


@pytest.mark.parametrize("name", DECKS)
def test_ngspice_has_the_same_small_signal(name: str, read: Read) -> None:
    check = named(check_board(read(DECKS[name]), wanted()), "ac_agrees")
    assert check.outcome.value == "pass", check.reason
    assert check.value < 1e-6


@pytest.mark.parametrize("name", ["sallen-key-low-pass", "howland", "wien", "ring", "transformer"])
def test_ngspice_has_the_same_transient(name: str, read: Read) -> None:
    check = named(check_board(read(DECKS[name]), wanted(), transient=True), "engines_agree")
    assert check.outcome.value == "pass", check.reason
    assert check.value + check.uncertainty <= 1e-3


def test_a_transient_of_another_circuit_fails(read: Read) -> None:
    """The same cards with a capacitor of 1.1 times the value for ngspice."""
    board = read(DECKS["sallen-key-low-pass"])
    cards = "\n".join(board.point.cards)
    assert cards.count("2.2n") == 1
    other = replace(board.point, cards=tuple(cards.replace("2.2n", "2.42n").split("\n")))
    found = check_board(replace(board, point=other), wanted(), transient=True)
    assert named(found, "engines_agree").outcome.value == "fail"


@pytest.mark.parametrize(
    ("deck_name", "over", "value", "frequency"),
    [
        # by the parameter, and by the gain of its source
        ("wien", "gain=2:4:9", 3.0, RC),
        ("wien", "E1=2:4:9", 3.0, RC),
        ("phase-shift", "gain=20:40:9", 29.0, RC / math.sqrt(6.0)),
        ("phase-shift-low", "gain=20:40:9", 29.0, RC * math.sqrt(6.0)),
        # 1 / (1 + j w R C)^3 has the phase 180 degrees at w R C = sqrt(3), and the size 1/8
        ("ring", "gain=1.5:2.5:9", 2.0, math.sqrt(3.0) * 100.0 * RC),
    ],
)
def test_an_oscillator_begins_at_its_closed_form(
    deck_name: str, over: str, value: float, frequency: float, read: Read
) -> None:
    (sweep,) = checked(read(DECKS[deck_name]), over).sweeps
    (edge,) = sweep.edges.edges
    assert (edge.value, edge.frequency) == pytest.approx((value, frequency), rel=1e-7)


def test_two_crossings_between_two_values_are_found(read: Read) -> None:
    """Lags xT, T, T in a loop of gain 9 oscillate for (x + 2)(1/x + 2) < 10: x from 1/2 to 2."""
    ring = DECKS["ring"].replace("gain=1.9", f"gain={9.0 ** (1.0 / 3.0)!r}")
    (sweep,) = checked(read(ring), "C1=10p:1n:2").sweeps
    assert [edge.value for edge in sweep.edges.edges] == pytest.approx([5e-11, 2e-10], rel=1e-7)


def test_sensitivities_of_a_resonator(read: Read) -> None:
    """R L C in series: p = -R/2L + j w with w^2 = 1/LC - (R/2L)^2."""
    rows = {row.name: row for row in checked(read(deck("rlc", "R1 in a 10", "L1 a out 1m",
                                                       "C1 out 0 1n"))).parts}  # fmt: skip
    decay, square = 10.0 / 2e-3, 1.0 / (1e-3 * 1e-9)
    turn = math.sqrt(square - decay**2)
    wanted = {"R1": (-decay, -(decay**2)), "L1": (decay, decay**2 - 0.5 * square),
              "C1": (0.0, -0.5 * square)}  # fmt: skip
    for name, (real, moved) in wanted.items():
        assert rows[name].real == pytest.approx(real, rel=1e-6, abs=1e-6 * decay)
        assert rows[name].frequency == pytest.approx(moved / turn / math.tau, rel=1e-6)


def test_a_pole_of_a_model_beyond_the_band_decides_nothing(read: Read) -> None:
    """A capacitor of a negative value at a gain of 1e6: +6e14 /s, whatever C1 is."""
    cards = ("E2 x 0 out 0 1meg", "R2 x m 1meg", "C2 m x -1.59f", "R3 m 0 1", ".print v(out)")
    found = checked(read(deck("far", "R1 in out 1k", "C1 out 0 1n", *cards)), "C1=0.5n:2n:5")
    (sweep,) = found.sweeps
    assert sweep.stable_ranges == ((5e-10, 2e-9),)
    assert not sweep.edges.edges
    assert [(row.below, row.above) for row in found.parts if row.name in ("R1", "C1")] == [
        (None, None)
    ] * 2
    assert [note for note in found.notes if "+628.9 T/s, beyond 10 GHz" in note]


def test_margins_are_edges_of_the_poles_and_every_part_counts(read: Read) -> None:
    """The bridge of gain 2.9 oscillates as R2 or C1 grows by 1/9: 1 + R1/R2 + C2/C1 = 2.9."""
    found = checked(read(DECKS["wien"]), checks=("margin=1.01",))
    rows = {row.name: row for row in found.parts}
    # Barkhausen: gain = 1 + R1/R2 + C2/C1
    assert rows["R2"].above == pytest.approx(1e4 / 0.9, rel=1e-6)
    assert rows["R2"].below is None
    assert rows["R1"].below == pytest.approx(9e3, rel=1e-6)
    assert rows["C1"].above == pytest.approx(1e-8 / 0.9, rel=1e-6)
    assert rows["C2"].below == pytest.approx(9e-9, rel=1e-6)
    assert rows["E1"].above == pytest.approx(3.0, rel=1e-6)
    assert found.outcome.value == "pass"
    (check,) = found.checks
    assert check.value == pytest.approx(3.0 / 2.9, rel=1e-6)
    assert checked(read(DECKS["wien"]), checks=("margin=1.1",)).outcome.value == "fail"


def test_a_loop_of_ideal_sources_is_refused(read: Read) -> None:
    cards = ("V2 a in 1", "E1 a 0 in 0 2", "R1 a out 1k", "C1 out 0 1n")
    with pytest.raises(EngineError, match="closes a loop of ideal voltage sources"):
        poles(read(deck("refused", *cards)).circuit)


def test_a_step_through_a_sensed_capacitor_jumps(read: Read) -> None:
    """F copies the impulse of C2 = 10 pF into C1 = 1 nF: 2 x 10 pF x 1 V / 1 nF = 20 mV."""
    board = read(DECKS["cccs-mirror"])
    solution = exact_solution(LinearBoard(board.circuit), initial="rest")
    assert solution.start[0] == pytest.approx(0.02, rel=1e-12)
    assert solution.final[0] == pytest.approx(10.0, rel=1e-12)


@pytest.mark.parametrize(
    "card",
    ["R1 in out R=2*1k", "R1 in out 2*1k", "R1 in out R=1k+q", "E1 out 0 in 0 2*3", "V9 out 0 2*3",
     "C9 out 0 C = 2 * 1n", "R1 in out R=1k tc1=2*1m"],
)  # fmt: skip
def test_an_expression_without_braces_is_refused_with_its_line(card: str, read: Read) -> None:
    text = f"title\n.param q=5\nV1 in 0 PULSE(0 1)\n{card}\nR2 out 0 1k\nC1 out 0 1n\n.end\n"
    with pytest.raises(InputError, match=r"line 4 = .* an expression stands in braces"):
        read(text)


@pytest.mark.parametrize(
    ("volts", "parts", "said"),
    [
        (1e-4, "R1 o out 1k", ""),
        (1.0, "R1 o out 1k", "v(out) = 10 V, the linear circuit 100 V"),
        # The output follows the input, a node beside it does not.
        (1.0, "R1 o 0 1k\nR2 in out 1k", "v(o) = 10 V, the linear circuit 100 V"),
    ],
)
def test_too_large_a_step_is_said(volts: float, parts: str, said: str, tmp_path: Path) -> None:
    """10 tanh(10 v): at 1 V the circuit gives 10 V, its slope 100 V."""
    text = f"V1 in 0 PULSE(0 {volts})\nB1 o 0 V=10*tanh(10*V(in))\n{parts}\nC1 out 0 1n"
    notes = [each for each in taction.check(written(tmp_path, text)).notes if "too large" in each]
    assert said in notes[0] if said else not notes


NEGATIVE_ZERO = """
VP vp 0 15
VN vn 0 -15
V1 in 0 PULSE(0 10m 1u 1n 1n 1 2)
X1 {inputs} vp vn out amp
RL out 0 10k
.subckt amp 2 1 99 50 45
I1 4 50 1m
CIN 1 2 2p
Q1 5 1 7 QN
Q2 6 2 8 QN
R3 99 5 800
R4 99 6 800
R5 7 4 700
R6 8 4 700
EREF 98 0 39 0 1
RS1 99 39 60k
RS2 39 50 60k
G1 98 9 5 6 1.25m
R7 9 98 4Meg
C2 9 98 4p
D1 9 10 DX
D2 11 9 DX
V1 99 10 2
V2 11 50 2
* zero at -150 MHz: 1 + s/w, by a capacitance of -1 nF
E1 14 98 9 39 1e6
R11 14 15 1
R12 15 98 1u
FNZ 14 15 VNZ -1
ENZ 16 98 14 15 1
VNZ 17 98 0
CNZ 16 17 1n
* pole at 300 MHz
G2 98 40 15 39 1u
R10 40 98 1Meg
C4 40 98 0.53f
E2 46 0 40 0 1
R13 46 45 30
.model QN NPN(BF=80)
.model DX D
.ends
"""


@pytest.mark.parametrize(("inputs", "outcome"), [("in out", "pass"), ("out in", "fail")])
def test_a_negative_capacitance_does_not_decide(inputs: str, outcome: str, tmp_path: Path) -> None:
    """R12 and CNZ have a pole at +(R11 + R12) / (R11 R12 CNZ); with exchanged inputs it latches.

    From the unstable point of the exchanged inputs ngspice's tighter solution goes to a supply.
    """
    found = taction.check(written(tmp_path, NEGATIVE_ZERO.format(inputs=inputs)))
    assert found.outcome.value == outcome
    assert found.apart.far.tolist() == [pytest.approx((1.0 + 1e-6) / (1e-6 * 1e-9), rel=1e-6)]
    assert any("the model itself has a pole at +1e15 /s" in note for note in found.notes)
    assert 1e6 < abs(found.poles.rightmost.real) < 1e10


def test_the_ground_of_a_subcircuit_is_ground(tmp_path: Path) -> None:
    """``gnd`` that is no port, with 1 kohm in parallel to 1 kohm at 1 nF; as a port it is one."""
    text = """V1 in gnd pwl 0 1 1u 1 2u 2 r=1u
.subckt low x
R1 x gnd 1k
C1 x gnd '{1n}'
.ends
.subckt high gnd x
R1 x gnd 1k
.ends
X1 out low
X2 in out high"""
    found = taction.check(written(tmp_path, text), outputs="out")
    assert named(found, "ac_agrees").outcome.value == "pass"
    assert found.poles.rightmost.real == pytest.approx(-2e6, rel=1e-9)
    assert any("a pwl that repeats" in note for note in found.notes)
