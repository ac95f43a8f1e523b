"""Cards of public decks in other dialects by closed forms, and vendors' subcircuits."""

from __future__ import annotations

import math
from pathlib import Path

import numpy as np
import pytest

from taction.netlist_gen.deck.expressions import polynomial
from taction.netlist_gen.deck.foreign_cards import missing_cards, plain_cards
from taction.netlist_gen.deck.foreign_deck import (
    flat_subcircuit,
    stored_subcircuit,
    vendor_subcircuit,
)
from taction.system.errors import InputError
from taction.verification.characterise.operating_point import find_point
from taction.verification.stability.poles import poles
from taction.verification.studies.decks.foreign_board import read_board
from tests.support.paths import ROOT

CASES = ROOT / "tests" / "data" / "cases"
RC = "V1 in 0 1\nR1 in out 1k\nC1 out 0 1n\n"


def inverting(gain: float, tau: float, r1: float, r2: float, c: float) -> float:
    """The slowest pole of an inverting amplifier, ``(1 + s tau) (R1 + Zf) + A R1 = 0``."""
    first = np.polymul([tau, 1.0], [r1 * r2 * c, r1 + r2])
    return float(np.roots(np.polyadd(first, [gain * r1 * r2 * c, gain * r1])).real.max())


def transformer() -> float:
    """The slowest pole of an op-amp that drives three coils of 10 mH, all coupled by 1."""
    share = 1.0 / (1 / 10 + 2 / 1000)  # v(fb) = (v(d) / 10 - i) share, 10 mH i' = v(fb)
    tau = 1e3 * 15.9e-6
    back = np.array([share / 10, -share])
    return float(np.linalg.eigvals([(-1e5 * back - [1.0, 0.0]) / tau, back / 10e-3]).real.max())


POLES = {
    "agauss-random.cir": inverting(1e5, 1e3 * 15.9e-6, 10e3, 100e3, 100e-12),
    "kicad-nested-subckt.cir": -1.009e6,  # with the inner subcircuit written outside
    "linearise-model-comma.cir": -13.41e6,  # with blanks for the commas
    "param-override.cir": -62.8 * (1 + 1e5 / 2 * 20e3 / 20.01e3),
    "refused-k-one.net": transformer(),
    "refused-level2.net": -2e7 * np.pi / 11,
    "refused-orcad-tc.cir": -4.543e3,  # without TC=
    "refused-portnum-ac.cir": -1e5 * (1 + 11 / 1e5),
    "refused-rkm-4r7.cir": -(1 + 1e5 * 4.7 / 51.7) / (1e3 * 1.5e-6),
    "refused-tc-pair.cir": -1e5 * (1 + 11 / 1e5),
    "pz2-rl.cir": -1.060594e7,  # -R/L of the last of four stages
    "t-abs.cir": -(1 + 1e5 / 2 * 20e3 / 20.075e3) / (1e8 * 53e-12),
}
WITHIN = {"refused-k-one.net": 1e-4, "refused-level2.net": 1e-4}


@pytest.mark.parametrize("name", POLES)
def test_the_slowest_pole_is_that_of_the_cards(name: str, ngspice: str) -> None:
    board = read_board(CASES / name)
    found = poles(board.circuit).rightmost.real
    assert found == pytest.approx(POLES[name], rel=WITHIN.get(name, 5e-4))


@pytest.mark.parametrize(
    ("name", "note"),
    [
        ("agauss-random.cir", "agauss(): a drawn value counts with its nominal one"),
        ("agauss-random.cir", "gauss(): a drawn value counts with its nominal one"),
        ("t-abs.cir", ".model dx: T_ABS does not count"),
        ("refused-portnum-ac.cir", "r2: its AC value ac= does not count"),
    ],
)
def test_what_does_not_count_is_said(name: str, note: str, ngspice: str) -> None:
    assert any(each.startswith(note) for each in read_board(CASES / name).notes)


@pytest.mark.parametrize(
    ("value", "ohms"),
    [
        ("{agauss(2k,100,3)}", 2e3), ("{2*gauss(1k,0.1,3)}", 2e3), ("{aunif(2k,1k)}", 2e3),
        ("{unif(2k, 0.5)}", 2e3), ("{limit(2k,1k)}", 2e3), ("{limit(5k,1k,2k)}", 2e3),
        ("{limit(0,3k,2k)}", 2e3), ("{mc(2k,0.1)}", 2e3), ("4R7", 4.7), ("2k tc=1m,2u", 2e3),
        ("2k TC = 0, 0", 2e3), ("2k tc1=1m tc2=2u", 2e3), ("2k ac=1", 2e3), ("R=2k ac={1+1}", 2e3),
    ],
)  # fmt: skip
def test_the_value_of_a_resistor(value: str, ohms: float, tmp_path: Path, ngspice: str) -> None:
    place = tmp_path / "deck.cir"
    place.write_text(f"t\n{RC}R2 out 0 {value}\n.end\n")
    found = {part.card: part.ohms for part in read_board(place).circuit.resistors}
    assert found["R2"] == pytest.approx(ohms, rel=1e-12)


