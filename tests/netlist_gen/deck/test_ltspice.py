"""Decks as LTspice writes them, against closed forms and the same circuits in plain cards."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from pathlib import Path

import numpy as np
import pytest

from taction.netlist_gen.deck.expressions import affine, as_expression
from taction.netlist_gen.deck.foreign_cards import plain_cards, spelt
from taction.system.errors import InputError
from taction.verification.engines.statespace.linearised.linear_board import LinearBoard
from taction.verification.stability.poles import poles
from taction.verification.studies.decks.foreign_board import ForeignBoard, read_board

pytestmark = pytest.mark.usefixtures("ngspice")
Read = Callable[[str], ForeignBoard]
W = 2.0 * math.pi * 1e7  # rad/s: a gain-bandwidth product of 10 MHz
INVERTER = "V1 in 0 PULSE(0 1)\nR1 N1 in 10k\nR2 out N1 100k\n.lib UniversalOpamps2.sub\n"


@pytest.fixture
def read(tmp_path: Path) -> Read:
    def board(text: str) -> ForeignBoard:
        place = tmp_path / "deck.cir"
        place.write_text(f"t\n{text}\n.end\n", encoding="utf-8")
        return read_board(place)

    return board


def found_poles(board: ForeignBoard) -> list[complex]:
    return sorted(poles(board.circuit).poles.tolist(), key=lambda p: (p.real, p.imag))


def expected(roots: Sequence[complex]) -> list[complex]:
    return sorted(map(complex, roots), key=lambda p: (p.real, p.imag))


def rest(board: ForeignBoard, node: str = "out") -> float:
    return float(LinearBoard(board.circuit).equilibrium[node])


@pytest.mark.parametrize("level", ["level.1", "level.2"])
def test_an_inverter_with_an_opamp_of_one_pole(level: str, read: Read) -> None:
    """(1 + s A/w) + A beta = 0, with Rin beside R1."""
    call = f"XU1 0 N1 vcc 0 out {level} Avol=1Meg GBW=10Meg Slew=10Meg Rin=500Meg\nV2 vcc 0 3.3\n"
    board = read(INVERTER + call)
    beta = 1.0 / (1.0 + 1e5 * (1.0 / 1e4 + 1.0 / 5e8))
    assert found_poles(board) == pytest.approx([-(W / 1e6 + W * beta)], rel=1e-9)
    assert rest(board) == pytest.approx(-10.0, rel=2e-5)
    assert any(note.startswith(f"{level}: the linear part") for note in board.notes)
    assert any(note.startswith("UniversalOpamps2.sub: a library") for note in board.notes)


@pytest.mark.parametrize("margin", [30.0, 60.0])
def test_an_opamp_with_a_phase_margin(margin: float, read: Read) -> None:
    """(1 + s A/w) (1 + s/p2) + A = 0: at w the second pole takes 90 degrees less the margin."""
    board = read(
        f"V1 in 0 PULSE(0 1)\nXU1 in out vcc 0 out level.3a Avol=1k GBW=10Meg phimargin={margin}\n"
        "V2 vcc 0 5"
    )
    second = W * math.tan(math.radians(margin))
    exact = np.roots([1e3 / W / second, 1e3 / W + 1.0 / second, 1001.0])
    assert found_poles(board) == pytest.approx(expected(exact), rel=1e-8)


def test_the_opamp_of_three_pins(read: Read) -> None:
    """A current A v into 1 ohm beside A/w: a follower from - + out."""
    board = read("V1 in 0 PULSE(0 1)\nX§U1 out in out opamp Aol=100K GBW=10Meg\n.lib opamp.sub")
    assert found_poles(board) == pytest.approx([-W * (1.0 + 1e-5)], rel=1e-9)
    assert rest(board) == pytest.approx(1.0 / (1.0 + 1e-5), rel=1e-9)


def test_an_own_subcircuit_has_the_first_word(read: Read) -> None:
    board = read("V1 in 0 1\nX1 in out opamp\n.subckt opamp a b\nR1 a b 1k\nC1 b 0 1n\n.ends")
    assert found_poles(board) == pytest.approx([-1e6], rel=1e-9)


def test_parasitics_are_parts(read: Read) -> None:
    """A coil with Rser beside Cpar and R: s^2 L C + s (L/R + r C) + 1 + r/R = 0 from a current."""
    board = read("I1 0 out PULSE(0 1m) \nL1 out 0 10µ Rser=2 Cpar=1n\nR1 out 0 2K2 tol=1 pwr=0.1")
    L, C, r, R = 10e-6, 1e-9, 2.0, 2200.0
    exact = np.roots([L * C, L / R + r * C, 1.0 + r / R])
    assert found_poles(board) == pytest.approx(expected(exact), rel=1e-9)


def test_a_capacitor_and_a_source_with_resistances(read: Read) -> None:
    """50 ohm, 1 kohm, and the capacitor's 10 ohm: one pole; its Rpar loads the source."""
    board = read(
        "V1 in 0 PULSE(0 1) Rser=50\nR1 in out 1k\nC1 out 0 1u V=50 Rser=10 Rpar=9k Lser=0"
    )
    loop = 10.0 + 1.0 / (1.0 / 1050.0 + 1.0 / 9e3)
    assert found_poles(board) == pytest.approx([-1e6 / loop], rel=1e-9)
    assert rest(board) == pytest.approx(9e3 / 10.05e3, rel=1e-9)


