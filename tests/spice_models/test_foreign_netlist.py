"""Foreign netlists: hostile files are refused with their line, and what passes is written anew."""

from __future__ import annotations

import math
from pathlib import Path

import pytest

from taction.netlist_gen.analysis import OperatingPoint
from taction.spice_models.foreign_expressions import FUNCTIONS, expression, number, polynomial
from taction.spice_models.foreign_lines import RefusedError, logical_lines
from taction.spice_models.foreign_netlist import read_subcircuit
from taction.verification.engines.ngspice.process import find_simulator, start
from tests.support.small_decks import SmallDeck

VENDOR = Path(__file__).parents[1] / "data" / "fet100.cir"


def refused(body: str, line: int, reason: str) -> None:
    """The subcircuit begins on line 1, so the first line of `body` is line 2."""
    content = f".subckt part a b\n{body}\n.ends\n".encode()
    with pytest.raises(RefusedError, match=reason) as caught:
        read_subcircuit(content, "part", "m")
    assert caught.value.number == line


@pytest.mark.parametrize(
    ("body", "line", "reason"),
    [
        ("r1 a b 1k\n.control\nshell touch /tmp/x\n.endc", 3, "card '.control' is not accepted"),
        (".include other.cir", 2, "'.include'"),
        (".lib 'other.lib' tt", 2, 'character "\'"'),
        (".lib other.lib tt", 2, "card '.lib'"),
        (".inc /etc/passwd", 2, "card '.inc'"),
        (".func f(x) {x}", 2, "card '.func'"),
        (".options klu", 2, "card '.options'"),
        (".csparam a=1", 2, "card '.csparam'"),
        (".if (1)", 2, "card '.if'"),
        (".hdl ekv.va", 2, "card '.hdl'"),
        ("a1 a b gain", 2, "device 'A' is not accepted"),
        ("n1 a b osdi", 2, "device 'N'"),
        ("k1 l1 l2 0.9", 2, "device 'K'"),
        ("w1 a b v1 sw", 2, "device 'W'"),
        ("b1 a b v={agauss(0,1,3)}", 2, "function 'agauss' is not accepted"),
        ("b1 a b v=ddt(v(a))", 2, "function 'ddt'"),
        ("b1 a b v=table(v(a),0,0,0,1)", 2, "table in which 0.0 follows 0.0"),
        ("b1 a b v=table(v(a),0)", 2, "table needs pairs"),
        ("b1 a b v=limit(v(a),1)", 2, "2 arguments of 'limit'"),
        ("b1 a b v=if(v(a),)", 2, "commas that do not match"),
        ("b1 a b v=" + "(" * 99 + "1" + ")" * 99, 2, "more than 50 parentheses"),
        ("b1 a b v=" + "limit(1,1," * 20 + "1" + ")" * 20, 2, "at most 20,000 are read"),
        ("i1 a b table(0 0 1)", 2, "table needs pairs"),
        ("i1 a b tbl(0 0 {x} 1)", 2, "name 'x' is no parameter"),
        ("e1 a b table {v(a)} = (0,0) (1,{x})", 2, "name 'x' is no parameter"),
        ("s1 a b a b m\n.model m vswitch(ron=1 lib=2)", 3, "lib of a vswitch"),
        ("s1 a b a b m\n.model m vswitch(ron=0)", 3, "resistances above 0"),
        ("r1 a b m 1k\n.model m res(r=2)", 3, "r=2.0 of a model of resistors"),
        ("a1 a b 0 0 0 0 b 0 ota g=1", 2, "device 'A'"),
        ("b1 a b v=time", 2, "name 'time' is no parameter"),
        ("b1 a b v=v(a)\nshell ls", 3, "none of the fields is the model"),
        ("e1 a b laplace {v(a)} = {1/(1+s)}", 2, "braces"),
        ("e1 a b value={v(a)*foo}", 2, "name 'foo'"),
        ("e1 a b poly(2) a 0 b 0 0 1 1 1 1 1 1", 2, "only degree 2"),
        ("v1 a b pwl(0 0 1 1)", 2, "constant|not accepted"),
        ("v1 a b dc 1 ac 1", 2, "only a constant"),
        ("i1 a b pulse(0 1 0)", 2, "constant|not accepted"),
        ("r1 a b 0", 2, "resistor of 0 ohm"),
        ("r1 a b 1.2.3k", 2, "not a number"),
        ("r1 a b 1e999", 2, "not finite"),
        ("c1 a b 1n ic=5", 2, "key 'ic'"),
        ("q1 a b a nosuch", 2, "none of the fields is the model"),
        (".model q npn(level=4)\nq1 a b a q", 2, "level=4.0 is not accepted"),
        (".model q vdmos(vto=1)", 2, "model 'vdmos'"),
        (".model q d(file=data)", 2, "not a number"),
        ("r1 a b 1k\\", 2, r"character '\\\\'"),
        ("r1 a b 1k\x0bshell ls", 2, r"character '\\x0b'"),
        ("r1 a b 1k\rshell ls", 2, r"character '\\r'"),
        ("r1 a b 1k\x85shell ls", 2, "is not accepted"),
        ("r1 a b 1k`ls`", 2, "character '`'"),
        ('r1 a b "1k"', 2, "character '\"'"),
        ("r1 a\x1a b 1k", 2, r"character '\\x1a'"),
        ("r1 a b 1k\0", 2, r"character '\\x00'"),
        ("r1 a #echo 1k", 2, "node '#echo'"),
        ("x1 a b part", 2, "calls itself"),
        ("x1 a b other", 2, "'other' is not in the file"),
        ("r1 a b 1k\nr1 a b 2k", 3, "second device of this name"),
        (".subckt inner a b", 2, "within another"),
        ("r1 a b {x", 2, "braces"),
        ("b1 a b v=max(v(a),1", 2, "parentheses"),
        ("d1 a b", 2, "model"),
        ("r1", 2, "at least 2 fields"),
    ],
)
def test_a_hostile_card_is_refused_with_its_line(body: str, line: int, reason: str) -> None:
    refused(body, line, reason)