@pytest.mark.parametrize(
    ("card", "ohms"),
    [
        ("R2 out 0 mod\n.model mod r (r=2k)", 2e3),
        ("R2 out 0 mod l=10u w=1u\n.model mod r (rsh=200)", 2e3),
        ("R2 out 0 mod 1k\n.model mod r (r=2k)", 1e3),
        ("R2 out 0 mod 1k\n.model mod r (tnom=50 tc1=1m)", 977.0),  # at 27 degrees C
        ("R2 out 0 r={2k+0*v(out)*v(out)} tc1=1m", 2e3),
    ],
)
def test_a_resistor_with_its_value_elsewhere_is_measured(
    card: str, ohms: float, tmp_path: Path, ngspice: str
) -> None:
    place = tmp_path / "deck.cir"
    place.write_text(f"t\n{RC}{card}\n.end\n")
    rate = -(1.0 / 1e3 + 1.0 / ohms) / 1e-9
    assert poles(read_board(place).circuit).rightmost.real == pytest.approx(rate, rel=1e-9)


def test_a_function_of_the_deck_counts(tmp_path: Path, ngspice: str) -> None:
    place = tmp_path / "deck.cir"
    place.write_text(f"t\n{RC}.func agauss(x,y,z) {{x+y}}\nR2 out 0 {{agauss(1k,2,3)}}\n.end\n")
    board = read_board(place)
    assert {part.card: part.ohms for part in board.circuit.resistors}["R2"] == 1002.0
    assert not [note for note in board.notes if "drawn" in note]
    assert missing_cards([".param limit=3", "r1 a b {limit}"]) == ([], [])


@pytest.mark.parametrize(
    ("given", "ohms"), [(" z0 75", "75"), ("", "50"), (" z0 75 pwr 1m freq 2.3e9 phase=0", "75")]
)
def test_the_resistance_of_a_port_is_a_part(given: str, ohms: str) -> None:
    *_, part = plain_cards(f"v1 in 0 ac 1 portnum 1{given}")
    assert part == f"rser_v1 in in_taction_v1_1 {ohms}"


def test_calls_with_parameters_have_their_own_models(tmp_path: Path, ngspice: str) -> None:
    """Two op-amps of one subcircuit, with poles of 10 Hz and of 40 Hz."""
    text = (CASES / "param-override.cir").read_text()
    second = "X2 in n vp vn b genop params: GAIN = 100k POLE={2*20}\nR3 n 0 10k\nR4 b n 10k\n.tran"
    place = tmp_path / "deck.cir"
    place.write_text(text.replace(".tran", second))
    found = np.sort(poles(read_board(place).circuit).poles.real)
    slow = POLES["param-override.cir"]
    assert found[-2:] == pytest.approx([4.0 * slow, slow], rel=5e-4)


def test_subcircuits_of_one_name_within_others(tmp_path: Path, ngspice: str) -> None:
    inner = ".subckt part a\nR1 a 0 {r}k\n.ends\n"
    wrapper = ".subckt w{k} a\n{inner}X1 a part\n.ends\n"
    calls = "X1 out w1\nX2 out w2\n"
    place = tmp_path / "deck.cir"
    same, other = inner.format(r=1), inner.format(r=2)
    place.write_text(f"t\n{RC}{wrapper.format(k=1, inner=same)}{wrapper.format(k=2, inner=same)}"
                     f"{calls}.end\n")  # fmt: skip
    assert poles(read_board(place).circuit).rightmost.real == pytest.approx(-3e6, rel=1e-9)
    two = f"{wrapper.format(k=1, inner=same)}{wrapper.format(k=2, inner=other)}"
    place.write_text(f"t\n{RC}{two}{calls}.end\n")  # each call means the nearest one, as in ngspice
    assert poles(read_board(place).circuit).rightmost.real == pytest.approx(-2.5e6, rel=1e-9)
    place.write_text(f"t\n{RC}{two}{two.replace('2k', '3k')}{calls}.end\n")
    with pytest.raises(InputError, match=r"line 23 .*second subcircuit of this name"):
        read_board(place)