@pytest.mark.parametrize(
    "card",
    ["B1 a 0 V=3*v(in)-0.5*v(out)+0.25", "E1 a 0 VALUE={3*V(in)-V(out)/2+0.25}",
     "E1 a 0 POLY(2) in 0 out 0 0.25 3 -0.5",
     ".param k=3\nE1 a 0 POLY(2) (in,0) (out,0) 0.25 {k} {-k/6}"],
)  # fmt: skip
def test_a_linear_expression_is_a_source(card: str, read: Read) -> None:
    """a = 3 - out/2 + 0.25: out rests at 3.25 / 1.5 with the pole -1.5 / (R C)."""
    board = read(f"V1 in 0 PULSE(0 1)\n{card}\nR1 a out 1k\nC1 out 0 1n")
    assert found_poles(board) == pytest.approx([-1.5e6], rel=1e-9)
    assert rest(board) == pytest.approx(3.25 / 1.5, rel=1e-9)


def test_a_linear_current(read: Read) -> None:
    """Half of the current of V1, and 1 mS of v(in), into R2: (0.5 x 0.5 m + 1 m) x 1 k."""
    board = read(
        "V1 in 0 PULSE(0 1)\nR1 in 0 2k\nB1 0 out I=-0.5*i(V1)+v(in)*1m\nR2 out 0 1k\nC2 out 0 1n"
    )
    assert rest(board) == pytest.approx(1.25, rel=1e-9)


@pytest.mark.parametrize(
    ("text", "says"),
    [
        ("v(a)*v(b)", "not linear"), ("1/v(a)", "not linear"), ("v(a)^2", "not linear"),
        ("sin(v(a))", "not linear"),
        ("v(a", "cannot be read"), ("v(a)+tempo", "not linear"), ("2^1e9", "not finite"),
        ("__import__(1)", "not linear"),
    ],
)  # fmt: skip
def test_other_expressions_are_refused(text: str, says: str) -> None:
    with pytest.raises(ValueError, match=says):
        affine(text)


def test_a_polynomial_of_the_second_degree_is_its_slope(read: Read) -> None:
    """Of v^2 at 1 V: 2 V a volt."""
    assert "v(a,0)*v(a,0)" in as_expression("b1 s 0 v={poly(1) v(a) 0 0 1}")
    assert as_expression("e1 s 0 poly 1 a 0 0 2") == "be1 s 0 v=2.0*v(a,0)"  # as vendors write, too
    board = read("V1 in 0 1\nE1 out 0 POLY(1) in 0 0 0 1\nR1 out 0 1k")
    (gain,) = [part.value for part in board.circuit.branches if "#g" in part.card]
    assert gain == pytest.approx(2.0, rel=1e-9)


