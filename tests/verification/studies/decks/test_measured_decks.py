"""Decks with transistors, clamps and op-amps of vendors: true poles, and ngspice's own ``.ac``.

The poles of the cases are those of nodal analysis of their cards in mpmath.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

import taction
from taction.system.errors import InputError
from taction.verification.characterise import operating_point
from taction.verification.studies.decks import witnesses
from taction.verification.studies.decks.board_check import BoardCheck
from taction.verification.studies.decks.foreign_board import read_board
from tests.support.designer_decks import written
from tests.support.measured import named
from tests.support.paths import CASES

pytestmark = pytest.mark.usefixtures("ngspice")
VT = 1.3806488e-23 * 300.15 / 1.602176565e-19  # as ngspice has it at 27 degrees C


def checked(folder: Path, text: str, **options: object) -> BoardCheck:
    """The check of a deck, of which the small signals are those of ngspice."""
    found = taction.check(written(folder, text), **options)  # type: ignore[arg-type]
    assert options.get("ngspice") is False or named(found, "ac_agrees").outcome.value == "pass"
    return found


@pytest.mark.parametrize(
    ("name", "real", "hertz"),
    [
        ("vendor-rdiff-wien.cir", 0.0934, 0.9946),
        ("vendor-rdiff-buffer.cir", -99.19e3, 0.0),
        ("single-pole-1e39.cir", -2.9909e6, 0.0),
        ("linearise-ldo-stub.cir", 9.168e3, 584.16e3),
        ("refused-tanh-opamp.cir", -44.739e3, 7.913e3),
        ("limit-silent.cir", -44.739e3, 7.913e3),
        ("supply-through-diode.cir", -1e5 / (1e8 * 53e-12), 0.0),
        ("refused-supply-bead.cir", -1e5 / (1e8 * 53e-12), 0.0),
        ("refused-six-ports-gnd-first.cir", None, None),
        ("refused-order-out-vee-vcc.cir", -0.5e5 / (1e8 * 53e-12) / 1.00375, 0.0),
        ("midsupply-ac.cir", None, None),
        # 1 TH and 1 TF: s^2 + s R/L + 1/(LC) of what the amplifier's DC gain of 1e6 leaves
        ("lc-open-loop-slow.cir", -1.875e-10, None),
        ("refused-hspice-opamp.sp", -1.0 / (10e3 * 1e-9), 0.0),
        ("refused-laplace.cir", -(1.0 + 1e5 / 11.0) * 62.8, 0.0),
    ],
)
def test_the_rightmost_pole_is_right(name: str, real: float | None, hertz: float | None) -> None:
    found = taction.check(CASES / name)
    assert named(found, "ac_agrees").outcome.value == "pass"
    lead = found.poles.rightmost
    if real is not None:
        assert lead.real == pytest.approx(real, rel=1e-4)
    if hertz is not None:
        assert lead.imag / math.tau == pytest.approx(hertz, rel=1e-4)
    assert found.poles.stable is (lead.real < 0.0)
    if name == "refused-supply-bead.cir":  # the ferrite and the capacitor of the supply
        (upper,) = [p for p in found.apart.hidden.tolist() if p.imag > 0.0]
        assert upper == pytest.approx(complex(-1.0 / (2.0 * 1e3 * 10e-6), 1e5), rel=2e-3)


PAIR = """.model qn npn(is=1e-14 bf=200 vaf=100 cje=1p cjc=1p xcjc=0.5 tf=300p rb=100 rc=5 re=1)
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
RL out 0 100k"""
FIELD = """.model nm nmos(level=1 vto=1 kp=200u lambda=0.02 cgso=1n cgdo=1n cbd=10f cbs=10f)
.model jf njf(vto=-2 beta=1m lambda=0.01 cgs=3p cgd=2p)
.model ds d(is=1e-12 rs=5 cjo=3p)
Vdd vdd 0 5
Vin in 0 DC 2 AC 1
Rs in g 1k
M1 d g 0 0 nm w=20u l=1u
Rd vdd d 2k
J1 vdd d s jf
D1 s out ds
Rl out 0 1k"""
# A base resistance that falls with the current, without a capacitance to the substrate.
FALLING = """Vp vp 0 5
V1 in 0 0.9 AC 1
Q1 c b e qn
Rb in b 1k
Rc vp c 1k
Re e 0 100
.model qn npn(is=1e-15 bf=100 ikf=5m vaf=50 rb=400 rbm=100 re=1 rc=10 cje=1p cjc=1p tf=20p)"""
LEAKING = """Vin in 0 DC -5 AC 1
D1 in k dx
Vk k 0 0
F1 0 out Vk 40meg
R1 out 0 1k
C1 out 0 1n
.model dx D(Is=800f rs=1)"""  # 1 pS behind 1 S, times 4e7


# BSIM, levels 8 and 14, knows no rd and rs, and BSIM4, level 14, no sheet without its squares.
OHMIC = ("rsh=10", "nrd=2 nrs=3"), ("rd=5 rs=5", "nrd=2"), ("rsh=10", "")
MOS = """.model nm nmos(level={} {})
Vdd vdd 0 1.8
Vin in 0 dc 0.8 ac 1
M1 d in 0 0 nm w=20u l=0.5u {}
Rd vdd d 1k
Cl d 0 1p"""
# An op-amp of the Boyle kind: gains of 2e9 leave 1e-6 of a current to ngspice's rounding.
LOOP = """.model jx pjf(beta=300u vto=-1 is=2.5p)
.model dx d(is=8e-16)
Vp 3 0 15
Vm 4 0 -15
Vin 1 0 DC 0 AC 1
J1 11 5 10 jx
J2 12 1 10 jx
Iss 3 10 30u
Rss 10 0 7meg
R1 4 11 11k
R2 4 12 11k
C1 11 12 4p
Ga 6 0 11 12 90u
Gc 0 6 10 0 0.5n
R6 6 9 100k
Vb 9 0 0
C2 6 7 15p
Ff 7 0 POLY(5) Vb Vc Ve Vlp Vln 0 2.4e9 -2e9 2e9 2e9 -2e9
R7 7 0 25
Vl 7 8 0
R8 8 5 50
D1 5 53 dx
Vc 3 53 1.5
D2 54 5 dx
Ve 54 4 1
Hl 90 0 Vl 1k
D3 90 91 dx
Vlp 91 0 18
D4 92 90 dx
Vln 0 92 18"""
# 47 pA of the gate flow through D6: a second point in one run of ngspice has others.
FOLLOWER = """.model dx d(is=1e-15)
.model jx pjf(beta=12.5u vto=-2 is=30p)
Vp vp 0 15
Vm vm 0 -15
V1 in 0 dc 0 ac 1
I1 vp 4 100u
J1 5 out 4 jx
J2 6 in 4 jx
R3 5 vm 20k
R4 6 vm 20k
C4 5 6 0.2p
G1 0 9 5 6 2m
R5 9 0 100meg
C3 9 0 50p
E1 26 0 9 0 1
V8 26 27 0
R16 27 out 25
F5 vp 23 V8 1
D6 23 vp dx
C1 out 0 1n
.print v(out)"""
# Some 1e-13 A through a junction to 15 V: ngspice resolves 1 fA, 1 % of its slope.
WEAK = """.model dx d(is=1e-15)
Vp vp 0 15
V1 in 0 dc 1 ac 1
R1 in a 1k
R2 a 0 1k
C1 a 0 1n
E1 b 0 a 0 1.0000000001
G1 x 0 b a 2m
D1 vp x dx
L1 x y 1u
C2 y 0 1p
.print v(a)"""
RESPONDING = {
    **dict.fromkeys((PAIR, FIELD, LEAKING, WEAK, FOLLOWER), ()),
    **{MOS.format(n, *ohms): "d" for n in (2, 8, 14) for ohms in OHMIC},
    LOOP: "5",
    FALLING: "c",
}


@pytest.mark.parametrize("text", RESPONDING)
def test_every_node_responds_as_in_ngspice(text: str, tmp_path: Path) -> None:
    """From the source and from currents into every node, within 1e-6.

    Not counted is what ngspice itself does not resolve. The point of all is known to nine digits
    from ngspice's own start, not from the point that is near.
    """
    found = checked(tmp_path, text, outputs=RESPONDING[text])
    assert found.poles.known_stable
    assert not any("(found with" in note for note in found.notes)


def test_a_diode_is_its_conductance(tmp_path: Path) -> None:
    """1 mA through D1: g = (I + Is) / Vt, and the rest is Vt ln(1 + I / Is)."""
    text = ".model dd d(is=1e-14)\nI1 0 out 1m\nIs 0 out DC 0 AC 1\nD1 out 0 dd\nC1 out 0 1u"
    found = checked(tmp_path, text, outputs="out", ngspice=False)
    assert found.poles.rightmost.real == pytest.approx(-(1e-3 + 1e-14) / VT / 1e-6, rel=1e-6)
    (row,) = found.outputs
    assert row.before == pytest.approx(VT * math.log1p(1e-3 / 1e-14), rel=1e-6)
    assert "linear about ngspice's operating point" in found.notes[0]


def test_nodes_and_outputs_are_found_by_their_names(tmp_path: Path) -> None:
    """ngspice writes the only vector of a plot as V(1), every other one as v(1)."""
    found = checked(tmp_path, ".model dd d(is=1e-14)\nD1 1 0 dd")
    assert [row.before for row in found.outputs] == pytest.approx([0.0], abs=1e-15)
    text = "V1 in 0 dc 0 ac 1\nR1 in a 1k\nC1 a 0 1n\nR2 a out 1k\nC2 out 0 1n"
    found = checked(tmp_path, f"{text}\n.print ac vdb(a) vp(a)")
    assert [output.name for output in found.outputs] == ["a"]


@pytest.mark.parametrize(
    ("card", "words"),
    [
        ("Q9 out in 0 nomodel", ("deck.cir", "does not expand")),
        ("D1 in 0 dx\nV2 in 0 5\n.model dx d", ("deck.cir",)),
        ("A1 in out g\n.model g gain(gain=2)", ("code model", "not accepted")),
        ("S1 out 0 in 0 sw\n.model sw sw(vt=0.5)", ("S1", "expected a resistor")),
        ("Q1 out in 0 m\n.model m nbjt level=1", ("line 5", "CIDER", "npn")),
        ("M1 out in 0 0 m nrd=2 nrs=3\n.model m nmos(level=4 rsh=10)", ("no finite small signal",)),
        # PSpice's IF is read in ngspice's PSpice mode alone, which lists up to 4,000 characters:
        # the reason is that of the mode that reads most.
        (f"E1 out 0 value={{if(v(in)>0,{'+'.join(['v(in)*1m'] * 700)},0)}}", ("too many terms",)),
        ("E1 out 0 in 0 Laplace=exp(-s*1u)", ("no quotient of polynomials",)),
        ("E1 out 0 in 0 Laplace=s/(1+s)*s", ("order of the numerator is 2",)),
        ("E1 out 0 in 0 Laplace=(1+s", ("cannot be read",)),
        ("E1 out 0 in 0 Laplace=1/(1+s)^40", ("no quotient of polynomials",)),
        ("E1 out 0 in 0 Laplace=1/(s-s)", ("a denominator of 0",)),
    ],
)
def test_what_is_not_measured_is_refused(card: str, words: tuple[str, ...], tmp_path: Path) -> None:
    with pytest.raises(InputError) as error:
        checked(tmp_path, f"V1 in 0 DC 1 AC 1\nR1 in out 1k\n{card}\nC1 out 0 1n", ngspice=False)
    for word in words:
        assert word in str(error.value)


def test_a_parameter_moves_the_point(tmp_path: Path) -> None:
    """The conductance of a diode follows a .param, and not the one of a subcircuit, its current."""
    text = ".param amps=1m\n.model dd d(is=1e-14)\nI1 0 out {amps}\nD1 out 0 dd\nC1 out 0 1u"
    text += "\nX1 x 0 own\n.subckt own a b\n.param amps=5\nR1 a b {amps}\n.ends"
    board = read_board(written(tmp_path, text))
    one, other = board.at("amps", [1e-3, 2e-3])
    assert not isinstance(one, InputError)
    assert not isinstance(other, InputError)
    assert [part.ohms for part in other.resistors] == [5.0]
    slopes = [
        sum(part.value for part in circuit.branches if "#g" in part.card)
        for circuit in (one, other)
    ]
    assert slopes == pytest.approx([1e-3 / VT, 2e-3 / VT], rel=1e-6)


LATCH = """.model n npn(is=1e-14 bf=100 cje=1p cjc=1p tf=0.3n)
Vcc vcc 0 5
R1 vcc a 1k
R2 vcc b 1k
Rb1 a x 10k
Rb2 b y 10k
Q1 a y 0 n
Q2 b x 0 n
I1 0 a dc 0 ac 1
.print v(a)"""
HIDDEN = """V1 in 0 dc 0 ac 1
R1 in out 1k
C1 out 0 1n
B2 h2 0 V=10*tanh(0.2*V(h))
R2 h2 h 1k
C2 h 0 1n
.print v(out)"""


@pytest.mark.parametrize(("text", "rate"), [(LATCH, None), (HIDDEN, 1e6)])
def test_the_middle_of_a_latch_is_no_pass(text: str, rate: float | None, tmp_path: Path) -> None:
    """Also one that no source and no output sees; stable points stand on either side of it."""
    found = checked(tmp_path, text)
    assert any(note.startswith("at least 3 operating points") for note in found.notes), found.notes
    assert found.poles.stable is False
    assert found.outcome.value == "fail"
    if rate is not None:
        assert found.poles.rightmost.real == pytest.approx(rate, rel=1e-9)


INVERTERS = """.model n nmos(vto=0.7 kp=100u)
.model p pmos(vto=-0.7 kp=40u)
Vd d 0 3
V1 in 0 dc 0 ac 1
R1 in a 1meg
C1 a 0 1p
C2 b 0 1p
M1 a b 0 0 n w=10u l=1u
M2 a b d d p w=20u l=1u
M3 b a 0 0 n w=10u l=1u
M4 b a d d p w=20u l=1u
.print ac v(a)"""


def test_a_latch_says_where_else_it_would_rest(tmp_path: Path) -> None:
    """One node at 3 V, the other at 0 V, or the other way round."""
    found = checked(tmp_path, INVERTERS)
    assert found.poles.stable is True
    (note,) = [note for note in found.notes if "operating points" in note]
    assert note.startswith(
        "at least 2 operating points: all that follows is of this one, with v(a)"
    )
    # The output does not see the latch h, which rests at 0 V, and at -/+ 9.3 V.
    found = checked(tmp_path, HIDDEN)
    (note,) = [note for note in found.notes if "operating points" in note]
    assert "v(out)" not in note


NEGATIVE = """.subckt oa p m vc ve o
.model n npn(bf=1000)
I1 e ve 10u
Q1 c1 m a n
Q2 c2 p b n
R1 a e -1k
R2 b e -1k
R3 vc c1 13k
R4 vc c2 13k
C1 c1 c2 4p
G1 0 x c1 c2 100u
R5 x 0 1meg
C2 x 0 150p
E1 o 0 x 0 1
.ends
Vc vc 0 15
Ve ve 0 -15
V1 in 0 dc 0 ac 1
X1 in out vc ve out oa
.print ac v(out)"""


def test_a_negative_resistance_in_series_with_an_emitter_is_no_latch(tmp_path: Path) -> None:
    """Less than 1 / gm = 5.2 kohm: makers of models raise the slope of an input stage by it."""
    found = checked(tmp_path, NEGATIVE)
    assert found.outcome.value == "pass"
    # 1 / gm - 1 kohm of each half, 13 kohm, 100 uS and 150 pF, beside 4 pF across 26 kohm
    fast, slow = 1.0 / (26e3 * 4e-12), 100e-6 * 13e3 / (2 * VT / 10e-6 - 1e3) / 150e-12
    assert found.poles.rightmost.real == pytest.approx(
        np.roots([1, fast, fast * slow])[1], rel=0.02
    )


def test_solvers_that_differ_do_not_decide(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """At one node both are off by 1e-5, in opposite directions or in one; at many it is unknown."""
    asked = witnesses._theirs

    def of_solver(sign: float, count: int) -> Callable[..., object]:
        def theirs(*given: object, option: str = "", **more: object) -> object:
            hertz, both, said = asked(*given, option=option, **more)  # type: ignore[arg-type]
            both[1, 3 : 3 + count, 1] *= 1.0 + 1e-5 * (sign if option else 1.0)
            return hertz, both, said

        return theirs

    deck = "V1 in 0 dc 0 ac 1\nR1 in a 1k\nC1 a 0 1n\nR2 a out 1k\nC2 out 0 1n"
    for sign, count, outcome in ((-1.0, 1, "pass"), (-1.0, 20, "inconclusive"), (1.0, 1, "fail")):
        monkeypatch.setattr(witnesses, "_theirs", of_solver(sign, count))
        check = named(taction.check(written(tmp_path, deck), outputs="a"), "ac_agrees")
        assert check.outcome.value == outcome, check
        said = f"a: not resolved within the limit at {count} of "
        assert (said in check.reason) is (outcome != "fail")


@pytest.mark.parametrize("formula", ["500*i(e1)", "tanh(500*i(e1)+0.5)"])
def test_the_current_of_a_source_is_not_that_of_another_part(formula: str, tmp_path: Path) -> None:
    """``i(e1)`` beside a source Ve1, with 2 V at 1 kohm: -2 mA, and a gain of -1 V/V at the node.

    Of the tanh at rest (-1 + 0.5 = -0.5) the slope is 1 - tanh(0.5)^2.
    """
    found = checked(
        tmp_path,
        "V1 in 0 1 ac 1\nVe1 q 0 0\nRq q in 7k\nE1 x 0 in 0 2\nR1 x 0 1k\n"
        f"B1 o 0 v={formula}\nR3 o p 1k\nC3 p 0 1n\n.plot ac v(o) v(p)",
    )
    first = found.outputs[0]
    slope = 1.0 if formula.startswith("500") else 1.0 - math.tanh(0.5) ** 2
    moved = (first.rest - first.before) / (0.01 if slope == 1.0 else 1e-3)
    assert moved == pytest.approx(-slope, rel=1e-3)


def test_a_capacitance_of_nothing_is_left_out(tmp_path: Path) -> None:
    """Less than 1e-23 F, such as CSS of many a vendor's op-amp, is no pole at 1e33 /s."""
    found = checked(tmp_path, f"{AREA}\nD2 0 out m 400e-12")
    assert any("left out: D1, D2" in note for note in found.notes)
    assert found.poles.poles == pytest.approx([-1.0 / (1e3 * 6e-9)], rel=1e-6)


