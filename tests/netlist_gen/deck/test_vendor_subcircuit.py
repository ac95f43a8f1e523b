"""Vendors' subcircuits: hostile files are refused with their line, what passes is as it was."""

from __future__ import annotations

import math
from pathlib import Path

import pytest

from taction.netlist_gen.deck.expressions import polynomial
from taction.netlist_gen.deck.vendor_subcircuit import (
    flat_subcircuit,
    stored_subcircuit,
    vendor_subcircuit,
)
from taction.system.errors import InputError
from taction.verification.characterise.operating_point import find_point
from taction.verification.engines.ngspice.executable import find_simulator

VENDOR = Path(__file__).parents[2] / "data" / "fet100.cir"


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
        ".subckt in/n.er p q\nr1 p q 1k ; 'x'\n.ends\nr7 0 1 5\n"
    )
    found = vendor_subcircuit(file, "PART")
    assert found.ports == ("a", "b")
    assert found.lines == (
        *(".subckt m0 a b", "x1 a b m1", ".ends"),
        *(".subckt m1 p q", "r1 p q 1k", ".ends"),
    )


def test_a_polynomial_has_the_order_of_spice2() -> None:
    """The terms of two inputs: 1, x, y, x², xy, y²."""
    text = polynomial(["v(a,0)", "v(b,0)"], [1.0, 2.0, 3.0, 4.0, 5.0, 6.0])
    x, y = 0.7, -1.3
    found = eval(text.replace("v(a,0)", "x").replace("v(b,0)", "y"), {"x": x, "y": y})  # noqa: S307
    assert found == pytest.approx(1 + 2 * x + 3 * y + 4 * x * x + 5 * x * y + 6 * y * y)
    assert polynomial(["i(v1)"], [2.0]) == "2.0*i(v1)"
    assert polynomial(["i(v1)"], [0.0, 0.0, 0.0, 4.0]) == "4.0*i(v1)*i(v1)*i(v1)"


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
    bench = [
        "Vin in 0 0.5",
        "Rin in 0 1k",
        *(f"Rload_{node} {node} 0 1e12" for node in nodes),
    ]
    call = f"Xdevice in {' '.join(nodes)} "
    simulator = find_simulator()
    point = find_point([*found.lines, *bench, call + found.name], "", simulator)
    flat = flat_subcircuit(point.cards, ("in", *nodes), "every")
    stored = stored_subcircuit(flat.lines, flat.name, "own")
    again = find_point([*stored.lines, *bench, call + stored.name], "", simulator, modes=("",))
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