def test_a_continuation_belongs_to_the_line_where_it_begins() -> None:
    refused("* comment\nr1 a\n* more\n+ b\n+ 0", 3, "0 ohm")


@pytest.mark.parametrize("text", [b"+ r1 a b 1\n", b".ends\n", b".subckt a\n.ends\n"])
def test_a_file_that_begins_wrongly_is_refused(text: bytes) -> None:
    with pytest.raises(RefusedError, match=r"^line 1"):
        read_subcircuit(text, "a", "m")


def test_a_missing_subcircuit_is_named_with_those_of_the_file() -> None:
    with pytest.raises(RefusedError, match="no subcircuit 'lm741'; it has fet100"):
        read_subcircuit(VENDOR.read_bytes(), "lm741", "m")


def test_the_end_of_file_mark_of_dos_is_no_character() -> None:
    """At the end, and between files that were joined."""
    content = b'.subckt p/1.a a b\r\nr1 a b 1k\r\n.ends* "Q"\r\n\x1a\r\n\x1a* next\r\n\x1a\x1a'
    assert read_subcircuit(content, "P/1.A", "m").lines == (
        ".subckt m_p_1_a a b",
        "r1 a b 1000.0",
        ".ends m_p_1_a",
    )


def test_subcircuits_whose_new_names_are_equal_have_different_ones() -> None:
    content = b".subckt p a b\nx1 a b q/1\nx2 a b q-1\n.ends\n" + b"".join(
        b".subckt q" + sign + b"1 a b\nr1 a b 1k\n.ends\n" for sign in (b"/", b"-")
    )
    text = "\n".join(read_subcircuit(content, "p", "m").lines)
    assert all(f".subckt m_{each} a b" in text for each in ("q_1_0", "q_1_1", "p_2"))


def test_comments_hold_anything_and_reach_nothing() -> None:
    content = (
        b"*# shell ls\n* \xb5\x85 \x0b\n*ng_script\n.subckt p a b ; 'x'\n"
        b'r1 a b 1k $ \\ `ls`\n.ends // "\n.end\n.control\n'
    )
    found = read_subcircuit(content, "P", "m")
    assert found.lines == (".subckt m_p a b", "r1 a b 1000.0", ".ends m_p")