@pytest.mark.parametrize(
    ("body", "reason"),
    [
        ("r1 a b 1k\n.control\nshell touch /tmp/x\n.endc", "lines of commands"),
        (".include other.cir", "card '.include'"),
        (".options klu", "card '.options'"),
        (".param half=0.5", "card '.param'"),
        ("a1 a b gain", "card 'a1' is not accepted"),
        ("n1 a b osdi", "card 'n1'"),
        (".model m d_process(process_file=1)", "names a file or a program"),
        (".model q d(file=data)", "names a file"),
        ("v1 a b pwl file=x", "from a file|names a file"),
        ("b1 a b v=time", "source over time"),
        ("r1 a b 1k\\", r"character '\\\\'"),
        ("r1 a b 1k\x0bshell ls", r"character '\\x0b'"),
        ("r1 a b 1k\rshell ls", r"character '\\r'"),
        ("r1 a b 1k`ls`", "character '`'"),
        ("x1 a b part", "card 'x1' is not accepted"),
        (".subckt inner a b", "card '.subckt'"),
        (".ends\nr1 a b 1k", "card '.ends'"),
        ("+ (", "whole subcircuit|not match|part"),
    ],
)
def test_a_hostile_card_of_a_stored_file_is_refused(body: str, reason: str) -> None:
    lines = [".subckt part a b", body, ".ends"] if body != "+ (" else [".subckt other a b", ".ends"]
    with pytest.raises(InputError, match=reason):
        stored_subcircuit(lines, "part", "m")


@pytest.mark.parametrize(
    ("body", "reason"),
    [
        ("a1 a b gain", r"line 3.*code model of ngspice .A. is not accepted: some start programs"),
        (".model m d_process(process_file=1)", "line 3.*names a file or a program"),
        ("b1 a b v=time", "line 3.*source over time"),
        ("r1 a b 1k`ls`", "line 3.*character '`'"),
        (".include /etc/passwd", "outside the deck's folder"),
        (".hdl ekv.va", "card '.hdl' is not accepted"),
        ("x1 a b part", "calls itself"),
        ("x1 a b other", "no subcircuit 'other'"),
        ("b1 a b v=table(v(a),0,0,0,1)", "table in which 0.0 follows 0.0"),
        ("b1 a b v=table(v(a),0)", "table needs pairs"),
        ("s1 a b a b m\n.model m vswitch(ron=1 lib=2)", "lib of a vswitch"),
        ("s1 a b a b m\n.model m vswitch(ron=0)", "resistances above 0"),
    ],
)
def test_a_card_of_a_library_that_is_not_accepted_is_named(
    body: str, reason: str, tmp_path: Path
) -> None:
    file = tmp_path / "a.lib"
    file.write_text(f"* a library\n.subckt part a b\n{body}\n.ends\n")
    with pytest.raises(InputError, match=reason):
        vendor_subcircuit(file, "part")


def test_what_a_subcircuit_does_not_call_is_not_read(tmp_path: Path) -> None:
    file = tmp_path / "a.lib"
    file.write_text(
        "* a library\n.subckt odd a b\na1 a b gain\n.ends\n"
        '.subckt part a b\r\nx1 a b in/n.er\r\n.ends* "Q"\r\n\x1a\x1a* next\n'
        ".subckt in/n.er p q\nr1 p q 1k ; 'x'\n.ends IN/N.ER*next \"Q\"\nr7 0 1 5\n"
    )
    found = vendor_subcircuit(file, "PART")
    assert found.ports == ("a", "b")
    assert found.lines == (
        *(".subckt part a b", "x1 a b in_2f_n_2e_er", ".ends"),
        *(".subckt in_2f_n_2e_er p q", "r1 p q 1k", ".ends"),
    )


def test_a_polynomial_has_the_order_of_spice2() -> None:
    """The terms of two inputs: 1, x, y, x², xy, y²."""
    text = polynomial(True, "2", "a 0 b 0 1 2 3 4 5 6")
    x, y = 0.7, -1.3
    found = eval(text.replace("v(a,0)", "x").replace("v(b,0)", "y"), {"x": x, "y": y})  # noqa: S307
    assert found == pytest.approx(1 + 2 * x + 3 * y + 4 * x * x + 5 * x * y + 6 * y * y)
    assert polynomial(False, "1", "v1 2") == "2.0*i(v1)"
    assert polynomial(False, "1", "v1 0 0 0 {k}") == "(k)*i(v1)*i(v1)*i(v1)"