def test_letters_of_names_stay_apart(read: Read) -> None:
    """Names with other letters, and KiCad's #, become different ASCII names."""
    board = read(
        "V1 ein° 0 PULSE(0 1) ; 25 °C – “quoted”\nR1 ein° größe 1kΩ\nC1 größe 0 1nF\n"
        "R2 ein° gröſe 1k\nC2 gröſe 0 2n\nR3 net#1 größe 1G"
    )
    assert found_poles(board) == pytest.approx([-1e6, -5e5], rel=1e-5)
    assert len({spelt(name) for name in ("a§", "a°", "aä", "aö", "a_", "a")}) == 6


@pytest.mark.parametrize(
    ("card", "plain"),
    [
        ("r1 a b 4k7", ["r1 a b 4.7k"]), ("c1 a b 2u2f", ["c1 a b 2.2u"]),
        (".param r=1meg5 c=3", [".param r=1.5meg c=3"]), ("i1 a 0 1m load", ["i1 a 0 1m"]),
        ("c1 a b 1u rser=0 irms=0", ["c1 a b 1u"]), ("r1 a b 1k tc1=0", ["r1 a b 1k tc1=0"]),
        (
            ".model n nmos(vto=agauss(0.6, 0.1, 3), kp=1)",
            [".model n nmos(vto=agauss(0.6, 0.1, 3) kp=1)"],
        ),
        ("l1 a b {x} rser={y}", ["l1 a_taction_l1_1 b {x}", "rser_l1 a a_taction_l1_1 {y}"]),
    ],
)  # fmt: skip
def test_cards_become_plain(card: str, plain: list[str]) -> None:
    assert list(plain_cards(card)) == plain


@pytest.mark.parametrize(
    ("card", "says"),
    [
        ("XU1 in out vp vm out LT1001", "no subcircuit 'lt1001'; put the file"),
        ("E1 out 0 in 0 Laplace=exp(-s*1u)", "quotient of polynomials"),
        ("S1 in out c 0 SW", "no operating point|does not expand"),
        ("A1 %vd(in,0) x amp", "'%' is not accepted; a code model of ngspice"),
        ("D1 in out dx thermal\n.model dx d", "heats itself"),
        ("R1 in – 1k", "the character '–' is not accepted"),
        (".include a\0b", "without control characters"),
        (".lib C:\\LTspice\\lib\\my.sub", "outside the deck's folder|no file .*my.sub"),
    ],
)
def test_a_refusal_says_what_is_accepted(card: str, says: str, read: Read) -> None:
    with pytest.raises(InputError, match=says):
        read(f"V1 in 0 1\n{card}\nR9 in out 1k\nC9 out 0 1n")


def test_a_library_of_another_folder_is_read_from_the_deck_s(tmp_path: Path, read: Read) -> None:
    (tmp_path / "rc.lib").write_text(".subckt rc a b\nR1 a b 1k\nC1 b 0 1n\n.ends\n")
    lost = ".lib C:\\Program Files\\LTC\\lib\\cmp\\standard.bjt\n"
    board = read(f"V1 in 0 1\nX1 in out rc\n{lost}.include C:\\Users\\ann lee\\rc.lib")
    assert found_poles(board) == pytest.approx([-1e6], rel=1e-9)
    assert any("rc.lib in the deck's folder is read" in note for note in board.notes)


def test_a_transfer_function_whose_coefficients_differ_by_decades(read: Read) -> None:
    """A gain of 1e5 with a pole at 62.8 /s and a double one at 1e6 /s."""
    board = read(
        "V1 in 0 PULSE(0 1)\nR1 out 0 1k\n"
        "E1 out 0 in 0 Laplace=1e5*(1+s/1e3)/((1+s/62.8)*(1+s/1e6)^2)"
    )
    assert board.is_linear  # it is linear, and nothing of it is measured
    assert found_poles(board) == pytest.approx([-1e6, -1e6, -62.8], rel=1e-6)
    assert rest(board) == pytest.approx(1e5, rel=1e-9)