def test_what_is_written_is_read_again_as_the_same() -> None:
    once = read_subcircuit(VENDOR.read_bytes(), "FET100", "m")
    again = read_subcircuit("\n".join(once.lines).encode(), once.name, "n")
    assert again.lines[1:-1] == once.lines[1:-1]
    assert again.ports == ("1", "2", "3", "4", "5")
    assert "b_egnd 99 0 v=0.5*v(3,0)+0.5*v(4,0)" in once.lines


@pytest.mark.parametrize(
    ("text", "value"),
    [("1m", 1e-3), ("1meg", 1e6), ("2mil", 50.8e-6), ("1e3k", 1e6), ("-3pf", -3e-12), ("+7v", 7.0)],
)
def test_numbers_have_the_suffixes_of_spice(text: str, value: float) -> None:
    assert number(text) == pytest.approx(value, rel=1e-15)


def test_every_function_of_the_list_passes_and_no_other() -> None:
    for name in FUNCTIONS:
        assert expression(f"{name}(v(a))", ()) == f"{name}(v(a))"
    with pytest.raises(ValueError, match="function 'system'"):
        expression("system(v(a))", ())


def test_a_polynomial_has_the_order_of_spice2() -> None:
    """The terms of two inputs: 1, x, y, x², xy, y²."""
    text = polynomial(["v(a,0)", "v(b,0)"], [1.0, 2.0, 3.0, 4.0, 5.0, 6.0])
    x, y = 0.7, -1.3
    found = eval(text.replace("v(a,0)", "x").replace("v(b,0)", "y"), {"x": x, "y": y})  # noqa: S307
    assert found == pytest.approx(1 + 2 * x + 3 * y + 4 * x * x + 5 * x * y + 6 * y * y)
    assert polynomial(["i(v1)"], [2.0]) == "2.0*i(v1)"
    assert polynomial(["i(v1)"], [0.0, 0.0, 0.0, 4.0]) == "4.0*i(v1)*i(v1)*i(v1)"


def test_logical_lines_join_continuations() -> None:
    lines = logical_lines(b"R1 a b\r\n*c\r\n+ 1K\r\n\r\nC1 a b 1n\n")
    assert [(line.number, line.text) for line in lines] == [(1, "r1 a b 1k"), (5, "c1 a b 1n")]


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


def test_every_kind_of_card_has_its_value_in_ngspice(ngspice: str) -> None:
    found = read_subcircuit(EVERY_CARD.encode(), "every", "m")
    nodes = found.ports[1:]
    text = "\n".join(
        [
            "* every card",
            *found.lines,
            "Vin in 0 0.5",
            f"X1 in {' '.join(nodes)} {found.name}",
            "Rin in 0 1k",
            *(f"Rload_{node} {node} 0 1e12" for node in nodes),
            ".options reltol=1e-9 abstol=1e-15 vntol=1e-12",
            ".save " + " ".join(f"v({node})" for node in nodes),
            ".op",
            ".end",
            "",
        ]
    )
    with start(SmallDeck(text, nodes, OperatingPoint()), find_simulator(), timeout=60.0) as run:
        value = dict(zip(nodes, run.result().values[-1].tolist(), strict=True))
    VT = 1.380649e-23 * 300.15 / 1.602176634e-19
    assert value["r"] == pytest.approx(1.0, rel=1e-6)
    assert value["e"] == pytest.approx(2.5, rel=1e-6)
    assert value["g"] == pytest.approx(3.0, rel=1e-6)
    assert value["f"] == pytest.approx(0.01 * 0.5 * 1e3, rel=1e-6)  # 10 mA through the sensor
    assert value["h"] == pytest.approx(2.0, rel=1e-6)
    assert value["b"] == pytest.approx(0.5, rel=1e-6)
    assert value["d"] == pytest.approx(VT * math.log(1e-3 / 1e-14), rel=1e-4)
    assert value["q"] == pytest.approx(VT * math.log(1e-3 / 1.01 / 1e-15), rel=1e-4)
    # JFET with a resistor: i = beta (vgs - vto)² with vgs = -1000 i; MOS: i = kp/2 (vgs - vto)².
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