AREA = """.model m d is=1e-8 cjo=10f
Vin in 0 DC 1 AC 1
D1 0 in m 400e-12
R1 in out 1k
C1 out 0 6n"""  # 2 aF at the source, and so a pole of 1e17 times that of C1


def test_a_capacitance_that_moves_an_output_is_not_left_out_in_silence(tmp_path: Path) -> None:
    """Two reversed diodes divide by their capacitances from some 20 GHz on, before that by gmin."""
    text = f"{AREA}\nD2 dark in m 400e-12\nD3 0 dark m 100e-12\nR2 out x 1k\nC2 x 0 100f"
    check = named(taction.check(written(tmp_path, text), outputs="dark"), "ac_agrees")
    assert check.outcome.value == "inconclusive"
    assert "dark" in check.reason


def test_a_polynomial_of_the_third_degree_of_two_inputs(tmp_path: Path) -> None:
    """Its coefficients after 1, x, y, xx, xy, yy are those of xxx, xxy, xyy and yyy."""
    cards = ["V1 x 0 dc 2 ac 1", "V2 y 0 3", "E1 u 0 poly(2) x 0 y 0 0 0 0 0 0 0 1 10 100 1000"]
    found = checked(tmp_path, "\n".join([*cards, "R1 u out 1k", "C1 out 0 1n", ".print v(out)"]))
    gain = 3.0 * 2.0**2 + 10.0 * 2.0 * 2.0 * 3.0 + 100.0 * 3.0**2
    (before,), (rest,) = found.before, found.rest
    assert before == pytest.approx(8.0 + 10.0 * 12.0 + 100.0 * 18.0 + 1000.0 * 27.0)
    assert rest - before == pytest.approx(gain * 1e-3, rel=1e-9)


def test_a_point_not_found_again_is_none(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Where a transient ends no small signal is known; with no tolerances to try none is found."""
    monkeypatch.setattr(operating_point, "TRIED", ())
    with pytest.raises(InputError, match="by a transient only"):
        checked(tmp_path, "I1 0 out 1m\nD1 out 0 dd\n.model dd d(is=1e-14)\nC1 out 0 1u")


def test_where_ngspice_keeps_pivots_it_is_asked_at_each_frequency(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """ngspice's pivots are those of the first frequency: far from it some decks lose all digits."""
    true = operating_point.DeckPoint.small_signals

    def rounded(point, driven, sweeps, option=""):
        tables, said = true(point, driven, sweeps, option)
        far = [each["frequency"].real > 3.0 * each["frequency"].real[0] for each in tables]
        wrong = [
            {name: np.where(high, 1.01 * values, values) for name, values in table.items()}
            for high, table in zip(far, tables, strict=True)
        ]
        return wrong, said

    monkeypatch.setattr(operating_point.DeckPoint, "small_signals", rounded)
    found = checked(tmp_path, "V1 in 0 PULSE(0 1)\nR1 in out 1k\nC1 out 0 1n")
    assert found.outcome.value == "pass"