EVERY_CARD = """
.param half=0.5 third={1/3}
.model dx d(is=1e-14 n=1)
.model qn npn(is=1e-15 bf=100)
.model jn njf(vto=-2 beta=1m)
.model mn nmos(level=1 vto=1 kp=2m)
.model sx sw(vt=0.5 ron=1 roff=1g)
.subckt inner p q params: ohms=1k
r1 p q {ohms}
.ends inner
.param late={pi*early} early=2
.model rq res(t_abs=-273 tce=0)
.model sv vswitch(ron=1k roff=4k von=1 voff=0)
.model dk d(is=1e-14 kf={pwr(early,2)})
.subckt every in r e g f h b d q j m s x l p1 p2 p3 p4 p5 p6
ip1 0 p1 table(0 0 {early} 4m)
rp1 p1 0 rq 1k noiseless
ep2 p2 0 table {v(in)*2} = (-1,2) (0.5,3) (1.5,5)
gp3 0 p3 value={limit(v(in),0.7,2)*1m + if(v(in)>1 | v(in)<0, 1m, 2m)}
rp3 p3 0 1k
bp4 p4 0 v=tbl(v(in)-9,0,7,1,8)+late
ip5 0 p5 1m
sp5 p5 0 in 0 sv
gp6 0 p6 in 0 tbl(0 0 1 1m)
rp6 p6 0 1k
dp6 p6 0 dk 1e-3 off
v1 one 0 dc 1
i1 0 r 1m
r1 r 0 1k tc1=0
c1 r 0 1p
e1 e 0 one 0 2.5
e2 e2 0 poly(2) (one,0) (in,0) 1 2 3
re2 e2 0 1k
g1 0 g one 0 1m
rg g 0 3k
vs one sense 0
rs sense 0 100
f1 0 f vs 0.5
rf f 0 1k
h1 h 0 vs 200
b1 b 0 v={max(v(one),third)*half+tanh(0)}
id 0 d 1m
d1 d 0 dx
iq 0 q 1m
q1 q q 0 qn
ej jd 0 value={5*v(one)}
j1 jd 0 js jn
rj js 0 1k
bj j 0 v=v(js)
vm md 0 5
m1 md md ms ms mn l=1u w=1u
rm ms 0 1k
bm m 0 v=v(ms)
s1 one s one 0 sx
rsw s 0 1
x1 one x inner params: ohms=3k
rx x 0 1k
l1 one l 1u
rl l 0 1k
.ends every
"""


def test_every_kind_of_card_has_its_value_in_ngspice(ngspice: str, tmp_path: Path) -> None:
    """As the vendor wrote it in PSpice's ways, and flat in ngspice's own."""
    file = tmp_path / "every.lib"
    file.write_text(EVERY_CARD)
    found = vendor_subcircuit(file, "every")
    nodes = found.ports[1:]
    bench = ["Vin in 0 0.5", "Rin in 0 1k", *(f"Rload_{node} {node} 0 1e12" for node in nodes)]
    call = f"Xdevice in {' '.join(nodes)} "
    point = find_point([*found.lines, *bench, call + found.name])
    flat = flat_subcircuit(point.cards, ("in", *nodes), "every")
    stored = stored_subcircuit(flat.lines, flat.name, "own")
    again = find_point([*stored.lines, *bench, call + stored.name], modes=("",))
    for value in (point.volts, again.volts):
        VT = 1.380649e-23 * 300.15 / 1.602176634e-19
        assert value["r"] == pytest.approx(1.0, rel=1e-6)
        assert value["e"] == pytest.approx(2.5, rel=1e-6)
        assert value["g"] == pytest.approx(3.0, rel=1e-6)
        assert value["f"] == pytest.approx(0.01 * 0.5 * 1e3, rel=1e-6)  # 10 mA through the sensor
        assert value["h"] == pytest.approx(2.0, rel=1e-6)
        assert value["b"] == pytest.approx(0.5, rel=1e-6)
        assert value["d"] == pytest.approx(VT * math.log(1e-3 / 1e-14), rel=1e-4)
        assert value["q"] == pytest.approx(VT * math.log(1e-3 / 1.01 / 1e-15), rel=1e-4)
        # JFET: i = beta (vgs - vto)² with vgs = -1000 i of a resistor; MOS: i = kp/2 (vgs - vto)².
        assert value["j"] == pytest.approx(1.0, rel=1e-4)
        drop = 5.0 - value["m"] - 1.0
        assert value["m"] == pytest.approx(1e3 * 1e-3 * drop**2, rel=1e-4)
        assert value["s"] == pytest.approx(0.5, rel=1e-6)
        assert value["x"] == pytest.approx(0.25, rel=1e-6)
        assert value["l"] == pytest.approx(1.0, rel=1e-6)
        assert value["p1"] == pytest.approx(0.0, abs=1e-9)  # into its own voltage, -v: level at 0
        assert value["p2"] == pytest.approx(4.0, rel=1e-6)
        assert value["p3"] == pytest.approx(2.7, rel=1e-6)
        assert value["p4"] == pytest.approx(7.0 + 2.0 * math.pi, rel=1e-6)
        assert value["p5"] == pytest.approx(2.0, rel=1e-6)  # sqrt(1k 4k) in the middle
        assert value["p6"] == pytest.approx(0.5, rel=1e-2)
